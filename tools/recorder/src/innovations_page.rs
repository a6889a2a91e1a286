//! The page of `innovations`: how the machine kept to its model, for a laboratory's notebook.

use ipc_types::{
    Innovation, MODEL_DEPARTURE_SCORE, MODEL_DEPARTURE_SUM, ModelState, ModelStatus, MonitorState,
};
use report::{Colour, Figure, Page, Panels, Table, Tone};

use crate::monitored::Happened;

/// Size of a panel over time, and of one over a variable (CSS pixels).
const OVER_TIME: (u32, u32) = (720, 200);
const OVER_VARIABLE: (u32, u32) = (355, 240);
/// Intervals of a variable over which the innovation is averaged.
const INTERVALS: usize = 24;
/// Rows that an interval must have to be shown.
const LEAST_ROWS: usize = 20;
const MASTER: (Colour, &str) = (Colour::Blue, "master");
const SLAVE: (Colour, &str) = (Colour::Vermillion, "slave");

/// A row of innovations, and how the axis moved then.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RowSeen {
    /// Time since the recording began (s).
    pub(crate) t_s: f64,
    /// Measured position of the master (rad).
    pub(crate) position_rad: f64,
    /// The row.
    pub(crate) row: Innovation,
}

/// What the monitor made of a recording.
#[derive(Debug, Default)]
pub(crate) struct Course {
    /// Rows of innovations of all axes.
    pub(crate) rows: Vec<RowSeen>,
    /// States with the time since the recording began (s).
    pub(crate) states: Vec<(f64, ModelState)>,
    /// What happened.
    pub(crate) events: Vec<Happened>,
    /// The last state of each axis.
    pub(crate) last: Vec<ModelStatus>,
}

/// The whole page; `subtitle` says of what, and `replaced` which programs of others ran.
pub(crate) fn page(course: &Course, replaced: &[String], subtitle: &str) -> Page {
    let mut page = Page::new("Does the machine keep to its model?").subtitle(subtitle);
    let departures = course.events.iter().filter(|event| event.is_departure()).count();
    for line in replaced {
        page = page.verdict(Tone::Warning, line, "");
    }
    for axis in &course.last {
        page = page.verdict(tone(axis, departures), &sentence(axis), "");
    }
    for axis in &course.last {
        page = axis_panels(page, course, axis.axis);
    }
    if !course.events.is_empty() {
        let table = Table::new(["time / s", "axis", "event", "place", "text"]);
        page = page.heading("What happened").table(
            table.rows(course.events.iter().map(Happened::cells)),
            "Time since the recording began.",
        );
    }
    page.heading("What to do next").paragraph(next_step(course)).heading("Method").paragraph(
        "The rig file's model runs beside the recorded samples as an observer that is pulled \
         toward the measured positions. The innovation is measured less modelled position; the \
         declared parameters are followed within their tolerances, so that warming up is no \
         departure. Sum and score are those of docs/live-loop.md.",
    )
}

fn tone(axis: &ModelStatus, departures: usize) -> Tone {
    match axis.state {
        MonitorState::Departed => Tone::Bad,
        MonitorState::Suspicious => Tone::Warning,
        MonitorState::Steady if departures > 0 => Tone::Warning,
        MonitorState::Steady => Tone::Good,
        MonitorState::Learning | MonitorState::Blind => Tone::Neutral,
    }
}

/// The sentence of the status, as one of a text.
fn sentence(axis: &ModelStatus) -> String {
    let own = axis.sentence();
    let mut letters = own.chars();
    let first = letters.next().map_or_else(String::new, |first| first.to_uppercase().to_string());
    format!("{first}{}.", letters.as_str())
}

fn next_step(course: &Course) -> &'static str {
    let is = |state: MonitorState| course.last.iter().any(|axis| axis.state == state);
    if is(MonitorState::Departed) || course.events.iter().any(Happened::is_departure) {
        "The machine is not what the rig file declares. Let farreach identify name the effect and \
         its size from this recording, or from one of the protocol tuning-excitation; mend the \
         machine, or go on with the model that has the effect (farreach identify --write-rig, \
         farreach tune)."
    } else if is(MonitorState::Blind) {
        "This machine cannot be followed by a model beside it; see the reason above. farreach \
         identify works from its recordings."
    } else if is(MonitorState::Learning) {
        "Too little movement to know what is usual: the baseline takes 20 s in which the axis \
         moves."
    } else {
        "Nothing: the machine moved as its model does, within what was usual at the beginning."
    }
}

