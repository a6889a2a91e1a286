//! A force field against a rig: torque limits, axes, stability.

use super::field::{Field, torque_symbol};
use super::field_stability::check_stability;
use super::segment_kind::Placement;

/// Checks a field on the segment's axis, its matrices on all axes that they span, and stability.
pub(super) fn check_field(field: &Field, placed: &Placement<'_>) -> bool {
    check_torques(field, placed)
        && check_matrix(field, placed)
        && check_stability(field, placed.index, placed.rig, |name| placed.key(name), placed.source)
}

/// Whether the axis measures the hand's torque, and the field stays below the limit on it.
fn check_torques(field: &Field, placed: &Placement<'_>) -> bool {
    let (axis, source) = (placed.axis, placed.source);
    let symbol = torque_symbol(axis.unit);
    let Some(most) = axis.limits.torque_max.filter(|_| axis.control.force.is_some()) else {
        let expected = format!(
            "an axis that measures the hand's torque, with a limit on it (axis \"{}\" does not)",
            axis.name
        );
        let advice = "add axes.torque to the rig file, or use rest";
        return source.problem(&placed.key("kind"), expected, "a free movement", advice);
    };
    let (torque, at) = field.largest_torque(axis.limits.position_min, axis.limits.position_max);
    if torque.abs() > most {
        let key = placed.first_key([
            "spring",
            "position_table_deg",
            "position_table_m",
            "wall_stiffness",
        ]);
        let expected = format!("a field of at most {most} {symbol} within the limits");
        let found = format!("{:.1} {symbol} at {}", torque.abs(), placed.show(at));
        let advice = "the watchdog would cut the power there; soften the field, \
                      or move its centre or walls";
        return source.problem(&key, expected, found, advice);
    }
    if let Some(table) = field.velocity_table.as_ref().filter(|table| table.largest() > most) {
        let key = placed.first_key(["velocity_table_deg_s", "velocity_table_m_s"]);
        let expected = format!("torques of at most {most} {symbol}");
        let found = format!("{:.1} {symbol}", table.largest());
        let advice = "the watchdog would cut the power there; lower the torques";
        return source.problem(&key, expected, found, advice);
    }
    true
}

/// Whether the rig has every axis of the field's matrices, each with force control and a torque
/// limit that the matrices respect.
fn check_matrix(field: &Field, placed: &Placement<'_>) -> bool {
    let Some(matrix) = &field.matrix else { return true };
    let (rig, source) = (placed.rig, placed.source);
    let key = placed.first_key(matrix.keys());
    if matrix.axes > rig.axes.len() {
        let axes = rig.axes.len();
        let expected =
            format!("at most {axes} rows of {axes}: the rig \"{}\" has so many axes", rig.name);
        let found = format!("{0} rows of {0}", matrix.axes);
        let advice = "give each row an axis, or choose a rig with more axes";
        return source.problem(&key, expected, found, advice);
    }
    for (index, axis) in rig.axes.iter().enumerate().take(matrix.axes) {
        let torque = matrix.largest_torque(index, |other| {
            let limits = &rig.axes[other].limits;
            (limits.position_min, limits.position_max)
        });
        let symbol = torque_symbol(axis.unit);
        match axis.limits.torque_max.filter(|_| axis.control.force.is_some()) {
            Some(most) if torque <= most => {}
            Some(most) => {
                let expected = format!(
                    "a field of at most {most} {symbol} on axis \"{}\" within the limits",
                    axis.name
                );
                let advice = "the watchdog would cut the power there; soften the field";
                return source.problem(&key, expected, format!("{torque:.1} {symbol}"), advice);
            }
            None => {
                let expected = format!(
                    "axes that measure the hand's torque, with a limit on it \
                     (axis \"{}\" does not)",
                    axis.name
                );
                let advice = "add axes.torque to the rig file";
                return source.problem(&key, expected, "a matrix over it", advice);
            }
        }
    }
    true
}
