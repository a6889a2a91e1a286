//! The trend as text for a terminal.

use super::numbers::{with_error, with_tolerance};
use super::quantity::Movement;
use super::result::{Estimate, ParameterTrend, Standing, Trend};
use crate::outcome::ChannelError;
use crate::outcome_tables::short;

/// The header of the table of parameters.
pub(super) fn header(trend: &Trend) -> [String; 7] {
    let drift = format!("drift per {}", trend.per());
    ["parameter", "unit", "declared", "mean", "today", drift.as_str(), "change"].map(str::to_owned)
}

/// A row of that table.
pub(super) fn row(parameter: &ParameterTrend) -> [String; 7] {
    let estimate =
        |own: Option<Estimate>| own.map_or("–".to_owned(), |own| with_error(own.value, own.std));
    let movement = match (parameter.movement, &parameter.changes[..]) {
        (Movement::Unknown, _) => format!("not told ({} recordings)", parameter.told.len()),
        (Movement::Constant, _) => "none".to_owned(),
        (Movement::Drift, _) => "drifts".to_owned(),
        (Movement::Steps, changes) => {
            let when = |change: &super::result::Change| match &change.between {
                Some([_, since]) => since.clone(),
                None => change.since.clone(),
            };
            changes.iter().map(when).collect::<Vec<_>>().join(", ")
        }
    };
    let remark = match parameter.standing {
        Standing::AtBound | Standing::Indifferent => ", at the bound",
        Standing::WithinTolerance => ", off the declared value",
        Standing::Agrees | Standing::Unknown => "",
    };
    [
        parameter.name.clone(),
        parameter.unit.clone(),
        with_tolerance(parameter.declared, parameter.tolerance),
        estimate(parameter.mean),
        estimate(parameter.today),
        estimate(parameter.drift),
        format!("{movement}{remark}"),
    ]
}

/// The errors of a recording: with declared values, and with fitted ones.
pub(super) fn errors<'a>(errors: impl Iterator<Item = (&'a String, &'a ChannelError)>) -> String {
    let one = |(channel, error): (&String, &ChannelError)| {
        let declared = error.declared.map_or("–".to_owned(), short);
        format!("{channel} {declared} → {} {}", short(error.before), error.unit)
    };
    errors.map(one).collect::<Vec<_>>().join(", ")
}

/// The parameters that no recording tells, in a sentence.
pub(super) fn untold(trend: &Trend) -> Option<String> {
    let untold = trend.parameters.iter().filter(|own| own.told.is_empty());
    let names: Vec<&str> = untold.map(|own| own.name.as_str()).collect();
    (!names.is_empty()).then(|| format!("Not told by these recordings: {}.", names.join(", ")))
}

/// The whole text.
pub(super) fn text(trend: &Trend) -> String {
    let mut text = format!("{}\n", trend.sentence);
    for detail in &trend.details {
        text += &format!("  {detail}\n");
    }
    text += "\n";
    let rows: Vec<[String; 7]> =
        std::iter::once(header(trend)).chain(trend.told().map(row)).collect();
    let wide = |column: usize| {
        rows.iter().map(|row| row[column].chars().count()).max().unwrap_or_default()
    };
    for row in &rows {
        let cells = row.iter().enumerate().map(|(column, cell)| {
            let padding = wide(column) - cell.chars().count();
            format!("{cell}{}", " ".repeat(padding))
        });
        text += &format!("  {}\n", cells.collect::<Vec<_>>().join("  ").trim_end());
    }
    if let Some(untold) = untold(trend) {
        text += &format!("  {untold}\n");
    }
    text += "\n";
    for recording in &trend.recordings {
        let began = recording.began.as_deref().unwrap_or("no date");
        let effects = recording.effects.as_ref().map_or(String::new(), |effects| {
            let found = if effects.is_empty() { "none".to_owned() } else { effects.join(", ") };
            format!("; effects: {found}")
        });
        let errors = errors(recording.error.iter());
        text += &format!(
            "  {began}  {}: {errors}{effects} ({:.1} s)\n",
            recording.file, recording.seconds
        );
    }
    for left in &trend.left_out {
        text += &format!("  left out: {}: {}\n", left.file, left.reason);
    }
    text
}
