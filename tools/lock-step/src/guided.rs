//! Guided movement on the lock-step rig: a sine under position control, and its quality.

use rig::RigFile;

use crate::ilc::Trace;
use crate::{Aim, LockStepError, LockStepRig};

/// Distance of the points between which jerk is taken (s): shorter, it would be the steps of stick
/// and slip alone.
const JERK_S: f64 = 0.01;

/// A sine that the handle is to follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sine {
    /// Amplitude (rad or m).
    pub amplitude: f64,
    /// Frequency (Hz).
    pub hertz: f64,
    /// Minimum settling time (s); rounded up to whole cycles.
    pub settle_s: f64,
    /// Minimum time that is evaluated (s); rounded up to whole cycles.
    pub keep_s: f64,
}

/// Moves a rig along a sine from rest and returns the last cycles; `effects` as for
/// [`LockStepRig::new`].
///
/// # Errors
/// [`LockStepError`].
pub fn guided(rig: &RigFile, effects: &[String], sine: &Sine) -> Result<Trace, LockStepError> {
    let mut system = LockStepRig::new(rig, effects)?;
    let cycles = |seconds: f64| (seconds * sine.hertz - 1e-9).ceil().max(1.0) / sine.hertz;
    let settled_s = cycles(sine.settle_s);
    let end_s = settled_s + cycles(sine.keep_s);
    let half_step_s = 0.5 / f64::from(rig.rates.control_hz);
    let mut trace = Trace::default();
    while system.time_s() < end_s - half_step_s {
        let aim = Aim::sine(sine.amplitude, sine.hertz, system.time_s());
        let moment = system.follow(&aim)?;
        if moment.time_s > settled_s - half_step_s {
            trace.push(settled_s, aim.position, moment.command.reference_position[0], &moment);
        }
    }
    Ok(trace)
}

/// Quality of a movement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Root mean square error of the slave (rad or m).
    pub slave_error: f64,
    /// Root mean square error of the master (rad or m).
    pub master_error: f64,
    /// Longest time for which the slave stands still (s).
    pub plateau_s: f64,
    /// Root mean square of the slave's jerk (rad/s³ or m/s³), from its velocity 10 ms before and
    /// after.
    pub jerk: f64,
    /// Root mean square of the volts (V).
    pub effort_v: f64,
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) =
        values.fold((0.0, 0u32), |(sum, count), value| (sum + value * value, count + 1));
    (sum / f64::from(count)).sqrt()
}

impl Quality {
    /// Computes the quality over whole cycles; `None` if the trace is too short for the jerk.
    pub fn of(trace: &Trace) -> Option<Self> {
        let [first, second, ..] = trace.time_s.as_slice() else { return None };
        let step_s = second - first;
        let reach = (JERK_S / step_s).round().max(1.0) as usize;
        if trace.time_s.len() <= 2 * reach {
            return None;
        }
        let reach_s = reach as f64 * step_s;
        let less =
            |of: &[f64]| rms(trace.desired.iter().zip(of).map(|(desired, value)| desired - value));
        let jerk = trace.slave_velocity.windows(2 * reach + 1).map(|velocity| {
            (velocity[0] - 2.0 * velocity[reach] + velocity[2 * reach]) / (reach_s * reach_s)
        });
        Some(Self {
            slave_error: less(&trace.slave),
            master_error: less(&trace.master),
            plateau_s: longest_rest(&trace.slave_velocity) as f64 * step_s,
            jerk: rms(jerk),
            effort_v: rms(trace.volts.iter().copied()),
        })
    }
}

/// Longest run of steps in which the slave stands still, with the cycles taken as periodic.
pub fn longest_rest(velocity: &[f64]) -> usize {
    let (mut longest, mut run) = (0, 0);
    for velocity in velocity.iter().chain(velocity) {
        run = if *velocity == 0.0 { run + 1 } else { 0 };
        longest = longest.max(run);
    }
    longest.min(velocity.len())
}
