//! Stability of the position and force gains with the declared transmission.

use plant::stability::{self, Law, Loop, MARGIN};

use crate::axis::Axis;
use crate::checked_toml::Source;
use crate::rig_file::RigFile;
use crate::stability_model::{closed_loop, describe, force_loop, largest_share};

/// Reports gains with which the declared transmission would be unstable.
pub(super) fn check(rig: &RigFile, source: &Source<'_>) {
    let axes = rig.axes.iter().enumerate();
    for (at, axis) in axes.filter(|(_, axis)| !axis.control.accept_unstable) {
        let key = |name: &str| format!("axes.{at}.control.{name}");
        check_position(rig, axis, &key, source);
        check_force(rig, axis, &key, source);
    }
}

fn check_loop(axis: Loop) -> Result<(), stability::Unstable> {
    stability::check(&[axis], &stability::Field::default())
}

fn check_position(rig: &RigFile, axis: &Axis, key: &impl Fn(&str) -> String, source: &Source<'_>) {
    let scaled = |share: f64| {
        let (proportional, derivative) =
            (share * axis.control.position_gain, share * axis.control.velocity_gain);
        closed_loop(rig, axis, Law::Position { proportional, derivative }).map(check_loop)
    };
    let Some(Err(unstable)) = scaled(1.0) else { return };
    let share = largest_share(|share| scaled(share).is_none_or(|checked| checked.is_ok()));
    let counts = axis.master.counts_per_unit;
    let (p, d) = (axis.control.position_gain / counts, axis.control.velocity_gain / counts);
    let expected = format!(
        "gains that the declared transmission bears with a margin of {MARGIN}: \
         with this ratio of D to P, P of at most {:.2e}",
        share * p
    );
    let found = format!("{p:.2e} V/count with D of {d:.2e} V·s/count: {}", describe(&unstable));
    let advice = "lower the gains, or set accept_unstable = true for a model \
                  that is known to be wrong there";
    source.problem(&key("p_v_per_count"), expected, found, advice);
}

fn check_force(rig: &RigFile, axis: &Axis, key: &impl Fn(&str) -> String, source: &Source<'_>) {
    let scaled = |share: f64| {
        let mut scaled = axis.clone();
        if let Some(force) = &mut scaled.control.force {
            force.torque_gain *= share;
        }
        force_loop(rig, &scaled).map(check_loop)
    };
    let (Some(Err(unstable)), Some(force)) = (scaled(1.0), axis.control.force) else { return };
    let share = largest_share(|share| scaled(share).is_none_or(|checked| checked.is_ok()));
    let expected = format!(
        "a gain that the declared transmission bears with a margin of {MARGIN}: \
         at most {:.3} V/V",
        share * force.torque_gain
    );
    let found = format!("{}: {}", force.torque_gain, describe(&unstable));
    source.problem(&key("force.p1"), expected, found, "lower p1, or forget more slowly");
}
