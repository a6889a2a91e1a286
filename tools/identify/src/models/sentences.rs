//! The verdict and the errors as sentences, for all kinds of models.

use plant::effects::Site;
use report::Tone;

use super::bootstrap;
use super::effect_descriptions::{other_instrument, words};
use super::false_alarms;
use crate::effects::find;
use crate::outcome::{
    AtBounds, FoundEffect, Named, Outcome, UNKNOWN, UnlistedTable, Unsettled, Verdict,
};
use crate::outcome_tables::short;

/// What is said of an answer that the time limit forced.
const EARLY: &str =
    " This answer is early: the time limit (--limit-s) passed before all work was done.";

/// Where an effect acts.
fn place(site: &str) -> String {
    if site == Site::Line.name() { "in the line".to_owned() } else { format!("at the {site}") }
}

/// Where an effect of unknown shape acts.
fn place_unlisted(site: &str) -> String {
    if site == Site::Line.name() { "between master and slave".to_owned() } else { place(site) }
}

/// Returns the verdict as a sentence, and one on the errors. `located` tells whether the search
/// finds where an effect acts: it does for transmissions.
pub(crate) fn sentences(outcome: &Outcome, located: bool) -> (Tone, String, String) {
    let (mut tone, mut sentence) = verdict(outcome, located);
    if let Some(axis) = &outcome.axis {
        sentence = format!("Axis \"{axis}\": {}", behind_a_colon(&sentence));
    }
    if outcome.early {
        tone = Tone::Warning;
        sentence += EARLY;
    }
    if let Some(at_bounds) = &outcome.at_bounds {
        sentence += &bounds(at_bounds);
        if outcome.verdict == Verdict::None {
            tone = Tone::Warning;
        }
    }
    let mut detail =
        String::from("Root-mean-square error on rows that took no part in fitting or selection:");
    for (index, (channel, error)) in outcome.error.iter().enumerate() {
        let comma = if index == 0 { "" } else { ";" };
        let value = |value: f64| with_unit(value, &error.unit);
        let (after, percent) = (value(error.after), error.after_percent);
        detail += &format!("{comma} {after} of {channel}, {percent:.2} % of its root mean square");
        let before = (!outcome.effects.is_empty())
            .then(|| format!("before: {}, {:.2} %", value(error.before), error.before_percent));
        let floor = error.floor.map(|floor| format!("repeatability: {}", value(floor)));
        let beside: Vec<String> = before.into_iter().chain(floor).collect();
        if !beside.is_empty() {
            detail += &format!(" ({})", beside.join("; "));
        }
    }
    detail.push('.');
    if let Some(sentence) = false_alarms::sentence(&outcome.false_alarms) {
        detail += &format!(" {sentence}");
    }
    if let Some(calibration) = &outcome.calibration {
        detail += &format!(" {}", bootstrap::sentence(calibration));
    }
    match &outcome.unlisted {
        _ if !outcome.remains || outcome.verdict == Verdict::Unlisted => {}
        _ if located && outcome.verdict == Verdict::Inadequate => {}
        None if !located && outcome.effects.is_empty() => {}
        None if !located && more_show(outcome) => {
            detail += " More than three effects show; the others are listed under “What is left”.";
        }
        unlisted => {
            let of = |unlisted: &UnlistedTable| {
                let at = if located { format!(" at the {}", unlisted.site) } else { String::new() };
                let on = unlisted.variable().map(|on| format!(" that depends on {on}"));
                at + &on.unwrap_or_default()
            };
            let of = unlisted.as_ref().map_or(String::new(), of);
            detail += &format!(" A residual remains{of}, and no listed effect explains it.");
        }
    }
    (tone, sentence, detail)
}

