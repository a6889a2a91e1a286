//! Fig. 4.2's control at work: the torque that a hand must spend to move the handle freely, on the
//! lock-step rig.

use anyhow::Result;
use lock_step::free_movement::{HandEffort, HandleControl, REVERSAL_WINDOW_S, Swing, swing};
use rayon::prelude::*;
use report::Colour::{Black, Vermillion};
use report::{Figure, Panels};
use rig::RigFile;

use super::style::{axes, tall};
use super::{Common, Plot};
use crate::learning::rigs;
use crate::table_row::{Role, Row, short};

/// Frequencies of the movement (Hz); the last is the highest that § 4.2 claims.
const HERTZ: [f64; 4] = [0.5, 1.0, 2.0, 3.0];
/// Places in [`HERTZ`] of the cycles that are drawn.
const PLOTTED: [usize; 2] = [1, 3];

/// A hand or a gain other than in the figure.
struct Case {
    id: &'static str,
    what: &'static str,
    /// Stiffness and damping of the hand (N·m/rad, N·m·s/rad).
    hand: Option<(f64, f64)>,
    /// Times `P₁ v_s` per torque.
    gain: f64,
    /// Offset at all speeds up to the threshold and from there on, before it falls (V).
    offset_v: Option<f64>,
}

/// A case in which nothing is changed.
const PLAIN: Case = Case { id: "", what: "", hand: None, gain: 1.0, offset_v: None };

const CASES: [Case; 5] = [
    Case {
        id: "soft_hand",
        what: "a hand of 5 N·m/rad and 0.2 N·m·s/rad",
        hand: Some((5.0, 0.2)),
        ..PLAIN
    },
    Case {
        id: "stiff_hand",
        what: "a hand of 100 N·m/rad and 1 N·m·s/rad",
        hand: Some((100.0, 1.0)),
        ..PLAIN
    },
    Case {
        id: "sensitivity_twice",
        what: "twice the volts per N·m of the torque cell, which are assumed",
        gain: 2.0,
        ..PLAIN
    },
    Case {
        id: "sensitivity_four_times", what: "four times the volts per N·m", gain: 4.0, ..PLAIN
    },
    Case {
        id: "offset_0.9v",
        what: "an offset of 0.9 V instead of 1.5 and 1.2 V: a little less than friction takes in \
            movement",
        offset_v: Some(0.9),
        ..PLAIN
    },
];

/// One movement: at 0 V, and under force control.
type Pair = [HandEffort; 2];

fn pair(rig: &RigFile, movement: &Swing) -> Result<Pair> {
    Ok([swing(rig, HandleControl::Off, movement)?, swing(rig, HandleControl::Force, movement)?])
}

/// Rig and movement of a case.
fn case(rig: &RigFile, case: &Case, hertz: f64) -> (RigFile, Swing) {
    let mut rig = rig.clone();
    if let Some(force) = &mut rig.axes[0].control.force {
        force.torque_gain *= case.gain;
        if let Some(offset_v) = case.offset_v {
            (force.offset_slow_v, force.offset_fast_v) = (offset_v, offset_v);
        }
    }
    let plain = Swing::of_the_thesis(hertz);
    let (stiffness, damping) = case.hand.unwrap_or((plain.stiffness, plain.damping));
    (rig, Swing { stiffness, damping, ..plain })
}

/// Free movement, as one of the figures.
///
/// # Errors
/// As [`free_movement`].
pub fn movement(_: &Common) -> Result<Plot> {
    free_movement()
}

