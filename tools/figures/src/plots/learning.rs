//! Fig. 4.5 to 4.7: iterative learning on the lock-step rig.

use anyhow::{Context as _, Result};
use lock_step::guided::Quality;
use lock_step::ilc::{HARMONICS, IlcTask, PUBLISHED, Trace};
use report::Colour::{Black, Blue, Grey, Sky, Vermillion};
use report::{Figure, Panels};

use super::style::{axes, tall};
use super::{Common, Plot, degrees};
use crate::learning::{BLOCKS, Course, GOAL_DEG, Learning, MIDDLE};
use crate::table_row::{Role, Row, short};

/// Slower than this a side counts as standing (°/s): a tenth of the desired movement's peak.
fn standing_deg_s(task: &IlcTask) -> f64 {
    0.1 * std::f64::consts::TAU * task.hertz * task.amplitude.to_degrees()
}

fn task() -> IlcTask {
    IlcTask::of_the_thesis(learning::LearningLaw::Published(PUBLISHED))
}

/// Share of a cycle in which master and slave both move, in opposite directions (%).
fn opposite_percent(cycle: &Trace, standing_deg_s: f64) -> Option<f64> {
    let pairs = cycle.master_velocity.iter().zip(&cycle.slave_velocity);
    let opposite = pairs
        .filter(|(master, slave)| {
            master.to_degrees().abs().min(slave.to_degrees().abs()) > standing_deg_s
                && *master * *slave < 0.0
        })
        .count();
    (!cycle.master_velocity.is_empty())
        .then(|| 100.0 * opposite as f64 / cycle.master_velocity.len() as f64)
}

/// Fig. 4.5.
///
/// # Errors
/// None; the type is that of all figures.
pub fn monotonicity(common: &Common) -> Result<Plot> {
    let panel = |title: &str, course: &Course, until_s: f64| {
        let within = course.cycles[1].time_s.iter().take_while(|time_s| **time_s <= until_s);
        let cycle = course.cycles[1].part(0..within.count());
        axes(title, "time / s", "velocity / (°/s)")
            .line(Black, "master", &cycle.time_s, &degrees(&cycle.master_velocity))
            .dashed(Vermillion, "slave", &cycle.time_s, &degrees(&cycle.slave_velocity))
    };
    let [printed, traced] = &common.learning.published;
    let standing = standing_deg_s(&task());
    let [in_printed, in_traced] =
        [printed, traced].map(|course| opposite_percent(&course.cycles[1], standing));
    let panels = Panels::new("Fig. 4.5, master and slave velocity during learning")
        .panel(panel("A  Traced line", traced, 1.0))
        .panel(panel("B  Printed constants, first 0.2 s", printed, 0.2));
    let caption = format!(
        "Velocity of master (full) and slave (dashed) over the last cycle of block {MIDDLE}, in \
            the middle of the learning of fig. 4.6. The thesis's never have opposite signs. Ours \
            have, both sides being faster than {standing:.0} °/s, for {} % of the cycle with the \
            traced line: it is monotonic as stated, though the slave goes in steps, each broken \
            loose by a line that has been wound up. With the printed, 14 times stiffer line it is \
            {} %: there the feedback of § 4.1 is near its limit, and the line's own mode of about \
            70 Hz is seen.",
        short(in_traced),
        short(in_printed),
    );
    let id = "own.ilc.opposite_velocities_percent";
    let rows = vec![Row::own(id, "4.5", "%", [in_printed, in_traced]).note(format!(
        "share of the last cycle of block {MIDDLE} in which master and slave move in opposite \
            directions, both faster than {standing:.0} °/s"
    ))];
    Ok(Plot { number: "4.5", title: "Monotonicity of the transmission", caption, panels, rows })
}

