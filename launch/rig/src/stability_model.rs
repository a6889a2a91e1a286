//! The control loops of a rig, for [`plant::stability`].
//!
//! A model that is no transmission says nothing about stability, and nothing is refused for it.

use plant::stability::{Hand, Law, LinearModel, Loop, Sampling, Unstable};

use crate::axis::Axis;
use crate::force_control::ACCELERATION_HZ;
use crate::rig_file::RigFile;

/// Scans from the one that control reads to the one at which its output reaches the motor.
const ANSWER_SCANS: f64 = 2.0;
/// Bisections in the search for the largest stable share of a gain.
const BISECTIONS: usize = 14;

/// The loop of an axis under a control law; `None` where the model is no transmission.
pub(crate) fn closed_loop(rig: &RigFile, axis: &Axis, law: Law) -> Option<Loop> {
    let parameters = rig.control_parameters(axis).ok()?;
    Some(Loop {
        model: LinearModel::new(&*parameters, axis.limits.speed_max),
        sampling: Sampling {
            period_s: period_s(rig),
            answer_s: ANSWER_SCANS / f64::from(rig.rates.acquisition_hz),
            velocity_hz: axis.control.velocity_filter_hz,
            acceleration_hz: ACCELERATION_HZ,
            cell_hz: rig.simulation.torque_bandwidth_hz,
        },
        gear: axis.master.turns_per_handle_turn,
        law,
    })
}

fn period_s(rig: &RigFile) -> f64 {
    1.0 / f64::from(rig.rates.control_hz)
}

/// The force control loop of an axis; `None` without force control, or where the model is no
/// transmission.
pub(crate) fn force_loop(rig: &RigFile, axis: &Axis) -> Option<Loop> {
    let force = axis.control.force?;
    let (gain, share) = (force.volts_per_hand_torque(), force.share(period_s(rig)));
    closed_loop(rig, axis, Law::Force { gain, share, by_slave: axis.slave.is_some() })
}

/// The largest share (0 to 1) that passes, where every smaller one passes too.
pub(crate) fn largest_share(passes: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if passes(middle) { low = middle } else { high = middle }
    }
    low
}

/// Describes an instability: the hand, the raised gains, the growth rate.
pub(crate) fn describe(unstable: &Unstable) -> String {
    let Unstable { hand, raised, growth } = unstable;
    let with = match hand {
        Hand { stiffness: 0.0, .. } => "nobody at the handle".to_owned(),
        Hand { stiffness, .. } => format!("a hand of {stiffness} N·m/rad"),
    };
    let gains =
        if *raised > 1.0 { format!(" and gains {raised} times as high") } else { String::new() };
    format!("with {with}{gains} a disturbance grows by {growth:.1}/s")
}
