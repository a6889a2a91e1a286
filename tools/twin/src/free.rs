//! Free movement on the twin (§ 4.2): what a hand must spend to move the handle to and fro, with
//! force control and without.
//!
//! The hand is a spring and a damper about where it wants to be. It wants more or less than it
//! gets, since machine and hand resonate together, so what it wants is corrected until the handle
//! goes as far as asked: only then do two machines compare.

use ipc_types::Mode;
use rig::{HandKind, RigFile};

use crate::{Aim, Moment, Twin, TwinError};

/// The hand at the handle, and what it does with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing {
    /// Amplitude of the handle's movement (rad or m).
    pub amplitude: f64,
    /// Frequency (Hz).
    pub hertz: f64,
    /// Stiffness of the hand about where it wants to be (N·m/rad or N/m).
    pub stiffness: f64,
    /// Damping of the hand about it (N·m·s/rad or N·s/m).
    pub damping: f64,
}

impl Swing {
    /// The movement that § 4.2 claims, 120° from end to end, at a frequency (Hz), by a hand that
    /// means it: 20 N·m/rad and 0.5 N·m·s/rad are assumed.
    pub const fn of_the_thesis(hertz: f64) -> Self {
        Self { amplitude: std::f64::consts::FRAC_PI_3, hertz, stiffness: 20.0, damping: 0.5 }
    }
}

/// What the machine does meanwhile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Machine {
    /// Nothing: 0 V, as if it were uncompensated.
    Dead,
    /// It moves with the hand, § 4.2.
    Yielding,
}

/// What the hand spent, over whole cycles after it had set off.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spent {
    /// Root mean square of its torque (N·m or N).
    pub rms: f64,
    /// Largest magnitude of its torque (N·m or N).
    pub peak: f64,
    /// Peak-to-peak torque within [`TURN_S`] of a turn, mean over the turns (N·m or N).
    pub ripple: f64,
    /// Half the way of the handle, mean over the cycles (rad or m).
    pub amplitude: f64,
    /// Highest speed of the handle (rad/s or m/s).
    pub speed: f64,
    /// Highest volts at the motor (V).
    pub volts: f64,
    /// The last cycle: time from its begin (s), position of the handle (rad or m), torque of the
    /// hand (N·m or N).
    pub cycle: Vec<(f64, f64, f64)>,
}

/// How far from a turn of the handle the ripple is looked for, either way (s).
pub const TURN_S: f64 = 0.025;
/// Time that hand and machine get to settle (s): a moving hand takes one second to come to its full
/// amplitude.
const SETTLING_S: f64 = 2.0;
/// Cycles over which is measured, at least, and time (s).
const CYCLES: f64 = 3.0;
const LEAST_S: f64 = 2.0;
/// The movement is as far as asked within this share.
const CLOSE: f64 = 5e-3;
/// Most corrections of what the hand wants.
const CORRECTIONS: usize = 5;

/// Lets a hand swing the handle; the rig file's own hand gives way to this one.
///
/// Where friction does not let the hand come to the asked amplitude within a few corrections,
/// [`Spent::amplitude`] says what it came to.
///
/// # Errors
/// [`TwinError`].
pub fn swing(rig: &RigFile, machine: Machine, swing: &Swing) -> Result<Spent, TwinError> {
    let mut rig = rig.clone();
    let hand = &mut rig.simulation.hand;
    hand.kind = HandKind::Moving;
    (hand.stiffness, hand.damping) = (swing.stiffness, swing.damping);
    (hand.amplitude, hand.frequency_hz) = (swing.amplitude, swing.hertz);
    let mut spent = once(&rig, machine, swing.hertz)?;
    for _ in 0..CORRECTIONS {
        let share = spent.amplitude / swing.amplitude;
        if (share - 1.0).abs() <= CLOSE || share.is_nan() || share <= 0.0 {
            break;
        }
        // Below friction nothing moves: a step is bounded, so that the next one finds its way back.
        rig.simulation.hand.amplitude /= share.clamp(0.5, 2.0);
        spent = once(&rig, machine, swing.hertz)?;
    }
    Ok(spent)
}

fn once(rig: &RigFile, machine: Machine, hertz: f64) -> Result<Spent, TwinError> {
    let mode = match machine {
        Machine::Dead => Mode::Passive,
        Machine::Yielding => Mode::Impedance,
    };
    let mut twin = Twin::new(rig, &[])?;
    let period = (f64::from(rig.rates.control_hz) / hertz).round().max(1.0) as usize;
    let cycles = CYCLES.max((LEAST_S * hertz).ceil()) as usize;
    let settling = ((SETTLING_S * hertz).ceil() as usize).max(1) * period;
    // The motor has power from the first cycle on, and with it the hand sets off: cycles begin
    // where it passes through its middle.
    let mut moments = Vec::with_capacity(cycles * period);
    for step in 0..settling + cycles * period {
        let mut setpoint = twin.setpoint(&Aim::at_rest(0.0));
        setpoint.mode = mode.code();
        let moment = twin.cycle(&setpoint)?;
        if step >= settling {
            moments.push(moment);
        }
    }
    Ok(read(&moments, period, 1.0 / f64::from(rig.rates.control_hz)))
}

/// Reads whole cycles of `period` steps of `step_s`.
fn read(moments: &[Moment], period: usize, step_s: f64) -> Spent {
    let torque = |moment: &Moment| moment.sample.slave_torque[0];
    let position = |moment: &Moment| moment.motion.slave_position_rad;
    let largest = |value: &dyn Fn(&Moment) -> f64| {
        moments.iter().map(|moment| value(moment).abs()).fold(0.0, f64::max)
    };
    let squares: f64 = moments.iter().map(|moment| torque(moment).powi(2)).sum();
    let around = (TURN_S / step_s).round() as usize;
    let (mut ways, mut ripples) = (Vec::new(), Vec::new());
    for (index, cycle) in moments.chunks_exact(period).enumerate() {
        let at = |sign: f64| {
            (0..period).max_by(|a, b| {
                (sign * position(&cycle[*a])).total_cmp(&(sign * position(&cycle[*b])))
            })
        };
        let (Some(most), Some(least)) = (at(1.0), at(-1.0)) else { continue };
        ways.push(0.5 * (position(&cycle[most]) - position(&cycle[least])));
        for turn in [most, least].map(|turn| index * period + turn) {
            let window =
                &moments[turn.saturating_sub(around)..(turn + around + 1).min(moments.len())];
            let (low, high) = extremes(window.iter().map(torque));
            ripples.push(high - low);
        }
    }
    let last = moments.len().saturating_sub(period);
    Spent {
        rms: (squares / moments.len().max(1) as f64).sqrt(),
        peak: largest(&torque),
        ripple: mean(&ripples),
        amplitude: mean(&ways),
        speed: largest(&|moment| moment.motion.slave_velocity_rad_s),
        volts: largest(&|moment| moment.command.volts[0]),
        cycle: moments[last..]
            .iter()
            .enumerate()
            .map(|(step, moment)| (step as f64 * step_s, position(moment), torque(moment)))
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