/// The panels of one axis.
fn axis_panels(page: Page, course: &Course, axis: usize) -> Page {
    let rows: Vec<&RowSeen> =
        course.rows.iter().filter(|seen| usize::from(seen.row.axis) == axis).collect();
    let states: Vec<&(f64, ModelState)> =
        course.states.iter().filter(|(_, state)| usize::from(state.axis) == axis).collect();
    if rows.is_empty() {
        return page;
    }
    let has_slave = rows.iter().any(|seen| seen.row.slave_present == 1);
    let events: Vec<(f64, Colour)> =
        course.events.iter().filter_map(|event| event.mark(axis)).collect();
    let marked = |figure: Figure| {
        events.iter().fold(figure, |figure, (t_s, colour)| figure.vertical(*colour, "", *t_s))
    };
    let time: Vec<f64> = rows.iter().map(|seen| seen.t_s).collect();
    let of = |channel: fn(&Innovation) -> f64| -> Vec<f64> {
        rows.iter().map(|seen| 1e3 * channel(&seen.row)).collect()
    };
    let (master, slave) = (of(|row| row.master), of(|row| row.slave));
    let sides = [(MASTER, &master), (SLAVE, &slave)].into_iter().take(1 + usize::from(has_slave));
    let figure = sides.clone().fold(
        over_time("Measured less modelled position", "innovation / mrad"),
        |figure, ((colour, name), values)| figure.line(colour, name, &time, values),
    );
    let mut panels = Panels::new(format!("Axis {axis}")).panel(marked(figure));
    for figure in of_states(&states, has_slave) {
        panels = panels.panel(marked(figure));
    }
    let mut variables = Panels::new("Over position and velocity").columns(2);
    for (name, variable) in variables_of(&rows) {
        let figure = Figure::new(name, name, "innovation / mrad")
            .size(OVER_VARIABLE.0, OVER_VARIABLE.1)
            .horizontal(Colour::Grey, "", 0.0);
        let figure = sides.clone().fold(figure, |figure, ((colour, name), values)| {
            let [x, mean, deviation] = averaged(&variable, values);
            figure.errors(colour, name, &x, &mean, &deviation)
        });
        variables = variables.panel(figure);
    }
    page.heading(&format!("Axis {axis}"))
        .panels(
            &panels,
            "Innovation as envelope; its amplitude in half seconds of movement over that of the \
             baseline; the cumulative sum and the score, each over the value above which the \
             machine has departed (dashed). Upright: baseline learnt (grey), departure (orange), \
             return (green).",
        )
        .panels(
            &variables,
            "Mean innovation with its standard deviation in intervals of the master's position \
             and velocity: what has a shape here has an effect behind it.",
        )
}

fn over_time(title: &str, ordinate: &str) -> Figure {
    Figure::new(title, "time since the recording began / s", ordinate)
        .size(OVER_TIME.0, OVER_TIME.1)
}

/// Amplitudes over the baseline, and sum and score over their thresholds, once the baseline is
/// known.
fn of_states(states: &[&(f64, ModelState)], has_slave: bool) -> Vec<Figure> {
    let known: Vec<_> = states.iter().filter(|(_, state)| state.learnt >= 1.0).collect();
    if known.is_empty() {
        return Vec::new();
    }
    let time: Vec<f64> = known.iter().map(|(t_s, _)| *t_s).collect();
    let of = |value: fn(&ModelState) -> f64| -> Vec<f64> {
        known.iter().map(|(_, state)| value(state)).collect()
    };
    let mut amplitudes = over_time("Innovation over the usual", "amplitude over baseline")
        .horizontal(Colour::Grey, "", 1.0)
        .line(MASTER.0, MASTER.1, &time, &of(|state| state.master_ratio));
    if has_slave {
        let slave = of(|state| state.slave_ratio);
        amplitudes = amplitudes.line(SLAVE.0, SLAVE.1, &time, &slave);
    }
    let verdicts = over_time("Sum and score", "over the threshold")
        .line(
            Colour::Black,
            "cumulative sum",
            &time,
            &of(|state| state.cusum / MODEL_DEPARTURE_SUM),
        )
        .line(Colour::Sky, "score", &time, &of(|state| state.score / MODEL_DEPARTURE_SCORE))
        .dashed(Colour::Grey, "", &[time[0], time[time.len() - 1]], &[1.0; 2]);
    vec![amplitudes, verdicts]
}

