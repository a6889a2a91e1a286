//! Stability of a force field with a rig's force control and declared transmission.

use std::slice::from_mut;

use plant::stability::{self, Loop, MARGIN, RELAXED, Unstable};

use super::field::Field;
use super::matrix::{MATRIX_AXES, Matrix};
use super::torque_table::TorqueTable;
use crate::checked_toml::Source;
use crate::rig_file::RigFile;
use crate::stability_model::{describe, force_loop, largest_share};

/// Reports a force field under which the rig would be unstable; false where it is refused.
/// `index` is the segment's axis, `key` the path of one of its keys.
pub(super) fn check_stability(
    field: &Field,
    index: usize,
    rig: &RigFile,
    key: impl Fn(&str) -> String,
    source: &Source<'_>,
) -> bool {
    let Err(unstable) = field_passes(field, index, rig) else { return true };
    let parts: Vec<_> =
        PARTS.iter().filter(|part| part.keys.iter().any(|name| source.has(&key(name)))).collect();
    let one = parts.iter().find(|part| field_passes(&part.scaled(field, 0.0), index, rig).is_ok());
    let scaled = |share: f64| match one {
        Some(part) => part.scaled(field, share),
        None => parts.iter().fold(field.clone(), |field, part| part.scaled(&field, share)),
    };
    let share = largest_share(|share| field_passes(&scaled(share), index, rig).is_ok());
    let part = one.or(parts.first());
    let name = part
        .and_then(|part| part.keys.iter().find(|name| source.has(&key(name))))
        .unwrap_or(&"kind");
    let value = one.and_then(|part| part.value(field));
    let (most, found) = match (value, part) {
        (Some(value), Some(part)) => {
            (format!("{} {}", digits(share * value), part.unit), format!("{value} {}", part.unit))
        }
        _ => (format!("{:.0} % of this", 100.0 * share), "this field".to_owned()),
    };
    let word = if value.is_some_and(|value| value < 0.0) { "at least" } else { "at most" };
    let expected =
        format!("{word} {most} on the rig \"{}\", with a gain margin of {MARGIN}", rig.name);
    let (found, advice) = match unstable {
        Refused::Grows(unstable) => (
            format!("{found}: {}", describe(&unstable)),
            "a field must be stable for any hand from none to 50 N·m/rad; soften it",
        ),
        Refused::Leaves { torque, most } => (
            format!(
                "{found}: {torque:.2} N·m (or N) outwards at the end of the axis, \
                 where a relaxed hand and the soft stop hold {most:.2}"
            ),
            "a field that pushes outwards must be balanced within the limits; weaken it, \
             or raise end_stop_stiffness in the rig file",
        ),
    };
    source.problem(&key(name), expected, found, advice)
}

/// Why a field is refused.
enum Refused {
    /// A disturbance would grow.
    Grows(Unstable),
    /// The field would drive the handle through the soft stops (torques in N·m or N).
    Leaves { torque: f64, most: f64 },
}

/// Checks every combination of the field's extremes on its own axis, with its matrices.
fn field_passes(field: &Field, index: usize, rig: &RigFile) -> Result<(), Refused> {
    let wide = field.matrix.as_ref().map_or(0, |matrix| matrix.axes);
    // Axes that the field does not couple do not depend on it.
    let used: Vec<usize> = if wide == 0 { vec![index] } else { (0..wide.max(index + 1)).collect() };
    let Some(axes) =
        used.iter().map(|at| force_loop(rig, rig.axes.get(*at)?)).collect::<Option<Vec<Loop>>>()
    else {
        return Ok(());
    };
    let own = used.iter().position(|at| *at == index).unwrap_or_default();
    let matrix = field.matrix.as_deref().copied().unwrap_or_default();
    let Matrix { stiffness, damping, inertia, .. } = matrix;
    let [stiff, damp] = field.extremes();
    for (k, d) in [(stiff.0, damp.0), (stiff.0, damp.1), (stiff.1, damp.0), (stiff.1, damp.1)] {
        let mut whole = stability::Field { stiffness, damping, inertia };
        whole.stiffness[own][own] += k;
        whole.damping[own][own] += d;
        whole.inertia[own][own] += field.inertia;
        stability::check(&axes, &whole).map_err(Refused::Grows)?;
        if whole.diverges() {
            used.iter()
                .try_for_each(|at| held_at_the_ends(field, &matrix, *at, *at == index, rig))?;
        }
    }
    Ok(())
}

