//! The page of a trend.

use report::{Colour, Figure, Page, Panels, Table, Tone};

use super::quantity::Movement;
use super::result::{
    DAYS_PER_MONTH, FALSE_ALARM, ParameterTrend, RecordingEntry, Told, Trend, Verdict,
};
use super::text;

/// Size of a panel (CSS pixels): two beside each other fill the page's width.
const PANEL: (u32, u32) = (340, 220);
const SECONDS_PER_DAY: f64 = 86_400.0;

/// The whole page; `began_s` are the recordings' calendar times, where they have some.
pub(super) fn page(trend: &Trend, rig_file: &str, began_s: &[Option<f64>]) -> Page {
    let tone = match trend.verdict {
        Verdict::Same => Tone::Good,
        Verdict::Changed => Tone::Warning,
        Verdict::Outside => Tone::Bad,
        Verdict::Unknown => Tone::Neutral,
    };
    let mut page = Page::new("Is it still the same machine?")
        .subtitle(&subtitle(trend, rig_file))
        .verdict(tone, &trend.sentence, "");
    for detail in &trend.details {
        page = page.paragraph(detail);
    }
    let times: Vec<f64> = match began_s.iter().copied().collect::<Option<Vec<f64>>>() {
        Some(times) if trend.dated => times,
        _ => (1..=trend.recordings.len()).map(|number| number as f64).collect(),
    };
    let (moved, rest): (Vec<_>, Vec<_>) = trend.told().partition(|own| own.has_changed());
    let mut panels = Panels::new("Parameters over the recordings").columns(2);
    for parameter in moved.into_iter().chain(rest) {
        panels = panels.panel(panel(trend, parameter, &times));
    }
    if panels.count() > 0 {
        page = page.heading("Parameters over the recordings").panels(&panels, CAPTION);
    }
    let rows = trend.told().map(text::row);
    page = page.heading("Parameters").table(
        Table::new(text::header(trend)).rows(rows),
        "Declared value with its tolerance, weighted mean over all recordings, value at the last \
         recording (the mean since the last change, or the end of the drift), weighted linear \
         drift; ± is one standard deviation, which includes how far the recordings scatter.",
    );
    if let Some(untold) = text::untold(trend) {
        page = page.paragraph(&untold);
    }
    page = page.heading("Recordings").table(recordings(trend), &recordings_caption(trend));
    if !trend.left_out.is_empty() {
        let rows = trend.left_out.iter().map(|own| [own.file.clone(), own.reason.clone()]);
        page = page
            .table(Table::new(["left out", "reason"]).rows(rows), "Recordings that take no part.");
    }
    page.heading("Method").paragraph(&method(trend))
}

const CAPTION: &str = "Each point is one recording, identified by itself, with one standard \
                       deviation. Shaded: the tolerance of the rig file, around the declared value \
                       (dashed). Blue: mean between changes, or drift. Upright: changes. Orange \
                       points are at the bound of the tolerance, where the machine may be beyond. \
                       Parameters that have changed come first.";

fn subtitle(trend: &Trend, rig_file: &str) -> String {
    let (first, last) = (trend.recordings.first(), trend.recordings.last());
    let date = |of: Option<&RecordingEntry>| {
        of.and_then(|own| own.began.as_ref()?.split(' ').next().map(str::to_owned))
    };
    let when = match (date(first), date(last)) {
        (Some(first), Some(last)) => format!("from {first} to {last}"),
        _ => "without dates, in the order of their names".to_owned(),
    };
    format!("{} recordings {when}, compared with {rig_file}.", trend.recordings.len())
}

/// Label of an axis of dates, with the year where all are of the same.
fn years(trend: &Trend) -> String {
    let year = |of: Option<&RecordingEntry>| of?.began.as_ref()?.get(..4).map(str::to_owned);
    match (year(trend.recordings.first()), year(trend.recordings.last())) {
        (Some(first), Some(last)) if first == last => format!("date, {first}"),
        _ => "date".to_owned(),
    }
}

fn panel(trend: &Trend, parameter: &ParameterTrend, times: &[f64]) -> Figure {
    let x = if trend.dated { years(trend) } else { "recording".to_owned() };
    let y = match parameter.unit.as_str() {
        "" => "value".to_owned(),
        unit => unit.to_owned(),
    };
    let at = |told: &Told| times[told.recording];
    let [low, high] = limits(parameter);
    let (from, to) = (times[0], times[times.len() - 1]);
    // Half a day, or half a recording, to either side.
    let least = if trend.dated { 0.5 * SECONDS_PER_DAY } else { 0.5 };
    let margin = (0.03 * (to - from)).max(least);
    let span = [from - margin, to + margin];
    let (declared, tolerance) = (parameter.declared, parameter.tolerance);
    let mut figure = Figure::new(parameter.name.as_str(), x, y)
        .size(PANEL.0, PANEL.1)
        .x_range(span[0], span[1])
        .y_range(low, high)
        .band(Colour::Sky, "", &span, &[declared - tolerance; 2], &[declared + tolerance; 2])
        .dashed(Colour::Grey, "", &span, &[declared; 2]);
    if trend.dated {
        figure = figure.dates();
    }
    for bound in [false, true] {
        let (colour, points) = (
            if bound { Colour::Vermillion } else { Colour::Black },
            parameter.told.iter().filter(|told| told.at_bound == bound),
        );
        let [mut x, mut y, mut half] = <[Vec<f64>; 3]>::default();
        for told in points {
            x.push(at(told));
            y.push(told.value);
            half.push(told.std);
        }
        figure = figure.errors(colour, "", &x, &y, &half);
    }
    levels(figure, trend, parameter, times)
}

