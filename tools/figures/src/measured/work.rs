//! Work of motor and hand in a recorded movement.

use serde::Serialize;

use super::trace::Trace;

/// Least share of the work that comes out.
const LEAST_SHARE: f64 = 0.1;

/// Work over a segment, and which share of what is put in comes out.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Work {
    /// Work of the motor on the transmission, J.
    pub(super) motor_j: f64,
    /// Work of the hand on the handle, J; negative where the handle drives the hand.
    pub(super) hand_j: f64,
    /// Work that comes out over work that is put in; `None` where both put work in, and where less
    /// than a tenth comes out: nobody holds the handle then.
    pub(super) efficiency: Option<f64>,
}

/// The work of a movement; `None` where the hand's torque or the handle's position is not measured.
pub(super) fn work(trace: &Trace) -> Option<Work> {
    let along = |torque: &[f64], position: &[f64]| -> f64 {
        let steps = position.windows(2).zip(torque.windows(2));
        steps.map(|(at, nm)| 0.5 * (nm[0] + nm[1]) * (at[1] - at[0])).sum()
    };
    let motor_j = trace.gear * along(&trace.motor_nm, &trace.smooth[0]);
    let hand_j = along(trace.hand_nm.as_deref()?, trace.slave.as_deref()?);
    let efficiency: Option<f64> = match (motor_j > 0.0, hand_j > 0.0) {
        (true, false) => Some(-hand_j / motor_j),
        (false, true) => Some(-motor_j / hand_j),
        _ => None,
    };
    let efficiency = efficiency.filter(|share| *share >= LEAST_SHARE);
    Some(Work { motor_j, hand_j, efficiency })
}
