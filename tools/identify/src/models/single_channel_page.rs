//! What the page of a model with one measured channel shows.

use report::{Colour, Figure, Page};

use super::page::{Content, page as whole_page};
use super::residual_plots::{ChannelResidual, over_time, plotted};
use super::single_channel_result::{Study, all_rows};
use crate::correlation::TestedResidual;
use crate::input::step_of;
use crate::naming::labels;
use crate::outcome::Outcome;
use crate::selection::predictor::Predictor;
use crate::selection::validation::{LEAST_GAIN, LEAST_T, MOST_P};

/// Number of records with figures of their own.
const MOST_FIGURES: usize = 3;
/// Rows in the figure of the measured channel: over a long record three curves cannot be
/// distinguished.
const DETAIL_ROWS: usize = 1400;
/// The same for an output that oscillates, of which a few periods are shown.
const DETAIL_PERIODS: usize = 200;

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

/// The whole page.
pub(super) fn page(study: &Study<'_>, outcome: &Outcome, tested: TestedResidual) -> Page {
    let channel = Channel::of(&study.predictor);
    let with = !outcome.effects.is_empty();
    let regression = study.predictor.regression();
    let rows: Vec<RecordRows> =
        (0..regression.balances.len()).map(|record| RecordRows::new(study, record)).collect();
    let records: Vec<&str> = regression.balances.iter().map(|b| b.name.as_str()).collect();
    let shown = labels(records.iter().copied()).into_iter().zip(&rows).take(MOST_FIGURES);
    let content = Content {
        declared: "model",
        located: false,
        errors: format!(
            "Error of the {} in percent of its root mean square, after each step. Parameters come \
             from the fitting rows, but for the last column, where everything is fitted to and \
             judged on all rows, as publications do.",
            channel.name
        ),
        figures: shown.flat_map(|record| record_figures(&channel, record, with)).collect(),
        residual: "residual",
        channels: vec![residual(study, &channel, (&rows, tested), with)],
        force_unit: Some(regression.axis.units.force),
        accepted: format!(
            "Each candidate is fitted on the fitting rows and validated on the selection ones. It \
             is added when the residual falls by {:.0} % or more, when the mean fall is \
             {LEAST_T:.1} of its standard errors above zero or the signed-rank test of the blocks \
             has p ≤ {MOST_P}, and when more blocks get better than worse. No effect is named \
             where most of a large error is left.",
            100.0 * LEAST_GAIN
        ),
        method: format!(
            "Residuals are those of all rows of all records; spectra are of the first record. {}",
            channel.method
        ),
        records,
    };
    whole_page(outcome, &content)
}

/// The residual over all rows of all records.
fn residual(
    study: &Study<'_>,
    channel: &Channel,
    (records, tested): (&[RecordRows], TestedResidual),
    with: bool,
) -> ChannelResidual {
    let units = &study.predictor.regression().axis.units;
    let all = |f: fn(&RecordRows) -> &Vec<f64>| -> Vec<f64> {
        records.iter().flat_map(|record| f(record).iter().copied()).collect()
    };
    // The first record, long enough to have a spectrum.
    let first = records.iter().take(1).filter(|record| record.time.len() > 16);
    let curves = |record: &RecordRows| {
        let measured = (channel.name, Colour::Black, vec![record.measured.clone()]);
        let [before, after] = [&record.before, &record.after].map(|rows| vec![rows.clone()]);
        std::iter::once(measured).chain(plotted(before, after, with))
    };
    ChannelResidual {
        name: channel.name,
        unit: channel.unit,
        variables: vec![
            ("position", units.position, all(|record| &record.position)),
            ("velocity", units.velocity, all(|record| &record.velocity)),
            ("time", "s", all(|record| &record.time)),
        ],
        before: all(|record| &record.before),
        after: all(|record| &record.after),
        spectra: first.flat_map(curves).collect(),
        step_s: records.first().and_then(|record| step_of(&record.time)).unwrap_or_default(),
        with,
        tested,
    }
}

/// The figures of one record.
fn record_figures(
    channel: &Channel,
    (label, r): (&str, &RecordRows),
    with: bool,
) -> Vec<(Figure, String)> {
    let Channel { name, unit, compared, .. } = channel;
    let minus = |e: &[f64]| -> Vec<f64> { r.measured.iter().zip(e).map(|(f, e)| f - e).collect() };
    let (declared, effects) = (minus(&r.before), minus(&r.after));
    // From the middle of the record, during the movement.
    let length = channel.detail_rows;
    let from = (r.time.len() / 2).saturating_sub(length / 2);
    let part = from..(from + length).min(r.time.len());
    let against = |figure: Figure, x: &[f64]| {
        let figure = figure.line(Colour::Black, "measured", x, &r.measured[part.clone()]);
        plotted(&declared[part.clone()], &effects[part.clone()], with).into_iter().enumerate().fold(
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
    let of = format!("residual / {unit}");
    let residual = over_time("Residual", of, &r.time, plotted(&r.before[..], &r.after[..], with));
    let mut figures = vec![
        (curves, format!("{label}: {compared}; a part from the middle.")),
        (residual, format!("{label}: measured {name} less the model's, whole record.")),
    ];
    if let Some(position) = channel.loops_over {
        let figure =
            Figure::new("Loops", format!("position / {position}"), format!("{name} / {unit}"));
        let loops = against(figure, &r.position[part.clone()]);
        figures.push((loops, format!("{label}: force over position, the same part.")));
    }
    figures
}
