//! The page that `--report` writes for a model with one measured channel.

use report::{Colour, Figure, Page, Table, Tone};

use super::single_channel_result::{Study, all_rows};
use crate::effects::{Units, find};
use crate::naming::{held, labels};
use crate::outcome::{Left, Outcome, Verdict};
use crate::outcome_tables::{candidates_and_parameters, short, what_is_left};
use crate::residual_figures::{banded, drawn};
use crate::selection::predictor::Predictor;
use crate::selection::validation::{LEAST_GAIN, LEAST_T};
use crate::spectral::periodogram;

/// Number of records with figures of their own.
const MOST_FIGURES: usize = 3;
/// Rows in the figure of the measured channel: over a long record three curves cannot be
/// distinguished.
const DETAIL_ROWS: usize = 1400;
/// The same for an output that oscillates, of which a few periods are shown.
const DETAIL_PERIODS: usize = 200;
/// Bands of the spectra, each a sixth of an octave wide or as wide as the record resolves.
const BANDS_PER_OCTAVE: f64 = 6.0;

/// The channel whose error is shown.
struct Channel {
    /// Its name in titles.
    title: &'static str,
    name: &'static str,
    unit: &'static str,
    /// Rows in the figure of its measured values.
    detail_rows: usize,
    /// What its figure compares.
    compared: &'static str,
    /// How its error is formed.
    method: String,
    /// Unit of the position, where loops of force over position are shown.
    loops_over: Option<&'static str>,
}

impl Channel {
    fn of(predictor: &Predictor<'_>) -> Self {
        let (axis, unit) = (&predictor.regression().axis, predictor.unit());
        match predictor {
            Predictor::EquationError(_) => Self {
                title: "Force",
                name: "force",
                unit,
                detail_rows: DETAIL_ROWS,
                compared: "measured force, and the force that the measured motion needs by the \
                           model",
                method: format!(
                    "Position and force pass the same zero-phase low-pass (Butterworth, order 4 a \
                     pass, {:.0} Hz, forward and backward); speed and acceleration are \
                     differences of the filtered position; no floor is known without repeated \
                     records.",
                    axis.cut_off
                ),
                loops_over: axis.spring.then_some(axis.units.position),
            },
            Predictor::OutputError(_) => Self {
                title: "Output",
                name: "output",
                unit,
                detail_rows: DETAIL_PERIODS,
                compared: "measured output, and the output that the model makes of the input",
                method: format!(
                    "The output is simulated from the input alone, begun at the measured state of \
                     the first row, and compared as measured, without a filter. Candidates are \
                     screened by the balance of the input up to {:.0} Hz; those marked \
                     “screened” were not simulated, and their gain is that of the balance. No \
                     floor is known without repeated records.",
                    axis.cut_off
                ),
                loops_over: None,
            },
        }
    }
}

/// One record, row by row.
struct RecordRows {
    time: Vec<f64>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    measured: Vec<f64>,
    /// Residual of the declared model.
    before: Vec<f64>,
    /// Residual with the effects.
    after: Vec<f64>,
}

impl RecordRows {
    fn new(study: &Study<'_>, record: usize) -> Self {
        let balance = &study.predictor.regression().balances[record];
        let signals = &balance.signals;
        let [time, position, velocity] =
            [&signals.time, &signals.position, &signals.velocity].map(|full| signals.rows(full));
        let block = all_rows(record, balance);
        let [before, after] = [&study.found.base, study.found.last()]
            .map(|model| study.predictor.residual(&model.fitted, &block));
        let measured = study.predictor.measured(record).to_vec();
        Self { time, position, velocity, measured, before, after }
    }
}

/// Returns the verdict as a sentence, and one on the errors.
pub(super) fn sentences(outcome: &Outcome) -> (Tone, String, String) {
    let words = outcome.effects.iter().filter_map(|effect| Some(find(&effect.id)?.words));
    let list = words.collect::<Vec<_>>().join(", and ");
    let (tone, sentence) = match outcome.verdict {
        Verdict::Effect => (Tone::Neutral, format!("The declared model lacks {list}.")),
        Verdict::Ambiguous => {
            let others: Vec<&str> = outcome.ambiguous_with.iter().map(|n| n.id.as_str()).collect();
            (
                Tone::Warning,
                format!("The declared model lacks {list}, or else {}.", others.join(" or ")),
            )
        }
        Verdict::None => (Tone::Good, "These records show no missing effect.".to_owned()),
        Verdict::Unlisted => {
            let on = outcome.unlisted.as_ref().map_or("something", |u| u.depends_on.as_str());
            (
                Tone::Warning,
                format!(
                    "The model lacks something that no listed effect explains; it depends on {on}."
                ),
            )
        }
    };
    let mut detail = String::new();
    for (channel, e) in &outcome.error {
        let held = "on rows that took no part in fitting or selection";
        detail += &if outcome.effects.is_empty() {
            format!(
                "Error of {channel} {held}: {} {} ({:.2} %). ",
                short(e.after),
                e.unit,
                e.after_percent
            )
        } else {
            format!(
                "Error of {channel} {held}: {} before, {} {} after ({:.2} % to {:.2} % of its root \
                 mean square). ",
                short(e.before),
                short(e.after),
                e.unit,
                e.before_percent,
                e.after_percent
            )
        };
    }
    if outcome.remains && outcome.unlisted.is_none() {
        detail += "More than three effects show; the others are listed under “What is left”.";
    } else if outcome.remains && outcome.verdict != Verdict::Unlisted {
        let on = outcome.unlisted.as_ref().map_or("", |u| u.depends_on.as_str());
        detail +=
            &format!("A residual remains that depends on {on} and that no listed effect explains.");
    }
    (tone, sentence, detail.trim_end().to_owned())
}

