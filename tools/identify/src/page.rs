//! The page that `--report` writes for a model that is read inversely.

use report::{Colour, Figure, Page, Table, Tone};

use crate::effects::Units;
use crate::outcome::{Outcome, Verdict};

/// One record on the page, row by row.
pub struct RecordView {
    /// Name.
    pub name: String,
    /// Time (s).
    pub time: Vec<f64>,
    /// Position.
    pub position: Vec<f64>,
    /// Velocity.
    pub velocity: Vec<f64>,
    /// Measured force, low-passed.
    pub force: Vec<f64>,
    /// Residual of the declared model.
    pub before: Vec<f64>,
    /// Residual with the effects.
    pub after: Vec<f64>,
}

/// What the page shows beside the outcome.
pub struct View {
    /// Units of the axis.
    pub units: Units,
    /// All records.
    pub records: Vec<RecordView>,
    /// The effects in words.
    pub words: Vec<&'static str>,
    /// Cut-off of the low-pass (Hz).
    pub cut_off: f64,
}

/// Records that get a figure of their own.
const MOST_FIGURES: usize = 3;
/// Length of record in the figure of the force (s).
const DETAIL_S: f64 = 7.0;

/// The verdict as a sentence, and one that says how far it holds.
pub fn sentences(words: &[&str], outcome: &Outcome) -> (Tone, String, String) {
    let list = words.join(", and ");
    let (tone, sentence) = match outcome.verdict {
        Verdict::Effect => (Tone::Neutral, format!("The declared model lacks {list}.")),
        Verdict::Ambiguous => {
            let others: Vec<&str> = outcome.ambiguous_with.iter().map(|n| n.id.as_str()).collect();
            (Tone::Warning, format!("The declared model lacks {list}, or else {}.", others.join(" or ")))
        }
        Verdict::None => (Tone::Good, "Nothing is missing that these records could show.".to_owned()),
        Verdict::Unlisted => {
            let on = outcome.unlisted.as_ref().map_or("something", |u| u.depends_on.as_str());
            (Tone::Warning, format!("Something is missing that no listed effect explains; it depends on {on}."))
        }
    };
    let mut detail = String::new();
    for (channel, e) in &outcome.error {
        let held = "on rows that took no part in fitting or choosing";
        detail += &if outcome.effects.is_empty() {
            format!("Error of {channel} {held}: {} {} ({:.2} %). ", short(e.after), e.unit, e.after_percent)
        } else {
            format!(
                "Error of {channel} {held}: {} before, {} {} after ({:.2} % to {:.2} % of its root mean square). ",
                short(e.before),
                short(e.after),
                e.unit,
                e.before_percent,
                e.after_percent
            )
        };
    }
    if outcome.remains && outcome.verdict != Verdict::Unlisted {
        let on = outcome.unlisted.as_ref().map_or("", |u| u.depends_on.as_str());
        detail += &format!("Something is left that depends on {on} and that no listed effect explains.");
    }
    (tone, sentence, detail.trim_end().to_owned())
}

/// The whole page.
pub fn page(view: View, outcome: &Outcome) -> Page {
    let (tone, sentence, detail) = sentences(&view.words, outcome);
    let names: Vec<&str> = view.records.iter().map(|r| r.name.as_str()).collect();
    let mut page = Page::new("What the model lacks")
        .subtitle(&format!("Declared model held against {}", names.join(", ")))
        .verdict(tone, &sentence, &detail)
        .table(steps(outcome), "Residual of the force in percent of its root mean square, after each step. Parameters come from \
            the fitting rows, but for the last column, where everything is fitted to and judged on all rows, as publications do.")
        .heading("Measured against model");
    for record in view.records.iter().take(MOST_FIGURES) {
        page = record_figures(page, &view.units, record);
    }
    page = page.heading("What the residual depends on").paragraph(
        "Mean of the residual in bins (line) and one standard deviation of the rows in a bin to either side (band). A mean \
         that leaves zero is something that the model lacks.",
    );
    let u = &view.units;
    let all = |f: &dyn Fn(&RecordView) -> &[f64]| -> Vec<f64> {
        view.records.iter().flat_map(|r| f(r).iter().copied()).collect()
    };
    let (before, after) = (all(&|r| &r.before), all(&|r| &r.after));
    for (what, unit, values) in [
        ("position", u.position, all(&|r| &r.position)),
        ("velocity", u.velocity, all(&|r| &r.velocity)),
        ("time", "s", all(&|r| &r.time)),
    ] {
        let figure = banded(what, unit, u.force, &values, &before, &after);
        page = page.figure(&figure, &format!("Residual against {what}, all rows of all records."));
    }
    if let Some(unlisted) = &outcome.unlisted {
        let column = |i: usize| unlisted.table.iter().map(|row| row[i]).collect::<Vec<f64>>();
        let figure = Figure::new("What is left", unlisted.depends_on.replace('_', " "), format!("force / {}", u.force))
            .errors("", &column(0), &column(1), &column(2));
        page = page.figure(
            &figure,
            "Generic function of one variable, fitted beside the model; bars are one standard deviation.",
        );
    }
    page = page
        .heading("Candidates")
        .paragraph(&format!(
            "Each candidate is fitted on the fitting rows and judged on the selecting ones. It is added when the residual falls by \
             {:.0} % or more, when the mean fall is {:.1} of its standard errors above zero, and when more blocks get better than worse.",
            100.0 * crate::inverse::search::LEAST_GAIN,
            crate::inverse::search::LEAST_T
        ))
        .table(ranking(outcome), "All candidates, round by round. Generic ones are functions of one variable and have no name.")
        .heading("Parameters")
        .table(parameters(outcome), "Parameters of the model with its effects, from the fitting rows; ± is one standard deviation, by blocks.")
        .heading("Next experiment")
        .paragraph(&format!("{} To settle it: {}.", outcome.next_experiment.why, outcome.next_experiment.what));
    for note in &outcome.notes {
        page = page.paragraph(&format!("Note: {note}."));
    }
    page.paragraph(&format!(
        "Position and force pass the same zero-phase low-pass (Butterworth, order 4 a pass, {:.0} Hz, forward and backward); \
         speed and acceleration are differences of the filtered position; no floor is known without repeated records.",
        view.cut_off
    ))
}

