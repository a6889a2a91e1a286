//! The page that `--report` writes, for all kinds of models.

use report::{Colour, Figure, Page, Table};

use super::machine_picture::machine_picture;
use super::residual_plots::ChannelResidual;
use super::sentences::sentences;
use crate::naming::{held, labels};
use crate::outcome::{ChannelError, Left, Outcome, StepError, UnlistedTable};
use crate::outcome_tables::{correlations, false_alarms, parameters, ranking, short, what_is_left};

/// What a kind of model shows beside its outcome.
pub(super) struct Content<'a> {
    /// What was declared.
    pub(super) declared: &'static str,
    /// Whether the search finds where an effect acts.
    pub(super) located: bool,
    /// Names of the records.
    pub(super) records: Vec<&'a str>,
    /// Caption of the table of errors.
    pub(super) errors: String,
    /// Figures of the first records.
    pub(super) figures: Vec<(Figure, String)>,
    /// What a residual is called.
    pub(super) residual: &'static str,
    /// The residuals of all channels.
    pub(super) channels: Vec<ChannelResidual>,
    /// Unit of a force, for the axis of a nonparametric function.
    pub(super) force_unit: Option<&'static str>,
    /// How candidates are accepted.
    pub(super) accepted: String,
    /// How errors are formed.
    pub(super) method: String,
}

/// The whole page.
pub(super) fn page(outcome: &Outcome, content: &Content<'_>) -> Page {
    let (tone, sentence, detail) = sentences(outcome, content.located);
    let names = labels(content.records.iter().copied());
    let axis = outcome.axis.as_ref().map_or(String::new(), |axis| format!(" of axis \"{axis}\""));
    let compared = format!("Declared {}{axis} compared with {}", content.declared, held(&names));
    let errors = if outcome.steps.is_empty() { errors(outcome) } else { steps(outcome) };
    let mut page =
        Page::new("What the model lacks").subtitle(&compared).verdict(tone, &sentence, &detail);
    if content.located
        && let Some(svg) = machine_picture(outcome)
    {
        page = page.picture(svg, "The machine, and where it departs from the declared model.");
    }
    page = page.table(errors, &content.errors).heading("Measured against model");
    for (figure, caption) in &content.figures {
        page = page.figure(figure, caption);
    }
    let residual = content.residual;
    page = page.heading("What the residual depends on").paragraph(&format!(
        "Mean of the {residual} in bins (line) and one standard deviation of the rows in a bin to \
         either side (band), its spectrum{}, and the correlations of the final model's {residual} \
         on the reporting rows with itself and with the inputs. A mean away from zero is something \
         that the model lacks, and so is a correlation with an input outside the band in which \
         95 % of the lags of an independent one lie.",
        if content.located { ", its ratio to the noise floor octave by octave" } else { "" }
    ));
    for channel in &content.channels {
        let sheet = channel.panels(residual);
        page = page.panels(&sheet, &format!("The {residual} of {}.", channel.name));
    }
    if let Some(unlisted) = &outcome.unlisted {
        page = unlisted_function(page, unlisted, content.force_unit);
    }
    if !outcome.left.is_empty() {
        page = page.heading("What is left").table(
            left(&outcome.left),
            "Effects that are visible but not accepted, tried one by one beside the model: two \
             lines may show the same effect. Size is the rms of its force. Below a block t of 2.5 \
             it may be chance.",
        );
    }
    page = page.heading("Candidates").paragraph(&content.accepted).table(
        ranking(outcome),
        "The best candidates of each round; all are in the result at the end. Nonparametric ones \
         are functions of one variable.",
    );
    if !outcome.false_alarms.is_empty() {
        page = page.table(false_alarms(outcome), FALSE_ALARMS);
    }
    page = page.heading("Parameters").table(
        parameters(outcome),
        "Parameters of the model with its effects, from the fitting rows; ± is one standard \
         deviation, by blocks.",
    );
    if !outcome.correlations.is_empty() {
        page = page.table(
            correlations(outcome),
            "Estimates whose errors are strongly correlated: where one is off, the other is off \
             with it.",
        );
    }
    page = page.heading("Next experiment").paragraph(&format!(
        "{} To settle it: {}.",
        outcome.next_experiment.why, outcome.next_experiment.what
    ));
    for note in &outcome.notes {
        page = page.paragraph(&format!("Note: {note}."));
    }
    page.paragraph(&content.method)
}