/// The whole page.
pub(super) fn page(study: &Study<'_>, outcome: &Outcome) -> Page {
    let (tone, sentence, detail) = sentences(outcome);
    let channel = Channel::of(&study.predictor);
    let with = !outcome.effects.is_empty();
    let regression = study.predictor.regression();
    let records: Vec<RecordRows> =
        (0..regression.balances.len()).map(|record| RecordRows::new(study, record)).collect();
    let names = labels(regression.balances.iter().map(|balance| balance.name.as_str()));
    let mut page = Page::new("What the model lacks")
        .subtitle(&format!("Declared model compared with {}", held(&names)))
        .verdict(tone, &sentence, &detail)
        .table(
            steps(outcome),
            &format!(
                "Error of the {} in percent of its root mean square, after each step. Parameters \
                 come from the fitting rows, but for the last column, where everything is fitted \
                 to and judged on all rows, as publications do.",
                channel.name
            ),
        )
        .heading("Measured against model");
    for (label, record) in names.iter().zip(&records).take(MOST_FIGURES) {
        page = record_figures(page, &channel, (label, record), with);
    }
    page = residual_maps(page, &regression.axis.units, &channel, &records, with);
    if let Some(unlisted) = &outcome.unlisted {
        let column = |i: usize| unlisted.table.iter().map(|row| row[i]).collect::<Vec<f64>>();
        let figure = Figure::new(
            "Unlisted effect",
            unlisted.depends_on.replace('_', " "),
            format!("force / {}", regression.axis.units.force),
        )
        .errors(Colour::Blue, "", &column(0), &column(1), &column(2));
        page = page.figure(
            &figure,
            "Nonparametric function of one variable, fitted beside the model; bars are one \
             standard deviation.",
        );
    }
    if !outcome.left.is_empty() {
        page = page.heading("What is left").table(
            left(&outcome.left),
            "Effects that are visible but not accepted, tried one by one beside the model: two \
             lines may show the same effect. Size is the rms of its force. Below a block t of 2.5 \
             it may be chance.",
        );
    }
    let accepted = format!(
        "Each candidate is fitted on the fitting rows and validated on the selection ones. It is \
         added when the residual falls by {:.0} % or more, when the mean fall is {LEAST_T:.1} of \
         its standard errors above zero, and when more blocks get better than worse.",
        100.0 * LEAST_GAIN
    );
    let captions = (
        accepted.as_str(),
        "The best candidates of each round; all are in the result at the end. Nonparametric ones \
         are functions of one variable.",
        "Parameters of the model with its effects, from the fitting rows; ± is one standard \
         deviation, by blocks.",
    );
    candidates_and_parameters(page, outcome, captions).paragraph(&channel.method)
}

/// What the residual depends on, over all rows of all records.
fn residual_maps(
    page: Page,
    units: &Units,
    channel: &Channel,
    records: &[RecordRows],
    with: bool,
) -> Page {
    let mut page = page.heading("What the residual depends on").paragraph(
        "Mean of the residual in bins (line) and one standard deviation of the rows in a bin to \
         either side (band). A mean away from zero is something that the model lacks.",
    );
    let all = |f: &dyn Fn(&RecordRows) -> &[f64]| -> Vec<f64> {
        records.iter().flat_map(|r| f(r).iter().copied()).collect()
    };
    let (before, after) = (all(&|r| &r.before), all(&|r| &r.after));
    for (what, unit, values) in [
        ("position", units.position, all(&|r| &r.position)),
        ("velocity", units.velocity, all(&|r| &r.velocity)),
        ("time", "s", all(&|r| &r.time)),
    ] {
        let figure = banded(what, unit, channel.unit, &values, (&before, &after), with);
        page = page.figure(&figure, &format!("Residual against {what}, all rows of all records."));
    }
    page.figure(
        &spectrum(channel, records.first(), with),
        &format!(
            "Amplitude of the {} and of its residuals in bands of a sixth of an octave, all rows \
             of the first record.",
            channel.name
        ),
    )
}