fn record_figures(page: Page, units: &Units, r: &RecordView) -> Page {
    let minus = |e: &[f64]| -> Vec<f64> { r.force.iter().zip(e).map(|(f, e)| f - e).collect() };
    // Over a long record three curves are one: a part of it shows how they differ.
    let start = r.time.first().copied().unwrap_or(0.0);
    let n = r.time.iter().take_while(|t| **t - start <= DETAIL_S).count();
    let force = Figure::new("Force", "time / s", format!("force / {}", units.force))
        .colour(Colour::Black)
        .line("measured", &r.time[..n], &r.force[..n])
        .colour(Colour::Vermillion)
        .line("declared model", &r.time[..n], &minus(&r.before)[..n])
        .colour(Colour::Blue)
        .dashed("with effects", &r.time[..n], &minus(&r.after)[..n]);
    let residual = Figure::new("Residual", "time / s", format!("residual / {}", units.force))
        .size(680, 260)
        .colour(Colour::Vermillion)
        .line("declared model", &r.time, &r.before)
        .colour(Colour::Blue)
        .line("with effects", &r.time, &r.after)
        .horizontal("", 0.0);
    page.figure(
        &force,
        &format!("{}: measured force, and the force that the measured motion needs by the model.", r.name),
    )
    .figure(&residual, &format!("{}: measured force less the model's, whole record.", r.name))
}

/// Residuals against a variable: mean and standard deviation in forty bins with equal numbers of rows.
pub(crate) fn banded(what: &str, unit: &str, force: &str, values: &[f64], before: &[f64], after: &[f64]) -> Figure {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let (mut x, mut series) = (Vec::new(), [Vec::new(), Vec::new()]);
    for bin in order.chunks((values.len() / 40).max(1)) {
        let n = bin.len() as f64;
        x.push(bin.iter().map(|i| values[*i]).sum::<f64>() / n);
        for (out, e) in series.iter_mut().zip([before, after]) {
            let mean = bin.iter().map(|i| e[*i]).sum::<f64>() / n;
            let variance = bin.iter().map(|i| (e[*i] - mean).powi(2)).sum::<f64>() / n;
            out.push((mean, variance.sqrt()));
        }
    }
    let mut figure =
        Figure::new("", format!("{what} / {unit}"), format!("residual / {force}")).size(680, 270).horizontal("", 0.0);
    for (name, colour, points) in
        [("declared model", Colour::Vermillion, &series[0]), ("with effects", Colour::Blue, &series[1])]
    {
        let part = |f: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(f).collect::<Vec<f64>>();
        figure = figure.colour(colour).band("", &x, &part(&|p| p.0 - p.1), &part(&|p| p.0 + p.1)).colour(colour).line(
            name,
            &x,
            &part(&|p| p.0),
        );
    }
    figure
}

fn steps(outcome: &Outcome) -> Table {
    let mut table =
        Table::new(["model", "fitting rows / %", "selecting rows / %", "reporting rows / %", "all rows / %"]);
    for (i, s) in outcome.steps.iter().enumerate() {
        let model = if i == 0 { "declared".to_owned() } else { format!("+ {}", s.model) };
        let numbers = [s.fit_percent, s.select_percent, s.report_percent, s.all_rows_percent];
        table = table.row(std::iter::once(model).chain(numbers.map(|n| format!("{n:.2}"))));
    }
    table
}

pub(crate) fn ranking(outcome: &Outcome) -> Table {
    let mut table =
        Table::new(["round", "candidate", "error falls by / %", "block t", "blocks better", "worse", "result"]);
    for c in &outcome.candidates {
        table = table.row([
            c.round.to_string(),
            if c.generic { format!("generic, of {}", c.id.replace('_', " ")) } else { c.id.clone() },
            format!("{:.1}", c.gain_percent).replace('-', "−"),
            format!("{:.1}", c.t).replace('-', "−"),
            c.blocks_better.to_string(),
            c.blocks_worse.to_string(),
            if c.accepted { "passes" } else { "does not pass" }.to_owned(),
        ]);
    }
    table
}

pub(crate) fn parameters(outcome: &Outcome) -> Table {
    let mut table = Table::new(["parameter", "declared", "fitted", "±", "unit", "remark"]);
    let number = |v: Option<f64>| v.map_or("–".to_owned(), short);
    for p in &outcome.parameters {
        let remark = match (p.at_tolerance, p.identifiable) {
            (true, _) => "at the edge of its tolerance",
            (false, false) => "not seen by these records",
            (false, true) => "",
        };
        let cells =
            [p.name.clone(), number(p.declared), short(p.fitted), number(p.std), p.unit.clone(), remark.to_owned()];
        table = table.row(cells);
    }
    for effect in &outcome.effects {
        for p in &effect.parameters {
            let name = format!("{}@{}: {}", effect.id, effect.site, p.name);
            table = table.row([name, "–".into(), short(p.value), number(p.std), p.unit.clone(), "effect".into()]);
        }
    }
    table
}

/// Four significant digits.
pub fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = if (1e-4..1e7).contains(&value.abs()) { format!("{value:.digits$}") } else { format!("{value:.3e}") };
    text.replace('-', "−")
}
