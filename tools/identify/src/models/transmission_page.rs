//! The page of a transmission: measurement against model, residual plots, candidates, parameters.

use plant::effects::Site;
use report::Colour::{Black, Blue, Green, Grey};
use report::{Figure, Page, Table, Tone};

use super::bootstrap;
use super::effect_descriptions::{OTHER_ENCODER, words};
use super::transmission_residual_plots::maps;
use super::transmission_study::Study;
use crate::equation_error::block_roles::Role;
use crate::naming::{held, labels};
use crate::outcome::{Named, Outcome, UnlistedTable, Verdict};
use crate::outcome_tables::{candidates_and_parameters, short};
use crate::prediction_error::fit::Dataset;
use crate::prediction_error::transmission_model::{Channel, Residual};
use crate::prediction_error::validation::{LEAST_T, least_beside};
use crate::residual_figures::drawn;

/// Where an effect acts.
fn place(site: &str) -> String {
    if site == Site::Line.name() { "in the line".to_owned() } else { format!("at the {site}") }
}

/// Where an effect of unknown shape acts.
fn place_unlisted(site: &str) -> String {
    if site == Site::Line.name() { "between master and slave".to_owned() } else { place(site) }
}

/// Returns the verdict as a sentence, and one on its accuracy.
pub(super) fn sentences(outcome: &Outcome) -> (Tone, String, String) {
    let names: Vec<String> = outcome
        .effects
        .iter()
        .map(|effect| format!("{} {}", words(&effect.id), place(&effect.site)))
        .collect();
    let list = names.join(", and ");
    let (tone, sentence) = match outcome.verdict {
        Verdict::Effect => (Tone::Neutral, format!("The declared model lacks {list}.")),
        Verdict::Ambiguous => {
            let itself = |named: &Named| {
                outcome.effects.iter().any(|own| (&own.id, &own.site) == (&named.id, &named.site))
            };
            let other = |named: &Named| match itself(named) {
                true => OTHER_ENCODER.to_owned(),
                false => format!("{} {}", words(&named.id), place(&named.site)),
            };
            let others: Vec<String> = outcome.ambiguous_with.iter().map(other).collect();
            (
                Tone::Warning,
                format!("The declared model lacks {list}, or else {}.", others.join(" or ")),
            )
        }
        Verdict::None => {
            let fitted = "the declared model, fitted within its tolerances, explains them";
            (Tone::Good, format!("These records show no missing effect: {fitted}."))
        }
        Verdict::Unlisted => {
            let of = outcome.unlisted.as_ref().map_or(String::new(), |unlisted| {
                match unlisted.variable() {
                    Some(variable) => {
                        format!("; it acts at the {} and depends on {variable}", unlisted.site)
                    }
                    None => format!(
                        "; it acts {}, and no function of one variable explains it",
                        place_unlisted(&unlisted.site)
                    ),
                }
            });
            (
                Tone::Warning,
                format!("The model lacks something that no listed effect explains{of}."),
            )
        }
    };
    let mut detail = String::from(
        "On the reporting records, which took no part in fitting or selection, the innovation rms \
         is",
    );
    for (index, (channel, error)) in outcome.error.iter().enumerate() {
        let comma = if index == 0 { "" } else { ";" };
        let after = with_unit(error.after, &error.unit);
        detail += &format!("{comma} {after} of {channel}");
        if !outcome.effects.is_empty() {
            detail += &format!(" (before: {})", with_unit(error.before, &error.unit));
        }
        if let Some(floor) = error.floor {
            detail += &format!(" at a repeatability of {}", with_unit(floor, &error.unit));
        }
    }
    detail.push('.');
    if let Some(calibration) = &outcome.calibration {
        detail += &format!(" {}", bootstrap::sentence(calibration));
    }
    if outcome.remains && outcome.verdict != Verdict::Unlisted {
        let of = outcome.unlisted.as_ref().map_or(String::new(), |unlisted| {
            let on = unlisted
                .variable()
                .map_or(String::new(), |variable| format!(" that depends on {variable}"));
            format!(" at the {}{on}", unlisted.site)
        });
        detail += &format!(" A residual remains{of} that no listed effect explains.");
    }
    (tone, sentence, detail)
}

/// A value with its unit: small angles in mrad.
fn with_unit(value: f64, unit: &str) -> String {
    match unit {
        "rad" if value.abs() < 0.1 => format!("{} mrad", short(1e3 * value)),
        _ => format!("{} {unit}", short(value)),
    }
}