/// Fig. 4.6.
///
/// # Errors
/// Where a published value is missing from the table.
pub fn learning(common: &Common) -> Result<Plot> {
    let learning = &common.learning;
    let task = task();
    let panels = Panels::new("Fig. 4.6, iterative learning")
        .panel(slave(&learning.published[1]))
        .panel(master(&learning.published[1]))
        .panel(errors(learning));
    let first = learning.published.each_ref().map(Course::first_deg);
    let last = learning.published.each_ref().map(Course::last_deg);
    let blocks = learning.published.each_ref().map(Course::blocks_to_goal);
    let by_model = learning.model_based.each_ref().map(Course::blocks_to_goal);
    let identification_s = 3.0 * HARMONICS as f64 / task.hertz;
    let amplitude = task.amplitude.to_degrees();
    let caption = format!(
        "Learning of a sine of 1 Hz and ±{amplitude:.0}°, traced line, nobody at the handle, the \
            master under the feedback of § 4.1 alone. Printed are blocks of 3 s and the delay; \
            amplitude, γp = {}, γd = {} and the filter's cut-off of {} Hz are ours. A: slave, and \
            master with its reference, over the last cycle of a block. The feedback takes 30° of \
            error to overcome the motor's 1.5 V of friction, so in block 1 nothing moves and the \
            error is the sine's own mean, {}° (published: about 11°); the reference grows until \
            the slave follows, in steps of stick and slip, which learning does not take away. B: \
            mean magnitude of the slave's error over each block. The published law comes to 1° in \
            block {} (published: 83), the model-based law in block {}, after {identification_s:.0} \
            s in which the response is identified at {HARMONICS} harmonics. With the printed, 14 \
            times stiffer line (fig. 4.5B) the published law comes to 1° {}, the model-based law \
            {}.",
        PUBLISHED.gamma_p,
        PUBLISHED.gamma_d,
        PUBLISHED.cutoff_hz,
        short(first[1]),
        short(blocks[1]),
        short(by_model[1]),
        within(blocks[0]),
        within(by_model[0]),
    );
    Ok(Plot {
        number: "4.6",
        title: "Iterative learning of a movement",
        caption,
        panels,
        rows: rows(learning, &task, [first, last, blocks, by_model])?,
    })
}

/// The case of the learning study that begins with the control of § 4.1 as fig. 4.7 does,
/// feed-forward and all.
const WITH_FEEDFORWARD: &str = "feedforward_30deg";

/// Fig. 4.7.
///
/// # Errors
/// None; the type is that of all figures.
pub fn before_and_after(common: &Common) -> Result<Plot> {
    let case = common.learning.case(WITH_FEEDFORWARD).with_context(|| {
        format!("no case `{WITH_FEEDFORWARD}` in the learning study; fig. 4.7 must name one of it")
    })?;
    let course = &case.published;
    let [before, _, after] = &course.cycles;
    let quality = [before, after].map(Quality::of);
    let slave = tall("A  Slave", "time / s", "position / °")
        .dashed(Black, "desired", &after.time_s, &degrees(&after.desired))
        .line(Grey, "before learning", &before.time_s, &degrees(&before.slave))
        .line(Vermillion, "after learning", &after.time_s, &degrees(&after.slave));
    let master = tall("B  Master", "time / s", "position / °")
        .dashed(Black, "desired of the slave", &after.time_s, &degrees(&after.desired))
        .line(Grey, "before learning", &before.time_s, &degrees(&before.master))
        .line(Blue, "after learning", &after.time_s, &degrees(&after.master));
    let panels =
        Panels::new("Fig. 4.7, movement before and after learning").panel(slave).panel(master);
    let of =
        |read: fn(&Quality) -> f64| quality.map(|quality| quality.map(|quality| read(&quality)));
    let (error, plateau) =
        (of(|quality| quality.slave_error.to_degrees()), of(|quality| quality.plateau_s));
    let highest = |values: &[f64]| values.iter().copied().fold(f64::NAN, f64::max).to_degrees();
    let peaks = [highest(&before.master), highest(&after.master)];
    let caption = format!(
        "Slave (A) and master (B) over one cycle of 1 Hz and ±30°, traced line, nobody at the \
            handle: under the control of § 4.1 with its feed-forward, and with the reference that \
            the published law learnt in {BLOCKS} blocks on top of it. The slave\'s error falls \
            from {}° to {}° (root mean square); its longest stand from {:.0} to {:.0} ms, as the \
            master goes further before it turns: {:.0}° in place of {:.0}°. The thesis, too, finds \
            the sticking at the peaks reduced, not gone, and a master that learns a higher peak.",
        short(error[0]),
        short(error[1]),
        1e3 * plateau[0].unwrap_or(f64::NAN),
        1e3 * plateau[1].unwrap_or(f64::NAN),
        peaks[1],
        peaks[0],
    );
    let peaks = peaks.map(Some);
    let again = "the same with the learnt reference";
    let rows = [
        ("error_before_deg", "°", error[0], "root mean square of the slave's error under § 4.1"),
        ("error_after_deg", "°", error[1], again),
        (
            "plateau_before_s",
            "s",
            plateau[0],
            "longest time for which the slave stands still under § 4.1",
        ),
        ("plateau_after_s", "s", plateau[1], again),
        ("master_peak_before_deg", "°", peaks[0], "highest position of the master under § 4.1"),
        ("master_peak_after_deg", "°", peaks[1], again),
    ]
    .map(|(name, unit, value, note)| {
        Row::own(format!("own.before_after.{name}"), "4.7", unit, [None, value]).note(note)
    })
    .to_vec();
    Ok(Plot { number: "4.7", title: "Movement before and after learning", caption, panels, rows })
}