/// Where an unlisted effect acts, and its function of one variable, where they are known.
fn unlisted_function(page: Page, unlisted: &UnlistedTable, force_unit: Option<&str>) -> Page {
    let mut page = page;
    if !unlisted.unexplained.is_empty() {
        let places = unlisted
            .unexplained
            .iter()
            .map(|p| [p.place.clone(), format!("{:.0} %", 100.0 * p.share)]);
        let table = Table::new(["a torque at the", "leaves unexplained"]).rows(places);
        page = page.heading("Where it acts").table(table, PLACES);
    }
    if unlisted.table.is_empty() {
        return page;
    }
    let most = unlisted.table.iter().fold(0.0, |most: f64, row| most.max(row[1].abs()));
    // Without data the band extends over the whole figure.
    let half = |std: f64| if std.is_finite() { std.min(most) } else { most };
    let column =
        |of: &dyn Fn(&[f64; 3]) -> f64| unlisted.table.iter().map(of).collect::<Vec<f64>>();
    let x = column(&|row| row[0]);
    let [low, high] = [-1.0, 1.0].map(|sign| column(&|row| row[1] + sign * half(row[2])));
    let of = match force_unit {
        Some(unit) => format!("force / {unit}"),
        None => format!("at the {}", unlisted.site),
    };
    let figure = Figure::new("Unlisted effect", unlisted.depends_on.replace('_', " "), of)
        .line(Colour::Blue, "", &x, &column(&|row| row[1]))
        .band(Colour::Blue, "", &x, &low, &high);
    page.figure(
        &figure,
        "Nonparametric function of one variable, fitted beside the model (line), with one standard \
         deviation to either side (band).",
    )
}

/// Caption of the table of places.
const PLACES: &str = "The frequency response of master and slave to a torque depends on where it \
                      acts. Share of the residual power above the repeatability that no torque at \
                      the place explains: the effect acts where little is left. Where every place \
                      leaves much, it acts between master and slave. Motor and master cannot be \
                      distinguished.";

/// Caption of the table of false alarms.
const FALSE_ALARMS: &str = "How probable it is that a machine without the effect would have been \
                            given a name with at least its gain. The search is linearised; a \
                            replicate is what the model with all effects leaves, resampled, and a \
                            small error of the model.";

/// Errors of each channel.
fn errors(outcome: &Outcome) -> Table {
    let known = |value: Option<f64>| value.map_or("–".to_owned(), short);
    let row = |(channel, error): (&String, &ChannelError)| {
        [
            channel.clone(),
            known(error.declared),
            short(error.before),
            short(error.after),
            known(error.floor),
            error.unit.clone(),
        ]
    };
    let header =
        ["channel", "rig file as it is", "declared model, fitted", "with effects", "floor", "unit"];
    Table::new(header).rows(outcome.error.iter().map(row))
}

/// Errors after each step.
fn steps(outcome: &Outcome) -> Table {
    let header =
        ["model", "fitting rows / %", "selection rows / %", "reporting rows / %", "all rows / %"];
    let row = |(i, s): (usize, &StepError)| {
        let model = if i == 0 { "declared".to_owned() } else { format!("+ {}", s.model) };
        let numbers = [s.fit_percent, s.select_percent, s.report_percent, s.all_rows_percent];
        std::iter::once(model).chain(numbers.map(|n| format!("{n:.2}")))
    };
    Table::new(header).rows(outcome.steps.iter().enumerate().map(row))
}

/// Effects that are visible but not accepted.
fn left(left: &[Left]) -> Table {
    let row = |l: &Left| {
        let parameters =
            l.parameters.iter().map(|p| format!("{} {} {}", p.name, short(p.value), p.unit));
        let parameters = parameters.collect::<Vec<_>>().join(", ");
        [
            what_is_left(l),
            short(l.size),
            l.unit.clone(),
            format!("{:.1}", l.gain_percent),
            format!("{:.1}", l.t),
            if parameters.is_empty() { "–".to_owned() } else { parameters },
        ]
    };
    Table::new(["what", "size", "unit", "error falls by / %", "block t", "parameters"])
        .rows(left.iter().map(row))
}