/// Free movement by a hand that swings the handle; needs nothing that other figures do.
///
/// # Errors
/// Where a built-in rig file is invalid, or a published value is missing from the
/// table.
pub fn free_movement() -> Result<Plot> {
    let rigs = rigs()?;
    let plain =
        rigs.iter().flat_map(|rig| HERTZ.map(|hertz| (rig.clone(), Swing::of_the_thesis(hertz))));
    let changed = CASES.iter().flat_map(|of| PLOTTED.map(|at| case(&rigs[1], of, HERTZ[at])));
    let movements: Vec<(RigFile, Swing)> = plain.chain(changed).collect();
    let pairs: Vec<Pair> =
        movements.par_iter().map(|(rig, movement)| pair(rig, movement)).collect::<Result<_>>()?;
    let (printed, others) = pairs.split_at(HERTZ.len());
    let (traced, cases) = others.split_at(HERTZ.len());
    let panels = Panels::new("Fig. 4.2, free movement under force control")
        .panel(over_frequency("A  Torque of the hand, rms", [printed, traced], |spent| spent.rms))
        .panel(over_frequency("B  Peak-to-peak torque at the turns", [printed, traced], |spent| {
            spent.ripple
        }))
        .panel(cycle("C  Traced line, 1 Hz", &traced[PLOTTED[0]]))
        .panel(cycle("D  Traced line, 3 Hz", &traced[PLOTTED[1]]));
    let caption = caption(traced);
    let mut rows = claims(
        &rigs,
        [printed, traced].map(|pairs| highest_hz(pairs, &rigs[1])),
        [&printed[3][1], &traced[3][1]],
    )?;
    for (at, hertz) in HERTZ.into_iter().enumerate() {
        rows.extend(values(hertz, &printed[at], &traced[at]));
    }
    for (at, [dead, free]) in cases.iter().enumerate() {
        let (case, hertz) = (&CASES[at / PLOTTED.len()], HERTZ[PLOTTED[at % PLOTTED.len()]]);
        for (name, value) in [
            ("uncompensated_hand_torque_rms_nm", dead.rms),
            ("hand_torque_rms_nm", free.rms),
            ("torque_ripple_nm", free.ripple),
        ] {
            let id = format!("own.free.{}.{hertz}hz.{name}", case.id);
            rows.push(Row::own(id, "4.2", "N·m", [None, Some(value)]).note(case.what));
        }
    }
    Ok(Plot { number: "4.2", title: "Free movement under force control", caption, panels, rows })
}

fn caption(traced: &[Pair]) -> String {
    let [slow, fast] = PLOTTED.map(|at| &traced[at]);
    format!(
        "A hand of {} N·m/rad and {} N·m·s/rad (assumed) swings the handle through 120° from end \
            to end, the traced line (full) and the printed constants (dashed), with the motor at 0 \
            V and under the force control of § 4.2. A: the torque that it spends. Force control \
            takes {} of {} N·m away at 1 Hz, where nearly all is friction, but at 3 Hz {} of {} \
            N·m remain (peak {} of {}): they accelerate oil and pistons, of which P1 with the \
            assumed 0.5 V/(N·m) takes a quarter. The claimed 120° at 3 Hz can be moved within the \
            rig's limits, and is work, not free. B: peak-to-peak torque within {:.0} ms of a turn. \
            It grows at slow turns, where the offset has to change its direction and pushes before \
            friction holds. C, D: the torque over one cycle.",
        Swing::of_the_thesis(1.0).stiffness,
        Swing::of_the_thesis(1.0).damping,
        short(slow[0].rms - slow[1].rms),
        short(slow[0].rms),
        short(fast[1].rms),
        short(fast[0].rms),
        short(fast[1].peak),
        short(fast[0].peak),
        1e3 * REVERSAL_WINDOW_S,
    )
}

/// The highest frequency at which the published amplitude is moved within the rig's limits, Hz.
fn highest_hz(pairs: &[Pair], rig: &RigFile) -> Option<f64> {
    let limits = &rig.axes[0].limits;
    let within = |spent: &HandEffort| {
        (spent.amplitude / Swing::of_the_thesis(1.0).amplitude - 1.0).abs() < 0.03
            && spent.speed < limits.speed_max
            && limits.torque_max.is_none_or(|most| spent.peak < most)
    };
    HERTZ
        .iter()
        .zip(pairs)
        .filter(|(_, pair)| within(&pair[1]))
        .map(|(hertz, _)| *hertz)
        .next_back()
}

