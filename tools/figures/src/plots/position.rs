//! Fig. 4.1 and 4.3: position control on the lock-step rig.

use anyhow::Result;
use control::law::force_law::offset_v;
use lock_step::ilc::Trace;
use report::Colour::{Black, Blue, Grey, Vermillion};
use report::{Figure, Panels};

use super::style::{axes, tall};
use super::{Common, Plot, degrees};
use crate::guided::{AMPLITUDE_DEG, FIGURE_HZ, Guided, LawKind};
use crate::learning::rigs;
use crate::table_row::{Row, short};

/// The first `cycles` of a law's movement; nothing where there is none.
fn movement_of(guided: &Guided, law: LawKind, hertz: f64, cycles: f64) -> Trace {
    let Some(cell) = guided.cell(law, hertz) else { return Trace::default() };
    let time_s = &cell.trace.time_s;
    let steps = time_s.iter().take_while(|time_s| **time_s < cycles / hertz - 1e-6).count();
    cell.trace.part(0..steps)
}

/// Fig. 4.1.
///
/// # Errors
/// None; the type is that of all figures.
pub fn movement(common: &Common) -> Result<Plot> {
    let guided = &common.guided;
    let panel = |title: &str, hertz: f64| {
        let trace = movement_of(guided, LawKind::Printed, hertz, 1.0);
        tall(title, "time / s", "position / °")
            .y_range(-60.0, 60.0)
            .dashed(Grey, "desired", &trace.time_s, &degrees(&trace.desired))
            .line(Black, "master", &trace.time_s, &degrees(&trace.master))
            .line(Vermillion, "slave", &trace.time_s, &degrees(&trace.slave))
    };
    let panels = Panels::new("Fig. 4.1, movement under position control")
        .panel(panel("A  0.2 Hz", 0.2))
        .panel(panel("B  1 Hz", 1.0))
        .panel(panel("C  3 Hz", 3.0));
    let of = |hertz, read: fn(&lock_step::guided::Quality) -> f64| {
        guided
            .cell(LawKind::Printed, hertz)
            .and_then(|cell| cell.quality)
            .map(|quality| read(&quality))
    };
    let plateau = |hertz| of(hertz, |quality| quality.plateau_s);
    let caption = format!(
        "Master and slave under the position control of § 4.1 (printed gains and feed-forward), \
            one settled cycle of ±{AMPLITUDE_DEG:.0}°, traced line, nobody at the handle. As in \
            the thesis the slave is cut off at the peaks, where friction holds it: it stands for \
            up to {:.0}, {:.0} and {:.0} ms at 0.2, 1 and 3 Hz. Unlike there, slow movements go in \
            steps: friction that falls with speed breaks the slave loose again and again. Its \
            stroke is smaller by the ratio of the pistons, 0.854.",
        1e3 * plateau(0.2).unwrap_or(f64::NAN),
        1e3 * plateau(1.0).unwrap_or(f64::NAN),
        1e3 * plateau(3.0).unwrap_or(f64::NAN),
    );
    let error = of(1.0, |quality| quality.slave_error.to_degrees());
    let rows = vec![
        Row::own("own.position_control.slave_error_1hz_deg", "4.1", "°", [None, error]).note(
            "root mean square, § 4.1 as printed; the table of guided movement has the other laws \
                and frequencies",
        ),
        Row::own("own.position_control.plateau_1hz_s", "4.1", "s", [None, plateau(1.0)])
            .note("longest time for which the slave stands still, § 4.1 as printed"),
    ];
    Ok(Plot { number: "4.1", title: "Movement under position control", caption, panels, rows })
}

/// Fig. 4.3.
///
/// # Errors
/// Where the built-in rig file is invalid.
pub fn feedforward(common: &Common) -> Result<Plot> {
    let [_, rig] = rigs()?;
    let control = &rig.axes[0].control;
    let [none, printed, identified] = [LawKind::Feedback, LawKind::Printed, LawKind::Identified]
        .map(|law| movement_of(&common.guided, law, FIGURE_HZ, 1.0));
    let omega = std::f64::consts::TAU * FIGURE_HZ;
    let inertia: Vec<f64> = printed
        .desired
        .iter()
        .map(|desired| -omega * omega * desired * control.feedforward.inertia_v)
        .collect();
    let curve = tall("A  Feed-forward", "time / s", "volts / V")
        .line(Black, "printed: sine and triangle", &printed.time_s, &printed.feedforward)
        .dashed(Grey, "its sine, against inertia", &printed.time_s, &inertia)
        .line(Blue, "identified model", &identified.time_s, &identified.feedforward);
    let panels = Panels::new("Fig. 4.3, feed-forward and friction compensation")
        .panel(curve)
        .panel(offset(control.force.as_ref()))
        .panel(effect([&none, &printed, &identified]));
    let error = |law| {
        let cell = common.guided.cell(law, FIGURE_HZ)?;
        cell.quality.map(|quality| quality.master_error.to_degrees())
    };
    let errors = [LawKind::Feedback, LawKind::Printed, LawKind::Identified].map(error);
    let caption = format!(
        "A: feed-forward of position control along a sine of {FIGURE_HZ:.0} Hz and \
            ±{AMPLITUDE_DEG:.0}°, as control put it out: the printed sum of a sine against inertia \
            and a triangle against friction, highest where the movement turns ({:.1} V, {:.1} V at \
            mid-movement), and the one from the identified model, in which what rubs beyond the \
            line changes its sign only as the line is wound up the other way. B: friction \
            compensation of force control over velocity (eq. 4.2.3), which changes sign with the \
            torque. C: effect of A on the master\'s error; root mean square {}° without, {}° with \
            the printed and {}° with the identified one. Traced line, nobody at the handle.",
        control.feedforward.friction_peak_v,
        control.feedforward.friction_floor_v,
        short(errors[0]),
        short(errors[1]),
        short(errors[2]),
    );
    let rows = [
        "own.feedforward.master_error_without_deg",
        "own.feedforward.master_error_printed_deg",
        "own.feedforward.master_error_identified_deg",
    ]
    .into_iter()
    .zip(errors)
    .map(|(id, error)| Row::own(id, "4.3", "°", [None, error]).note("root mean square at 1 Hz"))
    .collect();
    Ok(Plot {
        number: "4.3",
        title: "Feed-forward and friction compensation",
        caption,
        panels,
        rows,
    })
}

/// Eq. 4.2.3 over velocity, up to the peak speed of 3 Hz and ±60°.
fn offset(force: Option<&rig::ForceControl>) -> Figure {
    let figure = axes("B  Friction compensation, eq. 4.2.3", "velocity / (°/s)", "magnitude / V")
        .y_range(0.0, 1.8);
    let Some(force) = force else { return figure };
    let velocity: Vec<f64> = (-300..=300).map(|step| 0.06 * f64::from(step)).collect();
    let volts: Vec<f64> = velocity.iter().map(|velocity| offset_v(force, *velocity)).collect();
    figure.line(Black, "offset", &degrees(&velocity), &volts)
}

fn effect([none, printed, identified]: [&Trace; 3]) -> Figure {
    let error = |trace: &Trace| -> Vec<f64> {
        trace
            .desired
            .iter()
            .zip(&trace.master)
            .map(|(desired, master)| (desired - master).to_degrees())
            .collect()
    };
    tall("C  Error of the master", "time / s", "error / °")
        .line(Grey, "feedback alone", &none.time_s, &error(none))
        .line(Black, "with printed feed-forward", &printed.time_s, &error(printed))
        .line(Blue, "with identified model", &identified.time_s, &error(identified))
}