/// Whether a relaxed hand and the soft stops balance a diverging field at both ends of an axis.
fn held_at_the_ends(
    field: &Field,
    matrix: &Matrix,
    at: usize,
    own: bool,
    rig: &RigFile,
) -> Result<(), Refused> {
    let Some(axis) = rig.axes.get(at) else { return Ok(()) };
    let Some(force) = axis.control.force else { return Ok(()) };
    let (lowest, highest) = axis.movement_range();
    let stop = force.end_stop_stiffness * force.end_stop_width(lowest, highest);
    for (end, outwards) in [(lowest, -1.0), (highest, 1.0)] {
        let alone = if own { field.torque(end) } else { 0.0 };
        let torque = outwards * (alone - matrix.stiffness[at][at] * (end - matrix.centres[at]));
        let most = RELAXED.stiffness * end.abs() + stop;
        if torque > most {
            return Err(Refused::Leaves { torque, most });
        }
    }
    Ok(())
}

/// One component of a field.
struct Part {
    /// Its keys in the file.
    keys: &'static [&'static str],
    /// Its unit, if it is a single number.
    unit: &'static str,
    /// Its numbers.
    numbers: fn(&mut Field) -> &mut [f64],
}

impl Part {
    /// Its value, if it is a single number.
    fn value(&self, field: &Field) -> Option<f64> {
        (self.numbers)(&mut field.clone()).first().copied().filter(|_| !self.unit.is_empty())
    }

    /// The field with a share of this component.
    fn scaled(&self, field: &Field, share: f64) -> Field {
        let mut field = field.clone();
        (self.numbers)(&mut field).iter_mut().for_each(|number| *number *= share);
        field
    }
}

const fn part(
    keys: &'static [&'static str],
    unit: &'static str,
    numbers: fn(&mut Field) -> &mut [f64],
) -> Part {
    Part { keys, unit, numbers }
}

const WALLS: &[&str] = &["wall_stiffness", "wall_min_deg", "wall_min_m"];
const PARTS: &[Part] = &[
    part(&["damper"], "N·m·s/rad", |field| from_mut(&mut field.damping)),
    part(&["inertia"], "kg·m²", |field| from_mut(&mut field.inertia)),
    part(&["spring"], "N·m/rad", |field| from_mut(&mut field.stiffness)),
    part(WALLS, "N·m/rad", |field| from_mut(&mut field.wall_stiffness)),
    part(&["velocity_table_deg_s", "velocity_table_m_s"], "", |f| torques(&mut f.velocity_table)),
    part(&["position_table_deg", "position_table_m"], "", |f| torques(&mut f.position_table)),
    part(&["curl", "matrix_damping"], "", |field| entries(field, |matrix| &mut matrix.damping)),
    part(&["matrix_stiffness"], "", |field| entries(field, |matrix| &mut matrix.stiffness)),
    part(&["matrix_inertia"], "", |field| entries(field, |matrix| &mut matrix.inertia)),
];

fn torques(table: &mut Option<Box<TorqueTable>>) -> &mut [f64] {
    table.as_deref_mut().map_or(&mut [], |table| &mut table.torques)
}

fn entries(
    field: &mut Field,
    of: fn(&mut Matrix) -> &mut [[f64; MATRIX_AXES]; MATRIX_AXES],
) -> &mut [f64] {
    field.matrix.as_deref_mut().map_or(&mut [], |matrix| of(matrix).as_flattened_mut())
}

/// Two significant digits, rounded towards zero, so that the value shown passes.
fn digits(value: f64) -> String {
    let places = (1.0 - value.abs().log10().floor()).clamp(0.0, 9.0);
    let scale = 10f64.powf(places);
    format!("{}", (value * scale).trunc() / scale)
}
