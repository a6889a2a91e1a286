//! How probable it is that the names given to a transmission are false alarms.

use super::effect_descriptions::words;
use super::transmission_study::Study;
use crate::deadline::Deadline;
use crate::equation_error::block_roles::Role;
use crate::false_alarm::FalseAlarm;
use crate::prediction_error::covariance::MODEL_ERROR;
use crate::prediction_error::dataset::{Dataset, Fitted};
use crate::prediction_error::score_bootstrap::{Replicates, score_bootstrap};
use crate::prediction_error::validation::Validation;

/// Replicates: enough to tell a probability of 0.002.
const REPLICATES: usize = 499;
/// Fit rounds of a model without its last effect.
const WITHOUT_LAST_FIT_ROUNDS: usize = 4;

/// Finds the probabilities of false alarms of all effects found, each beside those before it. After
/// the deadline those that were not found are noted: the answer does not depend on them, and is not
/// early for that.
pub(super) fn find_false_alarms(study: &mut Study<'_>, seed: u64) {
    let deadline = study.deadline.part(1.0);
    let mut with = study.found.last().clone();
    // The last effect first: each model without its last effect begins with the one before.
    let mut false_alarms = Vec::new();
    for (beside, step) in study.found.steps.iter().enumerate().rev() {
        let of = Tested { validation: &step.added, beside };
        let Some((null, own)) = of.false_alarm(study, &with, (seed, &deadline)) else { break };
        false_alarms.push(own);
        with = null;
    }
    false_alarms.reverse();
    study.false_alarms = false_alarms;
    if study.found.steps.len() > study.false_alarms.len() {
        study.notes.push(match deadline.has_passed() {
            true => {
                "the time limit (--limit-s) passed before the probability of a false alarm was \
                     known of every effect"
                    .to_owned()
            }
            false => "the probability of a false alarm is not known of every effect: the model \
                      without it cannot be simulated"
                .to_owned(),
        });
    }
}

/// An effect beside those before it.
struct Tested<'a> {
    validation: &'a Validation,
    /// Number of effects before it.
    beside: usize,
}

impl Tested<'_> {
    /// The model without the effect, fitted from the one `with` it, and the probability; `None` if
    /// that cannot be simulated, or after the deadline.
    fn false_alarm(
        &self,
        study: &Study<'_>,
        with: &Fitted,
        (seed, deadline): (u64, &Deadline),
    ) -> Option<(Fitted, FalseAlarm)> {
        let found = &study.found;
        let [fit, select] =
            [Role::Fit, Role::Select].map(|role| Dataset::of(&study.model, role).until(deadline));
        if deadline.has_passed() {
            return None;
        }
        let null = match self.beside {
            0 => found.base.clone(),
            beside => fit.fit_without(with, beside, WITHOUT_LAST_FIT_ROUNDS)?,
        };
        let over_octaves = self.validation.over_octaves;
        let replicates =
            Replicates { count: REPLICATES, seed, model_error: MODEL_ERROR, over_octaves };
        let gains = score_bootstrap((&fit, &select), &null, &found.last().setting, replicates)?;
        let own = FalseAlarm {
            id: self.validation.id.to_owned(),
            site: self.validation.site.name().to_owned(),
            gain_percent: self.validation.gain_percent(),
            replicates: gains.replicates(),
            as_much: gains.as_much(self.validation.gain),
            probability: gains.probability(self.validation.gain),
        };
        Some((null, own))
    }
}

/// The probabilities as a sentence; `None` where there are none.
pub(super) fn sentence(false_alarms: &[FalseAlarm]) -> Option<String> {
    let (first, others) = false_alarms.split_first()?;
    let count = |own: &FalseAlarm| match own.as_much {
        0 => "none".to_owned(),
        as_much => as_much.to_string(),
    };
    let of = |own: &FalseAlarm| format!("{} ({})", words(&own.id), own.site);
    let mut sentence = format!(
        "Of {} linearised replicates without {}, {} had a candidate with at least its gain ({})",
        first.replicates,
        of(first),
        count(first),
        first.p_value()
    );
    for own in others {
        sentence += &format!("; without {}, {} had ({})", of(own), count(own), own.p_value());
    }
    Some(sentence + ".")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_name_has_its_probability() {
        let of = |id: &str, as_much: usize| FalseAlarm {
            id: id.into(),
            site: "slave".into(),
            gain_percent: 30.0,
            replicates: 499,
            as_much,
            probability: (1 + as_much) as f64 / 500.0,
        };
        let two = [of("backlash", 0), of("leakage", 30)];
        let told = sentence(&two).unwrap_or_default();
        assert!(told.starts_with("Of 499 linearised replicates without "), "{told}");
        assert!(
            told.contains(
                "(slave), none had a candidate with at least its gain (p < 0.002); without"
            )
        );
        assert!(told.ends_with("30 had (p = 0.062)."), "{told}");
        assert_eq!(sentence(&[]), None);
    }
}
