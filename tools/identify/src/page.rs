//! The page that `--report` writes for a model of one channel.

use report::{Colour, Figure, Page, Table, Tone};

use crate::effects::Units;
use crate::outcome::{Left, Outcome, Verdict};
use crate::spectral::periodogram;

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
    /// What was measured of the channel.
    pub measured: Vec<f64>,
    /// Residual of the declared model.
    pub before: Vec<f64>,
    /// Residual with the effects.
    pub after: Vec<f64>,
}

/// The channel whose error is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// The force that the measured motion needs.
    Force,
    /// The output, simulated from the input.
    Output,
}

impl Channel {
    const fn name(self) -> &'static str {
        match self {
            Self::Force => "force",
            Self::Output => "output",
        }
    }
}

/// What the page shows beside the outcome.
pub struct View {
    /// Units of the axis.
    pub units: Units,
    /// The channel.
    pub channel: Channel,
    /// Whether a spring holds the position.
    pub spring: bool,
    /// All records.
    pub records: Vec<RecordView>,
    /// The effects in words.
    pub words: Vec<&'static str>,
    /// Cut-off of the low-pass (Hz).
    pub cut_off: f64,
}

/// Records that get a figure of their own.
const MOST_FIGURES: usize = 3;
/// Rows in the figure of the measured channel: over a long record three curves are one.
const DETAIL_ROWS: usize = 1400;
/// The same for an output that oscillates, where a few periods show more.
const DETAIL_PERIODS: usize = 200;
/// Listed candidates of each round in the table.
const MOST_CANDIDATES: usize = 6;
/// Bands of the spectra, each a sixth of an octave wide or as wide as the record resolves.
const BANDS_PER_OCTAVE: f64 = 6.0;

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
    if outcome.remains && outcome.unlisted.is_none() {
        detail += "More than three effects show; the rest stands under what is left.";
    } else if outcome.remains && outcome.verdict != Verdict::Unlisted {
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
        .table(steps(outcome), &format!("Error of the {} in percent of its root mean square, after each step. Parameters come from \
            the fitting rows, but for the last column, where everything is fitted to and judged on all rows, as publications do.",
            view.channel.name()))
        .heading("Measured against model");
    for record in view.records.iter().take(MOST_FIGURES) {
        page = record_figures(page, &view, record);
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
        let figure = banded(what, unit, view.unit(), &values, &before, &after);
        page = page.figure(&figure, &format!("Residual against {what}, all rows of all records."));
    }
    page = page.figure(
        &spectrum(&view),
        &format!(
            "Amplitude of the {} and of its residuals in bands of a sixth of an octave, all rows of the first record.",
            view.channel.name()
        ),
    );
    if let Some(unlisted) = &outcome.unlisted {
        let column = |i: usize| unlisted.table.iter().map(|row| row[i]).collect::<Vec<f64>>();
        let figure =
            Figure::new("What has no name", unlisted.depends_on.replace('_', " "), format!("force / {}", u.force))
                .errors("", &column(0), &column(1), &column(2));
        page = page.figure(
            &figure,
            "Generic function of one variable, fitted beside the model; bars are one standard deviation.",
        );
    }
    if !outcome.left.is_empty() {
        page = page.heading("What is left").table(
            left(&outcome.left),
            "What shows and gets no name, tried one by one beside the model: two lines may be two views of the same thing. \
             Size is the root mean square of what it puts out. Below a block t of 2.5 it may be chance.",
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
        .table(ranking(outcome), "The best candidates of each round; all of them stand in the result at the end. Generic ones are functions of one variable and have no name.")
        .heading("Parameters")
        .table(parameters(outcome), "Parameters of the model with its effects, from the fitting rows; ± is one standard deviation, by blocks.")
        .heading("Next experiment")
        .paragraph(&format!("{} To settle it: {}.", outcome.next_experiment.why, outcome.next_experiment.what));
    for note in &outcome.notes {
        page = page.paragraph(&format!("Note: {note}."));
    }
    page.paragraph(&view.method())
}

impl View {
    /// Unit of the channel.
    fn unit(&self) -> &'static str {
        match self.channel {
            Channel::Force => self.units.force,
            Channel::Output => self.units.position,
        }
    }

    fn method(&self) -> String {
        match self.channel {
            Channel::Force => format!(
                "Position and force pass the same zero-phase low-pass (Butterworth, order 4 a pass, {:.0} Hz, forward and backward); \
                 speed and acceleration are differences of the filtered position; no floor is known without repeated records.",
                self.cut_off
            ),
            Channel::Output => format!(
                "The output is simulated from the input alone, begun at the measured state of the first row, and compared as \
                 measured, without a filter. Candidates are screened by the balance of the input up to {:.0} Hz; those marked \
                 “screened” were not simulated, and their gain is that of the balance. No floor is known without repeated records.",
                self.cut_off
            ),
        }
    }
}

fn record_figures(page: Page, view: &View, r: &RecordView) -> Page {
    let (name, unit) = (view.channel.name(), view.unit());
    let minus = |e: &[f64]| -> Vec<f64> { r.measured.iter().zip(e).map(|(f, e)| f - e).collect() };
    let (declared, with) = (minus(&r.before), minus(&r.after));
    // Mid-record, where the movement is under way.
    let length = if view.channel == Channel::Output { DETAIL_PERIODS } else { DETAIL_ROWS };
    let from = (r.time.len() / 2).saturating_sub(length / 2);
    let part = from..(from + length).min(r.time.len());
    let title = if view.channel == Channel::Output { "Output" } else { "Force" };
    let curves = Figure::new(title, "time / s", format!("{name} / {unit}"))
        .colour(Colour::Black)
        .line("measured", &r.time[part.clone()], &r.measured[part.clone()])
        .colour(Colour::Vermillion)
        .line("declared model", &r.time[part.clone()], &declared[part.clone()])
        .colour(Colour::Blue)
        .dashed("with effects", &r.time[part.clone()], &with[part.clone()]);
    let residual = Figure::new("Residual", "time / s", format!("residual / {unit}"))
        .size(680, 260)
        .colour(Colour::Vermillion)
        .line("declared model", &r.time, &r.before)
        .colour(Colour::Blue)
        .line("with effects", &r.time, &r.after)
        .horizontal("", 0.0);
    let how = match view.channel {
        Channel::Force => "measured force, and the force that the measured motion needs by the model",
        Channel::Output => "measured output, and the output that the model makes of the input",
    };
    let mut page = page
        .figure(&curves, &format!("{}: {how}; a part from the middle.", r.name))
        .figure(&residual, &format!("{}: measured {name} less the model's, whole record.", r.name));
    if view.spring && view.channel == Channel::Force {
        let position = &r.position[part.clone()];
        let figure = Figure::new("Loops", format!("position / {}", view.units.position), format!("{name} / {unit}"))
            .colour(Colour::Black)
            .line("measured", position, &r.measured[part.clone()])
            .colour(Colour::Vermillion)
            .line("declared model", position, &declared[part.clone()])
            .colour(Colour::Blue)
            .dashed("with effects", position, &with[part]);
        page = page.figure(&figure, &format!("{}: force over position, the same part.", r.name));
    }
    page
}

/// Amplitudes in bands of the first record.
fn spectrum(view: &View) -> Figure {
    let mut figure =
        Figure::new("", "frequency / Hz", format!("amplitude / {}", view.unit())).size(680, 300).log_x().log_y();
    let Some(r) = view.records.first().filter(|r| r.time.len() > 16) else { return figure };
    let sampling = (r.time.len() - 1) as f64 / (r.time[r.time.len() - 1] - r.time[0]);
    let lowest = 2.0 * sampling / r.time.len() as f64;
    for (name, colour, values) in [
        (view.channel.name(), Colour::Black, &r.measured),
        ("declared model", Colour::Vermillion, &r.before),
        ("with effects", Colour::Blue, &r.after),
    ] {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        // A Hann window: what does not repeat within the record must not leak into all bands.
        let window = |i: usize| 1.0 - (std::f64::consts::TAU * i as f64 / n).cos();
        let windowed: Vec<f64> = values.iter().enumerate().map(|(i, v)| (v - mean) * window(i)).collect();
        let mut bands: std::collections::BTreeMap<i64, (f64, f64, f64)> = std::collections::BTreeMap::new();
        let bins = periodogram(&windowed, sampling);
        // Bins are a quarter of what the record resolves; the window has a mean square of 1.5.
        let scale = 2.0 / (1.5 * n * (2.0 * (bins.len() as f64 - 1.0)));
        for (frequency, power) in bins.into_iter().filter(|bin| bin.0 >= lowest) {
            let band = bands.entry(((frequency / lowest).log2() * BANDS_PER_OCTAVE).floor() as i64).or_default();
            *band = (band.0 + frequency, band.1 + power * scale, band.2 + 1.0);
        }
        let x: Vec<f64> = bands.values().map(|b| b.0 / b.2).collect();
        let y: Vec<f64> = bands.values().map(|b| b.1.sqrt()).collect();
        figure = figure.colour(colour).line(name, &x, &y);
    }
    figure
}

fn left(left: &[Left]) -> Table {
    let mut table = Table::new(["what", "size", "unit", "error falls by / %", "block t", "parameters"]);
    for l in left {
        let parameters: Vec<String> =
            l.parameters.iter().map(|p| format!("{} {} {}", p.name, short(p.value), p.unit)).collect();
        table = table.row([
            what_is_left(l),
            short(l.size),
            l.unit.clone(),
            format!("{:.1}", l.gain_percent),
            format!("{:.1}", l.t),
            if parameters.is_empty() { "–".to_owned() } else { parameters.join(", ") },
        ]);
    }
    table
}

/// The name of something that is left.
pub fn what_is_left(left: &Left) -> String {
    match &left.site {
        Some(site) => format!("{}@{site}", left.id),
        None => format!("generic, of {}", left.id.replace('_', " ")),
    }
}

/// What is drawn of the residual before effects and of that with them, each with its name and colour: one where the two are the same, for want
/// of an effect or of one that acts on the channel, since the second would hide the first.
pub(crate) fn drawn<T: PartialEq>(before: T, after: T) -> Vec<(&'static str, Colour, T)> {
    if before == after {
        return vec![("declared model, and with effects", Colour::Vermillion, before)];
    }
    vec![("declared model", Colour::Vermillion, before), ("with effects", Colour::Blue, after)]
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
    for (name, colour, points) in drawn(&series[0], &series[1]) {
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
    let mut shown = (0, 0);
    for c in &outcome.candidates {
        shown = if shown.0 == c.round { (c.round, shown.1 + 1) } else { (c.round, 1) };
        if shown.1 > MOST_CANDIDATES && !c.generic && !c.accepted {
            continue;
        }
        table = table.row([
            c.round.to_string(),
            if c.generic { format!("generic, of {}", c.id.replace('_', " ")) } else { c.id.clone() },
            format!("{:.1}", c.gain_percent).replace('-', "−"),
            format!("{:.1}", c.t).replace('-', "−"),
            c.blocks_better.to_string(),
            c.blocks_worse.to_string(),
            if c.accepted { "passes" } else { "no" }.to_owned(),
        ]);
    }
    table
}

pub(crate) fn parameters(outcome: &Outcome) -> Table {
    let mut table = Table::new(["parameter", "declared", "fitted", "±", "unit", "remark"]);
    let number = |v: Option<f64>| v.map_or("–".to_owned(), short);
    for p in &outcome.parameters {
        let cells = [p.name.clone(), number(p.declared), short(p.fitted), number(p.std), p.unit.clone(), p.remark()];
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
