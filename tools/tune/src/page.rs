//! The tuning as a part of a page.

use report::Colour::{Blue, Grey, Vermillion};
use report::{Figure, Page, Table};
use rig::AxisUnit;

use crate::proposal::Predicted;
use crate::tracking::Followed;
use crate::tuning::Tuning;

/// Wide figures, CSS pixels.
const WIDTH: u32 = 860;
/// Time that is drawn, from [`FROM_S`] on (s).
const SHOWN_S: f64 = 3.0;
/// Start of the time that is drawn (s).
const FROM_S: f64 = 5.0;

/// Adds what was proposed, why, and what it gained.
#[must_use]
pub fn section(page: Page, tuning: &Tuning) -> Page {
    let (factor, unit) = match tuning.unit {
        AxisUnit::Radian => (1f64.to_degrees(), "°"),
        AxisUnit::Metre => (1e3, "mm"),
    };
    let mut page = page.heading("Tracking before and after").paragraph(&sentence(tuning));
    let drawn = |followed: &Followed, of: fn(&Followed, usize) -> f64| {
        let rows = 0..followed.time_s.len();
        let shown = rows.filter(|row| (FROM_S..FROM_S + SHOWN_S).contains(&followed.time_s[*row]));
        let (time, values): (Vec<f64>, Vec<f64>) =
            shown.map(|row| (followed.time_s[row], factor * of(followed, row))).unzip();
        (time, values)
    };
    let before = &tuning.before.followed;
    let after = tuning.after.as_ref().map(|movement| &movement.followed);
    let label = |what: &str| format!("{what} / {unit}");
    let mut positions = Figure::new("Position of the handle", "time / s", label("position"));
    let mut errors = Figure::new("Tracking error", "time / s", label("desired - measured"));
    positions = positions.size(WIDTH, 300);
    errors = errors.size(WIDTH, 260);
    let (time, desired) = drawn(before, |followed, row| followed.desired[row]);
    positions = positions.dashed(Grey, "desired", &time, &desired);
    let error = |followed: &Followed, row: usize| followed.desired[row] - followed.measured[row];
    for (colour, name, followed) in [(Vermillion, "before", Some(before)), (Blue, "after", after)] {
        let Some(followed) = followed else { continue };
        let (time, measured) = drawn(followed, |followed, row| followed.measured[row]);
        positions = positions.line(colour, name, &time, &measured);
        let (time, error) = drawn(followed, error);
        errors = errors.line(colour, name, &time, &error);
    }
    page = page
        .figure(
            &positions,
            "Desired and measured position of the handle, with the rig file as it \
            was and with the one proposed.",
        )
        .figure(&errors, "Their difference.")
        .table(
            errors_table(tuning),
            "Tracking error without the first 3 s and the last second. \
            The predictions are simulations with the model that was identified from the \
            excitation; this movement took no part in the fit.",
        )
        .table(
            choices_table(tuning),
            "What was tried for the control, with its predicted error. \
            A choice with more parts must promise 3 % less.",
        );
    let remarks: Vec<String> = tuning
        .uncompensated_lines()
        .iter()
        .map(|line| line.replacen("remains     the law", "The law", 1) + ".")
        .chain(tuning.proposal.left_out.iter().map(|left| format!("Not written: {left}.")))
        .collect();
    if !remarks.is_empty() {
        page = page.paragraph(&remarks.join(" "));
    }
    page.details("The changes of the rig file", &tuning.diff())
}

fn sentence(tuning: &Tuning) -> String {
    let before = tuning.before.error.rms;
    match &tuning.after {
        Some(after) => format!(
            "The handle followed with a root-mean-square error of {} before, and of {} with the \
             proposed rig file: {:.0} % less ({} was predicted).",
            tuning.shown(before),
            tuning.shown(after.error.rms),
            100.0 * (1.0 - after.error.rms / before),
            tuning.shown(tuning.proposal.control.error.rms)
        ),
        None => format!(
            "The handle follows with a root-mean-square error of {}; {} is predicted with the \
             proposed rig file, which was not taken.",
            tuning.shown(before),
            tuning.shown(tuning.proposal.control.error.rms)
        ),
    }
}

fn errors_table(tuning: &Tuning) -> Table {
    let row = |what: &str, error: Option<&crate::tracking::TrackingError>| {
        let of = |value: Option<f64>| value.map_or("–".to_owned(), |value| tuning.shown(value));
        let lag = error.map_or("–".to_owned(), |error| format!("{:.1} ms", 1e3 * error.lag_s));
        [what.to_owned(), of(error.map(|e| e.rms)), of(error.map(|e| e.peak)), lag]
    };
    Table::new(["control", "rms", "peak", "lag"])
        .row(row("as it was, measured", Some(&tuning.before.error)))
        .row(row("as it was, predicted", Some(&tuning.proposal.before)))
        .row(row("proposed, predicted", Some(&tuning.proposal.control.error)))
        .row(row("proposed, measured", tuning.after.as_ref().map(|after| &after.error)))
}

fn choices_table(tuning: &Tuning) -> Table {
    let control = &tuning.proposal.control;
    let rows = control.choices.iter().map(|choice| {
        let (error, remark) = match &choice.predicted {
            Predicted::Predicted(error) => (tuning.shown(error.rms), String::new()),
            Predicted::Refused(why) => ("–".to_owned(), format!("refused: {why}")),
        };
        let chosen = choice.name == control.chosen.name;
        let remark = if chosen { "chosen".to_owned() } else { remark };
        let lead = choice.lead_s.map_or(String::new(), |lead| format!("{:.0} ms", 1e3 * lead));
        [choice.name.to_owned(), lead, error, remark]
    });
    Table::new(["control", "lead", "predicted rms", ""]).rows(rows)
}
