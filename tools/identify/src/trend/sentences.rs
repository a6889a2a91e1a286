//! The verdict on a trend in words.

use super::numbers::{with_error, with_tolerance};
use super::quantity::Movement;
use super::result::{Change, ParameterTrend, Standing, Trend, Verdict};
use crate::outcome_tables::short;

/// The verdict as a sentence, and sentences on what changed.
pub(super) fn sentences(trend: &Trend) -> (String, Vec<String>) {
    let count = trend.recordings.len();
    let sentence = match trend.verdict {
        Verdict::Same => "The machine is that of the rig file.".to_owned(),
        Verdict::Changed => format!(
            "The machine has changed: {}. Today all parameters that the recordings tell are within \
             the tolerances of the rig file.",
            names(trend, ParameterTrend::has_changed)
        ),
        Verdict::Outside => format!(
            "The machine is not that of the rig file: {} at the bound of the tolerance.",
            are(&names(trend, |own| own.standing == Standing::AtBound), count_of(trend))
        ),
        Verdict::Unknown => match count {
            1 => "The recording tells none of the declared parameters.".to_owned(),
            _ => "The recordings tell none of the declared parameters.".to_owned(),
        },
    };
    let mut details: Vec<String> = trend
        .parameters
        .iter()
        .flat_map(|parameter| match parameter.movement {
            Movement::Steps => parameter.changes.iter().map(|own| step(parameter, own)).collect(),
            Movement::Drift => drift(trend, parameter).into_iter().collect(),
            Movement::Unknown | Movement::Constant => Vec::new(),
        })
        .collect();
    details.extend(trend.parameters.iter().filter_map(standing));
    details.extend(error(trend));
    let is_told = |own: &&ParameterTrend| own.movement != Movement::Unknown;
    let told = trend.parameters.iter().filter(is_told).count();
    details.push(match (told, trend.verdict) {
        (0, _) => {
            "Too few recordings tell a parameter for changes to be told: six are needed.".to_owned()
        }
        (told, Verdict::Same) => format!(
            "{told} of {} declared parameters were followed over {count} recordings, and none has \
             changed.",
            trend.parameters.len()
        ),
        (told, _) => format!(
            "{told} of {} declared parameters were followed over {count} recordings.",
            trend.parameters.len()
        ),
    });
    (sentence, details)
}

/// Number of parameters at the bounds.
fn count_of(trend: &Trend) -> usize {
    trend.parameters.iter().filter(|own| own.standing == Standing::AtBound).count()
}

fn are(names: &str, count: usize) -> String {
    format!("{names} {}", if count == 1 { "is" } else { "are" })
}

fn names(trend: &Trend, which: impl Fn(&ParameterTrend) -> bool) -> String {
    let names: Vec<&str> =
        trend.parameters.iter().filter(|own| which(own)).map(|own| own.name.as_str()).collect();
    match names.split_last() {
        Some((last, [])) => (*last).to_owned(),
        Some((last, others)) => format!("{} and {last}", others.join(", ")),
        None => String::new(),
    }
}

/// A step in words.
fn step(parameter: &ParameterTrend, change: &Change) -> String {
    let verb = if change.to.value > change.from.value { "rose" } else { "fell" };
    let when = match &change.between {
        Some([from, to]) if from == to => format!("on {to}, first seen in {}", change.since),
        Some([from, to]) => format!("between {from} and {to}, first seen in {}", change.since),
        None => format!("between {} and {}", change.after, change.since),
    };
    format!(
        "{} {verb}{} {when}: from {} to {} {} ({} recordings before, {} after).",
        parameter.name,
        percent(change.from.value, change.to.value),
        with_error(change.from.value, change.from.std),
        with_error(change.to.value, change.to.std),
        parameter.unit,
        change.recordings_before,
        change.recordings_after
    )
}

/// By how many percent a value changed; empty where it was 0.
fn percent(from: f64, to: f64) -> String {
    let share = 100.0 * ((to - from) / from).abs();
    if share.is_finite() && from * to > 0.0 { format!(" by {share:.0} %") } else { String::new() }
}

/// A drift in words.
fn drift(trend: &Trend, parameter: &ParameterTrend) -> Option<String> {
    let (drift, today) = (parameter.drift?, parameter.today?);
    let verb = if drift.value > 0.0 { "rises" } else { "falls" };
    Some(format!(
        "{} {verb} steadily by {} {} a {}; it is {} today.",
        parameter.name,
        with_error(drift.value.abs(), drift.std),
        parameter.unit,
        trend.per(),
        with_error(today.value, today.std)
    ))
}

/// How well the values of the rig file describe the recordings since the last change.
fn error(trend: &Trend) -> Option<String> {
    let ratio = trend.error_ratio?;
    let which = match trend.since_last_change {
        1 => "the last recording".to_owned(),
        count if count == trend.recordings.len() => "the recordings".to_owned(),
        count => format!("the {count} recordings since the last change"),
    };
    Some(format!(
        "With the values of the rig file the error of {which} is {ratio:.2} times that with fitted \
         values."
    ))
}

/// Today's value where it does not agree with the declared one.
fn standing(parameter: &ParameterTrend) -> Option<String> {
    let today = parameter.today?;
    let (name, unit) = (&parameter.name, &parameter.unit);
    match parameter.standing {
        Standing::Indifferent => Some(format!(
            "{name} is at the bound of its tolerance, {} {unit}, declared {}, and has not \
             moved; the values of the rig file describe recordings about as well: they hardly tell \
             it.",
            short(today.value),
            with_tolerance(parameter.declared, parameter.tolerance)
        )),
        Standing::AtBound => Some(format!(
            "{name} is at the bound of its tolerance, {} {unit}, declared {}: it may be \
             beyond, or the model lacks an effect that acts like it (identify the last recordings \
             without --trend).",
            short(today.value),
            with_tolerance(parameter.declared, parameter.tolerance)
        )),
        Standing::WithinTolerance => Some(format!(
            "{name} is {} {unit} today, declared {}: they differ by more than the errors of a \
             recording, within the tolerance.",
            with_error(today.value, today.std),
            with_tolerance(parameter.declared, parameter.tolerance)
        )),
        Standing::Agrees | Standing::Unknown => None,
    }
}