/// The means between changes with these, or the drift.
fn levels(mut figure: Figure, trend: &Trend, parameter: &ParameterTrend, times: &[f64]) -> Figure {
    let Some(last) = parameter.told.last() else { return figure };
    let at = |point: usize| times[parameter.told[point].recording];
    let line = |figure: Figure, ends: [f64; 2], values: [f64; 2]| {
        figure.line(Colour::Blue, "", &ends, &values)
    };
    let ends = [at(0), times[last.recording]];
    if let (Movement::Drift, Some(drift), Some(today)) =
        (parameter.movement, parameter.drift, parameter.today)
    {
        let unit = if trend.dated { DAYS_PER_MONTH * SECONDS_PER_DAY } else { 1.0 };
        let first = today.value - drift.value * (ends[1] - ends[0]) / unit;
        return line(figure, ends, [first, today.value]);
    }
    let mut from = 0;
    for change in &parameter.changes {
        let to = from + change.recordings_before;
        // It happened somewhere between the two recordings.
        let between = f64::midpoint(at(to - 1), at(to));
        figure = line(figure, [at(from), at(to - 1)], [change.from.value; 2]);
        figure = figure.vertical(Colour::Vermillion, "", between);
        from = to;
    }
    match parameter.today {
        Some(today) if parameter.movement != Movement::Unknown => {
            line(figure, [at(from), ends[1]], [today.value; 2])
        }
        _ => figure,
    }
}

/// The ordinates shown: all points with their errors, and the declared value; of the tolerance as
/// much as does not hide them.
fn limits(parameter: &ParameterTrend) -> [f64; 2] {
    let declared = parameter.declared;
    let bars =
        parameter.told.iter().flat_map(|told| [told.value - told.std, told.value + told.std]);
    let [low, high] =
        bars.fold([declared; 2], |[low, high], value| [low.min(value), high.max(value)]);
    let margin = (0.12 * (high - low)).max(0.05 * parameter.tolerance);
    // A narrow tolerance is shown whole.
    let edge = |edge: f64, limit: f64, sign: f64| {
        if sign * (edge - limit) < 0.6 * (high - low) && sign * (edge - limit) > 0.0 {
            edge + sign * 0.5 * margin
        } else {
            limit
        }
    };
    [
        edge(declared - parameter.tolerance, low - margin, -1.0),
        edge(declared + parameter.tolerance, high + margin, 1.0),
    ]
}

fn recordings(trend: &Trend) -> Table {
    let searched = trend.recordings.iter().any(|own| own.effects.is_some());
    let mut header = vec!["began", "recording", "error: declared → fitted"];
    if searched {
        header.push("effects found");
    }
    let row = |own: &RecordingEntry| {
        let mut cells = vec![
            own.began.clone().unwrap_or_else(|| "–".to_owned()),
            own.file.clone(),
            text::errors(own.error.iter()),
        ];
        if searched {
            cells.push(own.effects.as_ref().map_or("–".to_owned(), |own| match &own[..] {
                [] => "none".to_owned(),
                effects => effects.join(", "),
            }));
        }
        cells
    };
    Table::new(header).rows(trend.recordings.iter().map(row))
}

fn recordings_caption(trend: &Trend) -> String {
    let per = trend.seconds / trend.recordings.len().max(1) as f64;
    format!(
        "Root-mean-square error of each recording on the rows that took no part in its fit, with \
         the values of the rig file and with those fitted. {per:.1} s per recording."
    )
}

fn method(trend: &Trend) -> String {
    format!(
        "Each recording is fitted by itself within the tolerances of the rig file. A recording \
         counts for a parameter where it tells more of it than the rig file does. Changes are \
         found by optimal partitioning into constant stretches of three recordings or more, \
         weighted by the standard deviations; their scale is that by which successive recordings \
         scatter. The limits are simulated for the number of recordings: with probability {:.0} % \
         at most, a machine that does not change is said to have changed, over all parameters \
         together, if the errors of the recordings are independent and normal. A change smaller \
         than the typical standard deviation of one recording is not told. Where a line explains \
         the recordings better than steps (Bayes' criterion), the parameter drifts. {}",
        100.0 * FALSE_ALARM,
        if trend.dated {
            "A month is a twelfth of a year."
        } else {
            "The recordings have no calendar time: drifts are per recording."
        }
    )
}