/// Position (°) and velocity (°/s) of the master along the rows; rows at gaps have no velocity.
fn variables_of(rows: &[&RowSeen]) -> [(&'static str, Vec<f64>); 2] {
    let position = rows.iter().map(|seen| seen.position_rad.to_degrees()).collect();
    let slope = |before: &RowSeen, after: &RowSeen| {
        let elapsed = after.t_s - before.t_s;
        let moved = (after.position_rad - before.position_rad).to_degrees();
        if elapsed > 0.0 && elapsed < 0.05 { moved / elapsed } else { f64::NAN }
    };
    let velocity = (0..rows.len())
        .map(|at| slope(rows[at.saturating_sub(1)], rows[(at + 1).min(rows.len() - 1)]))
        .collect();
    [("position / °", position), ("velocity / (°/s)", velocity)]
}

/// Mean and standard deviation of `values` in intervals of `variable`: centres, means, deviations.
fn averaged(variable: &[f64], values: &[f64]) -> [Vec<f64>; 3] {
    let pairs: Vec<(f64, f64)> = variable
        .iter()
        .zip(values)
        .map(|(x, y)| (*x, *y))
        .filter(|(x, y)| x.is_finite() && y.is_finite())
        .collect();
    let low = pairs.iter().map(|(x, _)| *x).fold(f64::INFINITY, f64::min);
    let high = pairs.iter().map(|(x, _)| *x).fold(f64::NEG_INFINITY, f64::max);
    let width = (high - low) / INTERVALS as f64;
    let mut sums = [(0usize, 0.0, 0.0); INTERVALS];
    if width > 0.0 {
        for (x, y) in pairs {
            let own = &mut sums[(((x - low) / width) as usize).min(INTERVALS - 1)];
            *own = (own.0 + 1, own.1 + y, own.2 + y * y);
        }
    }
    let mut averaged = <[Vec<f64>; 3]>::default();
    for (at, (count, sum, squares)) in sums.into_iter().enumerate() {
        if count < LEAST_ROWS {
            continue;
        }
        let mean = sum / count as f64;
        let variance = (squares / count as f64 - mean * mean).max(0.0);
        for (column, value) in
            averaged.iter_mut().zip([low + (at as f64 + 0.5) * width, mean, variance.sqrt()])
        {
            column.push(value);
        }
    }
    averaged
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course() -> Course {
        let row = |at: u32| {
            let t_s = f64::from(at) * 4e-3;
            let position_rad = (6.0 * t_s).sin();
            let row = Innovation {
                master: 1e-3,
                slave: 2e-3 * position_rad,
                slave_present: 1,
                ..Innovation::default()
            };
            RowSeen { t_s, position_rad, row }
        };
        let state = |at: u32| {
            let state = ModelState { learnt: 1.0, cusum: 0.5, score: 2.0, ..ModelState::default() };
            (f64::from(at), state)
        };
        Course {
            rows: (0..5000).map(row).collect(),
            states: (0..20).map(state).collect(),
            ..Course::default()
        }
    }

    #[test]
    fn intervals_have_the_mean_and_the_deviation_of_their_rows() {
        let x: Vec<f64> = (0..2400).map(|at| f64::from(at) / 100.0).collect();
        let y: Vec<f64> = (0..2400).map(|at| f64::from(at / 100) + f64::from(at % 2)).collect();
        let [centres, means, deviations] = averaged(&x, &y);
        assert_eq!(centres.len(), INTERVALS);
        assert!((means[3] - 3.5).abs() < 0.05 && (deviations[3] - 0.5).abs() < 0.05);
        // A variable that does not vary has no intervals.
        assert!(averaged(&[1.0; 50], &[1.0; 50])[0].is_empty());
        assert!(averaged(&[f64::NAN; 50], &[1.0; 50])[0].is_empty());
    }

    #[test]
    fn velocity_is_the_slope_of_the_position_and_unknown_at_gaps() {
        let mut course = course();
        course.rows[2500].t_s += 1.0;
        let rows: Vec<&RowSeen> = course.rows.iter().collect();
        let [(_, position), (_, velocity)] = variables_of(&rows);
        assert!((position[100] - (6.0 * 0.4_f64).sin().to_degrees()).abs() < 1e-9);
        assert!((velocity[100] - 6.0 * (6.0 * 0.4_f64).cos().to_degrees()).abs() < 0.1);
        assert!(velocity[2499].is_nan());
    }

    #[test]
    fn a_page_has_the_course_of_each_axis_and_says_what_to_do() {
        let mut course = course();
        let mut newest = ipc_types::NewestModel::default();
        newest.see_state(&ModelState {
            state: MonitorState::Departed.code(),
            learnt: 1.0,
            ..ModelState::default()
        });
        course.last = newest.status(None, 0);
        let replaced = "replaced: control: /bin/true (from the start)".to_owned();
        let html = page(&course, &[replaced], "run.mcap").render().unwrap();
        assert_eq!(html.matches("<figure").count(), 2);
        for text in [
            "replaced: control: /bin/true",
            "Axis 0: DEPARTED",
            "cumulative sum",
            "farreach identify",
            "velocity / (°/s)",
        ] {
            assert!(html.contains(text), "{text}");
        }
    }

    #[test]
    fn without_an_axis_the_page_says_what_is_missing() {
        let html = page(&Course::default(), &[], "run.mcap").render().unwrap();
        assert!(
            !html.contains("replaced")
                && !html.contains("<svg")
                && html.contains("What to do next")
        );
    }
}