fn record_figures(
    page: Page,
    channel: &Channel,
    (label, r): (&str, &RecordRows),
    with: bool,
) -> Page {
    let Channel { name, unit, compared, .. } = channel;
    let minus = |e: &[f64]| -> Vec<f64> { r.measured.iter().zip(e).map(|(f, e)| f - e).collect() };
    let (declared, effects) = (minus(&r.before), minus(&r.after));
    // From the middle of the record, during the movement.
    let length = channel.detail_rows;
    let from = (r.time.len() / 2).saturating_sub(length / 2);
    let part = from..(from + length).min(r.time.len());
    let against = |figure: Figure, x: &[f64]| {
        let figure = figure.line(Colour::Black, "measured", x, &r.measured[part.clone()]);
        drawn(&declared[part.clone()], &effects[part.clone()], with).into_iter().enumerate().fold(
            figure,
            |figure, (at, (name, colour, y))| match at {
                0 => figure.line(colour, name, x, y),
                _ => figure.dashed(colour, name, x, y),
            },
        )
    };
    let curves = against(
        Figure::new(channel.title, "time / s", format!("{name} / {unit}")),
        &r.time[part.clone()],
    );
    let residual = Figure::new("Residual", "time / s", format!("residual / {unit}")).size(680, 260);
    let residual = drawn(&r.before, &r.after, with)
        .into_iter()
        .fold(residual, |figure, (name, colour, y)| figure.line(colour, name, &r.time, y))
        .horizontal(Colour::Grey, "", 0.0);
    let mut page = page
        .figure(&curves, &format!("{label}: {compared}; a part from the middle."))
        .figure(&residual, &format!("{label}: measured {name} less the model's, whole record."));
    if let Some(position) = channel.loops_over {
        let figure =
            Figure::new("Loops", format!("position / {position}"), format!("{name} / {unit}"));
        page = page.figure(
            &against(figure, &r.position[part.clone()]),
            &format!("{label}: force over position, the same part."),
        );
    }
    page
}

/// Amplitudes of the first record by frequency bands.
fn spectrum(channel: &Channel, record: Option<&RecordRows>, with: bool) -> Figure {
    let mut figure = Figure::new("", "frequency / Hz", format!("amplitude / {}", channel.unit))
        .size(680, 300)
        .log_x()
        .log_y();
    let Some(r) = record.filter(|r| r.time.len() > 16) else { return figure };
    let sampling = (r.time.len() - 1) as f64 / (r.time[r.time.len() - 1] - r.time[0]);
    let lowest = 2.0 * sampling / r.time.len() as f64;
    let measured = (channel.name, Colour::Black, &r.measured);
    for (name, colour, values) in std::iter::once(measured).chain(drawn(&r.before, &r.after, with))
    {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        // A Hann window, against leakage of what is not periodic in the record.
        let window = |i: usize| 1.0 - (std::f64::consts::TAU * i as f64 / n).cos();
        let windowed: Vec<f64> =
            values.iter().enumerate().map(|(i, v)| (v - mean) * window(i)).collect();
        let mut bands: std::collections::BTreeMap<i64, (f64, f64, f64)> =
            std::collections::BTreeMap::new();
        let bins = periodogram(&windowed, sampling);
        // Bins are a quarter of what the record resolves; the window has a mean square of 1.5.
        let scale = 2.0 / (1.5 * n * (2.0 * (bins.len() as f64 - 1.0)));
        for (frequency, power) in bins.into_iter().filter(|bin| bin.0 >= lowest) {
            let band = bands
                .entry(((frequency / lowest).log2() * BANDS_PER_OCTAVE).floor() as i64)
                .or_default();
            *band = (band.0 + frequency, band.1 + power * scale, band.2 + 1.0);
        }
        let x: Vec<f64> = bands.values().map(|b| b.0 / b.2).collect();
        let y: Vec<f64> = bands.values().map(|b| b.1.sqrt()).collect();
        figure = figure.line(colour, name, &x, &y);
    }
    figure
}

fn left(left: &[Left]) -> Table {
    let mut table =
        Table::new(["what", "size", "unit", "error falls by / %", "block t", "parameters"]);
    for l in left {
        let parameters: Vec<String> = l
            .parameters
            .iter()
            .map(|p| format!("{} {} {}", p.name, short(p.value), p.unit))
            .collect();
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

fn steps(outcome: &Outcome) -> Table {
    let mut table = Table::new([
        "model",
        "fitting rows / %",
        "selection rows / %",
        "reporting rows / %",
        "all rows / %",
    ]);
    for (i, s) in outcome.steps.iter().enumerate() {
        let model = if i == 0 { "declared".to_owned() } else { format!("+ {}", s.model) };
        let numbers = [s.fit_percent, s.select_percent, s.report_percent, s.all_rows_percent];
        table = table.row(std::iter::once(model).chain(numbers.map(|n| format!("{n:.2}"))));
    }
    table
}
