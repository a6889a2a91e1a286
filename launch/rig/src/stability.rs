//! Holds gains and force fields against the declared transmission: [`plant::stability`], fed from
//! the rig file.
//!
//! A model that is no transmission says nothing about stability, and nothing is refused for it.

use plant::stability::{self, Hand, Law, Loop, MARGIN, Machine, RELAXED, Sampling, Unstable};

use crate::axis::Axis;
use crate::force::ACCELERATION_HZ;
use crate::protocol::{Field, Matrix};
use crate::read::Source;
use crate::rig_file::RigFile;

/// Scans from the one that control sees to the one with which its answer is at the motor: through
/// control and the gate.
const ANSWER_SCANS: f64 = 2.0;
/// Halvings in the search for what would still do.
const HALVINGS: usize = 14;

/// An axis under a law; `None` where the model is no transmission.
fn closed(rig: &RigFile, axis: &Axis, law: Law) -> Option<Loop> {
    let parameters = rig.control_parameters(axis).ok()?;
    Some(Loop {
        machine: Machine::new(&parameters, axis.limits.speed_max),
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

/// The force control of an axis; `None` where it has none, or where the model is no transmission.
fn forced(rig: &RigFile, axis: &Axis) -> Option<Loop> {
    let force = axis.control.force?;
    let (gain, share) = (force.volts_per_hand_torque(), force.share(period_s(rig)));
    closed(rig, axis, Law::Force { gain, share, by_slave: axis.slave.is_some() })
}

/// Refuses gains under which the declared transmission would not stay where it is put.
pub(crate) fn check_gains(rig: &RigFile, source: &Source<'_>) {
    let none = stability::Field::default();
    for (at, axis) in rig.axes.iter().enumerate().filter(|(_, axis)| !axis.control.accept_unstable)
    {
        let key = |name: &str| format!("axes.{at}.control.{name}");
        let counts = axis.master.counts_per_unit;
        let position = |share: f64| {
            let (proportional, derivative) =
                (share * axis.control.position_gain, share * axis.control.velocity_gain);
            closed(rig, axis, Law::Position { proportional, derivative })
        };
        let passes =
            |axis: Option<Loop>| axis.is_none_or(|axis| stability::check(&[axis], &none).is_ok());
        if let Some(Err(unstable)) = position(1.0).map(|axis| stability::check(&[axis], &none)) {
            let share = largest(|share| passes(position(share)));
            let (p, d) = (axis.control.position_gain / counts, axis.control.velocity_gain / counts);
            let expected = format!(
                "gains that the declared transmission bears with a margin of {MARGIN}: with this ratio of D to P, P of at most {:.2e}",
                share * p
            );
            let found =
                format!("{p:.2e} V/count with D of {d:.2e} V·s/count: {}", growing(&unstable));
            source.problem(
                &key("p_v_per_count"),
                expected,
                found,
                "lower the gains, or set accept_unstable = true for a model that is known to be wrong there",
            );
        }
        let force = |share: f64| {
            let mut scaled = axis.clone();
            if let Some(force) = &mut scaled.control.force {
                force.torque_gain *= share;
            }
            forced(rig, &scaled)
        };
        if let (Some(Err(unstable)), Some(gains)) =
            (force(1.0).map(|axis| stability::check(&[axis], &none)), axis.control.force)
        {
            let share = largest(|share| passes(force(share)));
            let expected = format!(
                "a gain that the declared transmission bears with a margin of {MARGIN}: at most {:.3} V/V",
                share * gains.torque_gain
            );
            let found = format!("{}: {}", gains.torque_gain, growing(&unstable));
            source.problem(&key("force.p1"), expected, found, "lower p1, or forget more slowly");
        }
    }
}

/// Refuses a force field under which a rig would not stay stable; false where it is refused.
pub(crate) fn check_field(
    field: &Field,
    index: usize,
    rig: &RigFile,
    key: impl Fn(&str) -> String,
    source: &Source<'_>,
) -> bool {
    let Err(unstable) = field_passes(field, index, rig) else { return true };
    let parts: Vec<_> =
        PARTS.iter().filter(|part| part.keys.iter().any(|name| source.has(&key(name)))).collect();
    let without = |part: &Part, share: f64| {
        let mut scaled = field.clone();
        (part.scale)(&mut scaled, share);
        scaled
    };
    let one = parts.iter().find(|part| field_passes(&without(part, 0.0), index, rig).is_ok());
    let scaled = |share: f64| match one {
        Some(part) => without(part, share),
        None => parts.iter().fold(field.clone(), |mut field, part| {
            (part.scale)(&mut field, share);
            field
        }),
    };
    let share = largest(|share| field_passes(&scaled(share), index, rig).is_ok());
    let part = one.or(parts.first());
    let name = part
        .and_then(|part| part.keys.iter().find(|name| source.has(&key(name))))
        .unwrap_or(&"kind");
    let value = part.and_then(|part| (part.value)(field)).filter(|_| one.is_some());
    let (most, found) = match (value, part) {
        (Some(value), Some(part)) => {
            (format!("{} {}", digits(share * value), part.unit), format!("{value} {}", part.unit))
        }
        _ => (format!("{:.0} % of this", 100.0 * share), "this field".to_owned()),
    };
    let word = if value.is_some_and(|value| value < 0.0) { "at least" } else { "at most" };
    let expected = format!(
        "{word} {most} at the rig \"{}\", with a margin of {MARGIN} on its gains",
        rig.name
    );
    let (found, advice) = match unstable {
        Refused::Grows(unstable) => (
            format!("{found}: {}", growing(&unstable)),
            "a field passes where nothing grows for any hand from none to 50 N·m/rad; soften it",
        ),
        Refused::Leaves { torque, most } => (
            format!(
                "{found}: {torque:.2} N·m (or N) outwards at the end of the axis, where a relaxed hand and the soft stop hold {most:.2}"
            ),
            "a field that drives away must be held within the limits; weaken it, or raise end_stop_stiffness in the rig file",
        ),
    };
    source.problem(&key(name), expected, found, advice);
    false
}

/// Why a field is refused.
enum Refused {
    /// A disturbance would grow.
    Grows(Unstable),
    /// It would drive the handle through the soft stops (N·m or N).
    Leaves { torque: f64, most: f64 },
}

/// Holds a field against a rig: every mix of its extremes on its own axis, with its matrices.
fn field_passes(field: &Field, index: usize, rig: &RigFile) -> Result<(), Refused> {
    let wide = field.matrix.as_ref().map_or(0, |matrix| matrix.axes);
    // Axes that the field does not couple are stable or not by themselves.
    let used: Vec<usize> = if wide == 0 { vec![index] } else { (0..wide.max(index + 1)).collect() };
    let Some(axes) =
        used.iter().map(|at| forced(rig, rig.axes.get(*at)?)).collect::<Option<Vec<Loop>>>()
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

/// Whether a relaxed hand and the soft stops hold a field that diverges, at both ends of an axis.
fn held_at_the_ends(
    field: &Field,
    matrix: &Matrix,
    at: usize,
    own: bool,
    rig: &RigFile,
) -> Result<(), Refused> {
    let Some(axis) = rig.axes.get(at) else { return Ok(()) };
    let Some(force) = axis.control.force else { return Ok(()) };
    for (end, outwards) in [(axis.limits.position_min, -1.0), (axis.limits.position_max, 1.0)] {
        let alone = if own { field.torque(end) } else { 0.0 };
        let torque = outwards * (alone - matrix.stiffness[at][at] * (end - matrix.centres[at]));
        let most = RELAXED.stiffness * end.abs() + force.end_stop_stiffness * force.end_stop_way;
        if torque > most {
            return Err(Refused::Leaves { torque, most });
        }
    }
    Ok(())
}

/// One thing that a segment asks for, under one of some keys.
struct Part {
    keys: &'static [&'static str],
    unit: &'static str,
    /// Its value, where it is one number.
    value: fn(&Field) -> Option<f64>,
    scale: fn(&mut Field, f64),
}

const PARTS: &[Part] = &[
    Part {
        keys: &["damper"],
        unit: "N·m·s/rad",
        value: |field| Some(field.damping),
        scale: |field, share| field.damping *= share,
    },
    Part {
        keys: &["inertia"],
        unit: "kg·m²",
        value: |field| Some(field.inertia),
        scale: |field, share| field.inertia *= share,
    },
    Part {
        keys: &["spring"],
        unit: "N·m/rad",
        value: |field| Some(field.stiffness),
        scale: |field, share| field.stiffness *= share,
    },
    Part {
        keys: &["wall_stiffness", "wall_min_deg", "wall_min_m"],
        unit: "N·m/rad",
        value: |field| Some(field.wall_stiffness),
        scale: |field, share| field.wall_stiffness *= share,
    },
    Part {
        keys: &["velocity_table_deg_s", "velocity_table_m_s"],
        unit: "",
        value: |_| None,
        scale: |field, share| {
            if let Some(table) = &mut field.velocity_table {
                table.torques.iter_mut().for_each(|torque| *torque *= share);
            }
        },
    },
    Part {
        keys: &["position_table_deg", "position_table_m"],
        unit: "",
        value: |_| None,
        scale: |field, share| {
            if let Some(table) = &mut field.position_table {
                table.torques.iter_mut().for_each(|torque| *torque *= share);
            }
        },
    },
    Part {
        keys: &["curl", "matrix_damping"],
        unit: "",
        value: |_| None,
        scale: |field, share| {
            if let Some(matrix) = &mut field.matrix {
                matrix.damping.iter_mut().flatten().for_each(|entry| *entry *= share);
            }
        },
    },
    Part {
        keys: &["matrix_stiffness"],
        unit: "",
        value: |_| None,
        scale: |field, share| {
            if let Some(matrix) = &mut field.matrix {
                matrix.stiffness.iter_mut().flatten().for_each(|entry| *entry *= share);
            }
        },
    },
    Part {
        keys: &["matrix_inertia"],
        unit: "",
        value: |_| None,
        scale: |field, share| {
            if let Some(matrix) = &mut field.matrix {
                matrix.inertia.iter_mut().flatten().for_each(|entry| *entry *= share);
            }
        },
    },
];

/// The largest share (0 to 1) that passes, where all below it do.
fn largest(passes: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if passes(middle) { low = middle } else { high = middle }
    }
    low
}

/// Two digits, towards zero, so that what is named passes.
fn digits(value: f64) -> String {
    let places = (1.0 - value.abs().log10().floor()).clamp(0.0, 9.0);
    let scale = 10f64.powf(places);
    format!("{}", (value * scale).trunc() / scale)
}

fn growing(unstable: &Unstable) -> String {
    let Unstable { hand, raised, growth } = unstable;
    let with = match hand {
        Hand { stiffness: 0.0, .. } => "nobody at the handle".to_owned(),
        Hand { stiffness, .. } => format!("a hand of {stiffness} N·m/rad"),
    };
    let gains =
        if *raised > 1.0 { format!(" and gains {raised} times as high") } else { String::new() };
    format!("with {with}{gains} a disturbance grows by {growth:.1}/s")
}