fn slave(course: &Course) -> Figure {
    let [before, middle, after] = &course.cycles;
    tall("A  Slave", "time / s", "position / °")
        .dashed(Black, "desired", &after.time_s, &degrees(&after.desired))
        .line(Grey, "block 1", &before.time_s, &degrees(&before.slave))
        .line(Sky, format!("block {MIDDLE}"), &middle.time_s, &degrees(&middle.slave))
        .line(Vermillion, format!("block {BLOCKS}"), &after.time_s, &degrees(&after.slave))
}

fn master(course: &Course) -> Figure {
    let [before, _, after] = &course.cycles;
    let reference = format!("reference, block {BLOCKS}");
    tall("A  Master", "time / s", "position / °")
        .dashed(Black, "reference, block 1", &before.time_s, &degrees(&before.reference))
        .dashed(Blue, reference, &after.time_s, &degrees(&after.reference))
        .line(Blue, format!("master, block {BLOCKS}"), &after.time_s, &degrees(&after.master))
}

fn errors(learning: &Learning) -> Figure {
    let curve = |course: &Course| {
        let blocks = (1..=course.errors_deg.len()).map(|block| block as f64);
        (blocks.collect::<Vec<_>>(), course.errors_deg.clone())
    };
    let [(printed_x, printed), (traced_x, traced)] = learning.published.each_ref().map(curve);
    let (by_model_x, by_model) = curve(&learning.model_based[1]);
    tall("B  Error of the slave", "block of 3 s", "mean magnitude / °")
        .x_range(0.0, 90.0)
        .y_range(0.0, 14.0)
        .line(Vermillion, "published law", &traced_x, &traced)
        .line(Blue, "model-based law", &by_model_x, &by_model)
        .dashed(Vermillion, "published law, printed constants", &printed_x, &printed)
        .horizontal(Grey, "1°", GOAL_DEG)
}

fn rows(
    learning: &Learning,
    task: &IlcTask,
    [first, last, blocks, by_model]: [[Option<f64>; 2]; 4],
) -> Result<Vec<Row>> {
    let both = |value: f64| [Some(value); 2];
    let amplitude = task.amplitude.to_degrees();
    let block_s = task.cycles_per_block as f64 / task.hertz;
    let delay = PUBLISHED.delay_samples(2000.0) as f64;
    let beside = Row::beside;
    let own = |id: String, unit, ours: [Option<f64>; 2]| Row::own(id, "4.6", unit, ours);
    let mut rows = vec![
        beside("hydrostatic.ilc.block_s", Role::Input, both(block_s))?,
        beside("hydrostatic.ilc.delay_samples_2khz", Role::Input, both(delay))?,
    ];
    rows.extend(
        [
            ("amplitude_deg", "°", amplitude),
            ("gamma_p", "1", PUBLISHED.gamma_p),
            ("gamma_d", "1", PUBLISHED.gamma_d),
            ("cutoff_hz", "Hz", PUBLISHED.cutoff_hz),
        ]
        .map(|(name, unit, value)| {
            let row = own(format!("own.ilc.{name}"), unit, both(value));
            row.role(Role::Input).note("not printed")
        }),
    );
    rows.extend([
        beside("hydrostatic.ilc.initial_error_deg", Role::Predicted, first)?.note(format!(
            "mean magnitude over block 1, ±{amplitude:.0}°, feedback alone: friction holds the \
                master, so it is 2/π of the amplitude"
        )),
        beside("hydrostatic.ilc.final_error_deg", Role::Predicted, last)?
            .note(format!("mean magnitude over block {BLOCKS}")),
        beside("hydrostatic.ilc.blocks", Role::Predicted, blocks)?
            .note("first block with a mean magnitude of 1° or less"),
        own("hydrostatic.ilc.model_based_blocks".to_owned(), "1", by_model).note(format!(
            "first block with 1° or less under the model-based law, none within {}; {:.0} s of \
                identification come before",
            learning.model_based[0].errors_deg.len(),
            3.0 * HARMONICS as f64 / task.hertz,
        )),
    ]);
    for case in &learning.cases {
        let course = &case.published;
        let mut values = vec![
            ("initial_error_deg", "°", course.first_deg()),
            ("final_error_deg", "°", course.last_deg()),
            ("blocks", "1", course.blocks_to_goal()),
        ];
        if let Some(by_model) = &case.model_based {
            values.push(("model_based_blocks", "1", by_model.blocks_to_goal()));
        }
        for (name, unit, value) in values {
            let row = own(format!("own.ilc.{}.{name}", case.id), unit, [None, value]);
            rows.push(row.note(case.what));
        }
    }
    Ok(rows)
}

/// In which block the goal was met, in words.
fn within(blocks: Option<f64>) -> String {
    blocks.map_or_else(|| "never".to_owned(), |block| format!("in block {block:.0}"))
}