/// The whole page; `None` where a model cannot be simulated.
pub(super) fn page(study: &Study, outcome: &Outcome) -> Option<Page> {
    let model = &study.model;
    let report = model.of_role(Role::Report);
    let dataset = Dataset { model, records: report.clone() };
    let before = dataset.residuals(&study.found.base.setting)?;
    let after = dataset.residuals(&study.found.last().setting)?;
    let (tone, sentence, detail) = sentences(outcome);
    let with = !outcome.effects.is_empty();
    let names = labels(model.records.iter().map(|record| record.name.as_str()));
    let mut page = Page::new("What the model lacks")
        .subtitle(&format!("Declared transmission compared with {}", held(&names)))
        .verdict(tone, &sentence, &detail)
        .table(
            errors(outcome),
            "Root mean square of the innovation (one-step prediction error of the observer) on the \
             reporting records, averaged over 4 ms. The floor is the rms difference of repeated \
             records over √2.",
        )
        .heading("Measured against model");
    for (at, index) in report.iter().take(3).enumerate() {
        page = record(page, study, (names[*index], *index), (&before[at], &after[at]), with);
    }
    page = page.heading("What the residual depends on").paragraph(
        "Mean of the innovation in bins (line) and one standard deviation to either side (band), \
         and its spectrum; reporting records. A mean away from zero is something that the model \
         lacks.",
    );
    for channel in [Channel::Master, Channel::Slave, Channel::Torque] {
        page = maps(page, study, &report, channel, (&before, &after), with);
    }
    if let Some(unlisted) =
        outcome.unlisted.as_ref().filter(|unlisted| !unlisted.unexplained.is_empty())
    {
        page = page.heading("Where it acts").table(places(unlisted), PLACES);
    }
    if let Some(unlisted) = outcome.unlisted.as_ref().filter(|unlisted| !unlisted.table.is_empty())
    {
        let column =
            |index: usize| unlisted.table.iter().map(|row| row[index]).collect::<Vec<f64>>();
        let value = column(1);
        let most = value.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        // Without data the band extends over the whole figure.
        let half = |std: f64| if std.is_finite() { std.min(most) } else { most };
        let bound = |sign: f64| {
            unlisted.table.iter().map(|row| row[1] + sign * half(row[2])).collect::<Vec<f64>>()
        };
        let figure = Figure::new(
            "What is left",
            unlisted.depends_on.clone(),
            format!("at the {}", unlisted.site),
        )
        .line(Blue, "", &column(0), &value)
        .band(Blue, "", &column(0), &bound(-1.0), &bound(1.0));
        page = page.figure(
            &figure,
            "Nonparametric function of one variable, fitted beside the model (line), with one \
             standard deviation to either side (band).",
        );
    }
    let accepted = format!(
        "Each candidate is fitted on the fitting records beside all declared parameters, and \
         validated on the selection ones. It is added when the errors of all channels, multiplied, \
         fall by {:.0} % or more (beside one effect by {:.0} %, beside two by {:.0} %), when that \
         is {LEAST_T:.1} of its standard errors above zero, when more records get better than \
         worse, and when no channel gets worse by more than 3 % (for a first effect by a fifth of \
         what all gain). Reporting records decide nothing; only the differences of repeated ones \
         enter, as the floor.",
        asked(0),
        asked(1),
        asked(2)
    );
    let captions = (
        accepted.as_str(),
        "All candidates that were fitted, round by round. Nonparametric ones are functions of one \
         variable.",
        "Parameters of the model with its effects, from the fitting records; ± is one standard \
         deviation, by blocks.",
    );
    Some(candidates_and_parameters(page, outcome, captions))
}

/// Least gain of an effect beside so many, in percent.
fn asked(beside: usize) -> f64 {
    -100.0 * (-least_beside(beside)).exp_m1()
}

/// Caption of the table of places.
const PLACES: &str = "The frequency response of master and slave to a torque depends on where it \
                      acts. Share of the residual power above the repeatability that no torque at \
                      the place explains: the effect acts where little is left. Where every place \
                      leaves much, it acts between master and slave. Motor and master cannot be \
                      distinguished.";

fn places(unlisted: &UnlistedTable) -> Table {
    unlisted
        .unexplained
        .iter()
        .fold(Table::new(["a torque at the", "leaves unexplained"]), |table, place| {
            table.row([place.place.clone(), format!("{:.0} %", 100.0 * place.share)])
        })
}

fn errors(outcome: &Outcome) -> Table {
    let mut table = Table::new([
        "channel",
        "rig file as it is",
        "declared model, fitted",
        "with effects",
        "floor",
        "unit",
    ]);
    for (channel, error) in &outcome.error {
        let known = |value: Option<f64>| value.map_or("–".to_owned(), short);
        let (before, after) = (short(error.before), short(error.after));
        table = table.row([
            channel.clone(),
            known(error.declared),
            before,
            after,
            known(error.floor),
            error.unit.clone(),
        ]);
    }
    table
}

fn record(
    page: Page,
    study: &Study,
    (label, index): (&str, usize),
    (before, after): (&Residual, &Residual),
    with: bool,
) -> Page {
    let record = &study.model.records[index];
    let time = record.residual_times();
    let mut position = Figure::new("Position", "time / s", "position / rad").size(680, 260).line(
        Black,
        "master",
        &time,
        &record.averaged(&record.master)[..time.len()],
    );
    if let Some(slave) = &record.slave {
        position = position.line(Green, "slave", &time, &record.averaged(slave)[..time.len()]);
    }
    let mut page = page.figure(&position, &format!("{label}: measured movement."));
    for (at, channel) in study.model.channels(index).into_iter().enumerate() {
        let figure = Figure::new(
            "Innovation",
            "time / s",
            format!("{} / {}", channel.column(), channel.unit()),
        )
        .size(680, 260);
        let figure = drawn(&before.channels[at], &after.channels[at], with)
            .into_iter()
            .fold(figure, |figure, (name, colour, residual)| {
                figure.line(colour, name, &time, residual)
            });
        page = page.figure(
            &figure.horizontal(Grey, "", 0.0),
            &format!("{label}: innovation of {}.", channel.column()),
        );
    }
    page
}
