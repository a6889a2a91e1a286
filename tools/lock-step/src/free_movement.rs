//! Free movement on the lock-step rig (§ 4.2): the torque with which a hand swings
//! the handle, with and without force control.
//!
//! The hand is a spring and a damper about its own reference. Rig and hand resonate together, so
//! the amplitude of that reference is corrected until the handle reaches the given amplitude; only
//! then can the two cases be compared.

use ipc_types::Mode;
use rig::{HandKind, RigFile};

use crate::{Aim, CycleResult, LockStepError, LockStepRig};

/// A movement of the hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing {
    /// Amplitude of the handle's movement (rad or m).
    pub amplitude: f64,
    /// Frequency (Hz).
    pub hertz: f64,
    /// Stiffness of the hand (N·m/rad or N/m).
    pub stiffness: f64,
    /// Damping of the hand (N·m·s/rad or N·s/m).
    pub damping: f64,
}

impl Swing {
    /// The movement of § 4.2, 120° peak to peak, at a frequency (Hz), by a firm hand: 20 N·m/rad
    /// and 0.5 N·m·s/rad are assumed.
    pub const fn of_the_thesis(hertz: f64) -> Self {
        Self { amplitude: std::f64::consts::FRAC_PI_3, hertz, stiffness: 20.0, damping: 0.5 }
    }
}

/// Control of the motor while the hand moves the handle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandleControl {
    /// None: 0 V, uncompensated.
    Off,
    /// Force control, § 4.2.
    Force,
}

/// Torque of the hand as the torque cell shows it, over whole cycles after settling.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HandEffort {
    /// Root mean square of its torque (N·m or N).
    pub rms: f64,
    /// Largest magnitude of its torque (N·m or N).
    pub peak: f64,
    /// Peak-to-peak torque within [`REVERSAL_WINDOW_S`] of a reversal, mean over the reversals
    /// (N·m or N).
    pub ripple: f64,
    /// Half the peak-to-peak travel of the handle, mean over the cycles (rad or m).
    pub amplitude: f64,
    /// Highest speed of the handle (rad/s or m/s).
    pub speed: f64,
    /// Largest magnitude of the commanded volts (V).
    pub volts: f64,
    /// The last cycle: time from its start (s), position of the handle (rad or m), torque of the
    /// hand (N·m or N).
    pub cycle: Vec<(f64, f64, f64)>,
}

/// Half-width of the window around a reversal in which the ripple is evaluated (s).
pub const REVERSAL_WINDOW_S: f64 = 0.025;
/// Settling time (s): a moving hand takes one second to reach its full amplitude.
const SETTLING_S: f64 = 2.0;
/// Minimum number of evaluated cycles.
const CYCLES: f64 = 3.0;
/// Minimum time that is evaluated (s).
const LEAST_S: f64 = 2.0;
/// Relative tolerance of the amplitude.
const AMPLITUDE_TOLERANCE: f64 = 5e-3;
/// Largest number of corrections of the hand's reference.
const CORRECTIONS: usize = 5;

/// Simulates a hand that swings the handle; its movement replaces that of the rig file's hand.
///
/// If friction keeps the handle from the given amplitude, [`HandEffort::amplitude`] is the one
/// reached.
///
/// # Errors
/// [`LockStepError`].
pub fn swing(
    rig: &RigFile,
    control: HandleControl,
    swing: &Swing,
) -> Result<HandEffort, LockStepError> {
    let mut rig = rig.clone();
    let hand = &mut rig.simulation.hand;
    hand.kind = HandKind::Moving;
    (hand.stiffness, hand.damping) = (swing.stiffness, swing.damping);
    (hand.amplitude, hand.frequency_hz) = (swing.amplitude, swing.hertz);
    let mut spent = once(&rig, control, swing.hertz)?;
    for _ in 0..CORRECTIONS {
        let share = spent.amplitude / swing.amplitude;
        if (share - 1.0).abs() <= AMPLITUDE_TOLERANCE || share.is_nan() || share <= 0.0 {
            break;
        }
        // Below the friction torque nothing moves, so each correction is bounded.
        rig.simulation.hand.amplitude /= share.clamp(0.5, 2.0);
        spent = once(&rig, control, swing.hertz)?;
    }
    Ok(spent)
}

fn once(rig: &RigFile, control: HandleControl, hertz: f64) -> Result<HandEffort, LockStepError> {
    let mode = match control {
        HandleControl::Off => Mode::Passive,
        HandleControl::Force => Mode::Impedance,
    };
    let mut system = LockStepRig::new(rig, &[])?;
    let period = (f64::from(rig.rates.control_hz) / hertz).round().max(1.0) as usize;
    let cycles = CYCLES.max((LEAST_S * hertz).ceil()) as usize;
    let settling = ((SETTLING_S * hertz).ceil() as usize).max(1) * period;
    // The motor has power, and the hand moves, from the first cycle on: a cycle of whole control
    // periods begins where the hand passes through its centre.
    let mut results = Vec::with_capacity(cycles * period);
    for step in 0..settling + cycles * period {
        let mut setpoint = system.setpoint(&Aim::at_rest(0.0));
        setpoint.mode = mode.code();
        let result = system.cycle(&setpoint)?;
        if step >= settling {
            results.push(result);
        }
    }
    Ok(read(&results, period, 1.0 / f64::from(rig.rates.control_hz)))
}

/// Reads whole cycles of `period` steps of `step_s`.
fn read(results: &[CycleResult], period: usize, step_s: f64) -> HandEffort {
    let torque = |result: &CycleResult| result.sample.slave_torque[0];
    let position = |result: &CycleResult| result.motion.slave_position_rad;
    let largest = |value: &dyn Fn(&CycleResult) -> f64| {
        results.iter().map(|result| value(result).abs()).fold(0.0, f64::max)
    };
    let squares: f64 = results.iter().map(|result| torque(result).powi(2)).sum();
    let around = (REVERSAL_WINDOW_S / step_s).round() as usize;
    let (mut amplitudes, mut ripples) = (Vec::new(), Vec::new());
    for (index, cycle) in results.chunks_exact(period).enumerate() {
        let at = |sign: f64| {
            (0..period).max_by(|a, b| {
                (sign * position(&cycle[*a])).total_cmp(&(sign * position(&cycle[*b])))
            })
        };
        let (Some(most), Some(least)) = (at(1.0), at(-1.0)) else { continue };
        amplitudes.push(0.5 * (position(&cycle[most]) - position(&cycle[least])));
        for reversal in [most, least].map(|reversal| index * period + reversal) {
            let window = &results
                [reversal.saturating_sub(around)..(reversal + around + 1).min(results.len())];
            let (low, high) = extremes(window.iter().map(torque));
            ripples.push(high - low);
        }
    }
    let last = results.len().saturating_sub(period);
    HandEffort {
        rms: (squares / results.len().max(1) as f64).sqrt(),
        peak: largest(&torque),
        ripple: mean(&ripples),
        amplitude: mean(&amplitudes),
        speed: largest(&|result| result.motion.slave_velocity_rad_s),
        volts: largest(&|result| result.command.volts[0]),
        cycle: results[last..]
            .iter()
            .enumerate()
            .map(|(step, result)| (step as f64 * step_s, position(result), torque(result)))
            .collect(),
    }
}

fn extremes(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    })
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