/// The published gains and the claim, beside what is used and what came of it.
fn claims(
    rigs: &[RigFile; 2],
    hertz: [Option<f64>; 2],
    fastest: [&HandEffort; 2],
) -> Result<Vec<Row>> {
    let gains = rigs.each_ref().map(|rig| {
        let axis = &rig.axes[0];
        axis.control.force.map(|force| (force, axis.master.counts_per_unit))
    });
    type Read = fn(&rig::ForceControl, f64) -> f64;
    let inputs: [(&str, Read); 6] = [
        ("hydrostatic.force_control.beta", |force, _| force.forgetting),
        ("hydrostatic.force_control.p1", |force, _| force.torque_gain),
        ("hydrostatic.force_control.p2_v_s_per_count", |force, counts| force.offset_slope / counts),
        ("hydrostatic.force_control.c_counts_per_s", |force, counts| {
            force.threshold_speed * counts
        }),
        ("hydrostatic.force_control.offset_low_v", |force, _| force.offset_slow_v),
        ("hydrostatic.force_control.offset_high_v", |force, _| force.offset_fast_v),
    ];
    let mut rows = Vec::new();
    for (id, read) in inputs {
        let used = gains.map(|gains| gains.map(|(force, counts)| read(&force, counts)));
        rows.push(Row::beside(id, Role::Input, used)?);
    }
    let way = fastest.map(|spent| Some(2.0 * spent.amplitude.to_degrees()));
    rows.push(
        Row::beside("hydrostatic.force_control.free_movement_deg", Role::Predicted, way)?
            .note("way from end to end at 3 Hz; the hand was asked for 120°"),
    );
    rows.push(
        Row::beside("hydrostatic.force_control.free_movement_hz", Role::Predicted, hertz)?.note(
            "highest frequency of those tried at which the handle goes through 120° within the \
                rig's limits of speed and torque; 3 Hz was the highest tried",
        ),
    );
    Ok(rows)
}

fn values(hertz: f64, printed: &Pair, traced: &Pair) -> Vec<Row> {
    type Read = fn(&HandEffort) -> f64;
    let reads: [(&str, Read); 3] = [
        ("hand_torque_rms_nm", |spent| spent.rms),
        ("hand_torque_peak_nm", |spent| spent.peak),
        ("torque_ripple_nm", |spent| spent.ripple),
    ];
    let mut rows = Vec::with_capacity(2 * reads.len());
    for (machine, before, what) in
        [(1, "", "under force control"), (0, "uncompensated_", "with the motor at 0 V")]
    {
        for (name, read) in reads {
            let id = format!("hydrostatic.free.{hertz}hz.{before}{name}");
            let ours = [printed, traced].map(|pair| Some(read(&pair[machine])));
            let window_ms = 1e3 * REVERSAL_WINDOW_S;
            let how = match name {
                "torque_ripple_nm" => {
                    format!(
                        ", peak to peak within {window_ms:.0} ms of a turn, mean over the turns"
                    )
                }
                _ => String::new(),
            };
            let note = format!("120° from end to end, {what}{how}");
            rows.push(Row::own(id, "4.2", "N·m", ours).note(note));
        }
    }
    rows
}

fn over_frequency(title: &str, pairs: [&[Pair]; 2], read: fn(&HandEffort) -> f64) -> Figure {
    let of = |pairs: &[Pair], machine: usize| {
        pairs.iter().map(|pair| read(&pair[machine])).collect::<Vec<_>>()
    };
    let [printed, traced] = pairs;
    tall(title, "frequency / Hz", "torque / (N·m)")
        .x_range(0.0, 3.2)
        .line(Black, "motor at 0 V", &HERTZ, &of(traced, 0))
        .line(Vermillion, "force control", &HERTZ, &of(traced, 1))
        .dashed(Black, "motor at 0 V, printed constants", &HERTZ, &of(printed, 0))
        .dashed(Vermillion, "force control, printed constants", &HERTZ, &of(printed, 1))
}

fn cycle(title: &str, pair: &Pair) -> Figure {
    let columns = |spent: &HandEffort| -> (Vec<f64>, Vec<f64>) {
        spent.cycle.iter().map(|(time_s, _, torque)| (*time_s, *torque)).unzip()
    };
    let [dead, free] = pair;
    let ((dead_s, dead), (free_s, free)) = (columns(dead), columns(free));
    axes(title, "time / s", "torque of the hand / (N·m)")
        .line(Black, "motor at 0 V", &dead_s, &dead)
        .line(Vermillion, "force control", &free_s, &free)
}