/// A sentence that continues one.
fn behind_a_colon(sentence: &str) -> String {
    let mut letters = sentence.chars();
    let first = letters.next().map(|letter| letter.to_lowercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

/// Whether an effect passes beside those that are named.
fn more_show(outcome: &Outcome) -> bool {
    let after = outcome.effects.len() + 1;
    outcome.candidates.iter().any(|own| own.round == after && !own.generic && own.accepted)
}

/// Which parameters ended at the bounds of their tolerances, and how much of the error the
/// tolerances took, as a sentence after the verdict.
fn bounds(at_bounds: &AtBounds) -> String {
    let (names, what) = match &at_bounds.parameters[..] {
        [one] => (one.clone(), "the bound of its tolerance"),
        many => (many.join(", "), "the bounds of their tolerances"),
    };
    let mut taken: Vec<String> = at_bounds
        .error_taken_percent
        .iter()
        .filter(|(_, percent)| **percent >= 1.0)
        .map(|(channel, percent)| format!("{percent:.0} % of the error of {channel}"))
        .collect();
    if taken.is_empty() && !at_bounds.error_taken_percent.is_empty() {
        taken.push("less than 1 % of the error".to_owned());
    }
    let taken = match taken.is_empty() {
        true => String::new(),
        false => {
            let taken = taken.join(" and ");
            format!(": against the declared values, the fit within all tolerances took {taken}")
        }
    };
    format!(" But {names} ended at {what}{taken}.")
}

/// What is said of a transmission whose declared model is refuted before every effect was tried.
fn inadequate_early(outcome: &Outcome) -> String {
    let place = |unlisted: &UnlistedTable| {
        let on = unlisted.variable().map(|on| format!(", depending on {on}"));
        format!(" {}{}", place_unlisted(&unlisted.site), on.unwrap_or_default())
    };
    let place = outcome.unlisted.as_ref().map_or(String::new(), place);
    format!(
        "The declared model does not describe this machine: something is missing{place}. A listed \
         effect may explain it, as not every one was tried."
    )
}

/// What is said of an effect that chance may have given as large a gain.
fn not_significant(outcome: &Outcome, effect: &FoundEffect) -> Option<String> {
    let alarm = outcome.false_alarm(effect).filter(|own| own.is_insignificant())?;
    Some(format!(" (not significant, {})", alarm.p_value()))
}

/// The verdict.
fn verdict(outcome: &Outcome, located: bool) -> (Tone, String) {
    let named = |id: &str, site: &str| match located {
        true => format!("{} {}", words(id), place(site)),
        false => find(id).map_or(id, |effect| effect.words).to_owned(),
    };
    let own: Vec<String> = outcome
        .effects
        .iter()
        .map(|own| named(&own.id, &own.site) + &not_significant(outcome, own).unwrap_or_default())
        .collect();
    let list = own.join(", and ");
    match outcome.verdict {
        Verdict::Effect => {
            let doubtful =
                outcome.effects.iter().any(|own| not_significant(outcome, own).is_some());
            let tone = if doubtful { Tone::Warning } else { Tone::Neutral };
            (tone, format!("The declared model lacks {list}."))
        }
        Verdict::Ambiguous => {
            let is_itself = |rival: &Named| {
                outcome.effects.iter().any(|own| (&own.id, &own.site) == (&rival.id, &rival.site))
            };
            let other = |rival: &Named| match is_itself(rival) {
                true => other_instrument(&rival.id).to_owned(),
                false => named(&rival.id, &rival.site),
            };
            let others: Vec<String> = outcome.ambiguous_with.iter().map(other).collect();
            let others = others.join(" or ");
            (Tone::Warning, format!("The declared model lacks {list}, or else {others}."))
        }
        Verdict::None => {
            let fitted = "the declared model, fitted within its tolerances, explains them";
            (Tone::Good, format!("These records show no missing effect: {fitted}."))
        }
        Verdict::Inadequate if let Some(unsettled) = &outcome.unsettled => {
            (Tone::Warning, not_settled(unsettled))
        }
        Verdict::Inadequate if located => (Tone::Warning, inadequate_early(outcome)),
        Verdict::Inadequate => (
            Tone::Warning,
            "The declared model does not describe this machine, and no listed effect explains \
             most of the error."
                .to_owned(),
        ),
        Verdict::Undecided if !outcome.early => (
            Tone::Warning,
            "Whether the declared model lacks an effect is open: no record has the slave's \
             position, and the error that remains is no larger than what the slave's friction \
             near zero speed may leave."
                .to_owned(),
        ),
        Verdict::Undecided => (
            Tone::Warning,
            "Whether the declared model lacks an effect is open: an error remains, and not every \
             effect was tried."
                .to_owned(),
        ),
        Verdict::Unlisted => (Tone::Warning, unlisted(outcome, located)),
    }
}

/// That something without a name is missing, and what is known of it.
fn unlisted(outcome: &Outcome, located: bool) -> String {
    let of = |unlisted: &UnlistedTable| match (unlisted.variable(), located) {
        (Some(_), true) if let Some(share) = unlisted.regression_share => format!(
            "; it acts {} like {}, which explains {:.0} % of the squared error",
            place_unlisted(&unlisted.site),
            unlisted.resembles.as_deref().unwrap_or(UNKNOWN),
            100.0 * share
        ),
        (_, true) if let Some(like) = &unlisted.resembles => {
            format!("; it acts {} like {like}", place_unlisted(&unlisted.site))
        }
        (Some(on), true) => {
            format!("; it acts at the {} and depends on {on}", unlisted.site)
        }
        (Some(on), false) => match &unlisted.resembles {
            Some(like) => format!("; it depends on {on}, {like}"),
            None => format!("; it depends on {on}"),
        },
        (None, _) if outcome.early => {
            format!("; it acts {}", place_unlisted(&unlisted.site))
        }
        (None, _) => format!(
            "; it acts {}, and no function of one variable explains it",
            place_unlisted(&unlisted.site)
        ),
    };
    let of = outcome.unlisted.as_ref().map_or(String::new(), of);
    let lacks = "The model lacks something that no listed effect explains";
    format!("{lacks}{of}.")
}

/// What the records do not settle.
fn not_settled(unsettled: &Unsettled) -> String {
    let Unsettled { id, gain_percent, blocks_better, blocks } = unsettled;
    let what = find(id).map_or_else(|| format!("a function of {id}"), |own| own.words.to_owned());
    format!(
        "These records do not settle whether something is missing: {what} would take \
         {gain_percent:.0} % of the error and improves {blocks_better} of {blocks} blocks, which \
         is not significant."
    )
}

/// A value with its unit: small angles in mrad.
fn with_unit(value: f64, unit: &str) -> String {
    match unit {
        "rad" if value.abs() < 0.1 => format!("{} mrad", short(1e3 * value)),
        _ => format!("{} {unit}", short(value)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_at_their_bounds_are_told_with_what_the_tolerances_took() {
        let two = AtBounds {
            parameters: vec!["motor_coulomb_nm".into(), "port_damping_n_s_per_m".into()],
            error_taken_percent: [
                ("master_rad".to_owned(), 71.4),
                ("slave_rad".to_owned(), 93.0),
                ("slave_torque_nm".to_owned(), 0.2),
            ]
            .into(),
        };
        assert_eq!(
            bounds(&two),
            " But motor_coulomb_nm, port_damping_n_s_per_m ended at the bounds of their \
             tolerances: against the declared values, the fit within all tolerances took 71 % of \
             the error of master_rad and 93 % of the error of slave_rad."
        );
        let one = |percent: &[f64]| AtBounds {
            parameters: vec!["mass_kg".into()],
            error_taken_percent: percent.iter().map(|own| ("force_n".to_owned(), *own)).collect(),
        };
        assert_eq!(bounds(&one(&[])), " But mass_kg ended at the bound of its tolerance.");
        assert!(bounds(&one(&[-0.5])).ends_with("took less than 1 % of the error."));
    }
}
