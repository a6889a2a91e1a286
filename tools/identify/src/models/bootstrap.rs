//! Significance of the last effect by the parametric bootstrap.

use super::transmission_study::Study;
use crate::false_alarm::SIGNIFICANT;
use crate::outcome::{Calibration, Named};
use crate::prediction_error::null_gains::NullGains;
use crate::prediction_error::parametric_bootstrap::{ServoGains, parametric_bootstrap};
use crate::prediction_error::validation::gain_percent;

/// Runs the bootstrap with `machines` replicates without the last effect, and withdraws that effect
/// if it is not significant.
pub(super) fn calibrate(study: &mut Study<'_>, servo: ServoGains, machines: usize, seed: u64) {
    let (model, found, deadline) = (&study.model, &study.found, study.deadline);
    if found.unfinished.is_some() {
        return;
    }
    let bootstrap = parametric_bootstrap(model, found, servo, machines, seed, deadline);
    let bootstrap = bootstrap.unwrap_or_default();
    let unsearched = bootstrap.unsearched;
    if unsearched > 0 {
        study.notes.push(format!(
            "the time limit (--limit-s) ended --calibrate early: {unsearched} of {machines} \
             machines were not searched and are not counted"
        ));
    }
    let lost = machines - unsearched - bootstrap.gains.replicates();
    if lost > 0 {
        study.notes.push(format!(
            "{lost} of {machines} machines for --calibrate could not be simulated along these \
             records and are not counted"
        ));
    }
    if bootstrap.gains.replicates() == 0 {
        return;
    }
    let mut calibration = Calibration {
        machines: bootstrap.gains.replicates(),
        alarms: bootstrap.alarms,
        gains_percent: bootstrap.gains.0.iter().copied().map(gain_percent).collect(),
        of: None,
        as_much: None,
        probability: None,
        withdrawn: false,
    };
    if let Some(step) = study.found.steps.last() {
        let gain = step.added.gain;
        calibration.of = Some(Named::new(step.added.id, step.added.site));
        calibration.as_much = Some(bootstrap.gains.as_much(gain));
        calibration.probability = Some(bootstrap.gains.probability(gain));
        calibration.withdrawn = too_often(&bootstrap.gains, gain);
    }
    if calibration.withdrawn && study.found.without_last(&study.model).is_none() {
        calibration.withdrawn = false;
        study.notes.push(
            "the effect is not significant, but the model without it cannot be simulated: it is \
             kept"
                .to_owned(),
        );
    }
    if calibration.withdrawn {
        study.found.reassess(&study.model, deadline);
    }
    study.calibration = Some(calibration);
}

/// Few replicates cannot show a small p-value: an effect is withdrawn only if one of them exceeds
/// its gain.
fn too_often(gains: &NullGains, gain: f64) -> bool {
    gains.as_much(gain) > 0 && gains.probability(gain) > SIGNIFICANT
}

/// The result as a sentence.
pub(super) fn sentence(calibration: &Calibration) -> String {
    let Calibration { machines, alarms, .. } = calibration;
    match (&calibration.of, calibration.as_much, calibration.probability) {
        (Some(of), Some(as_much), Some(probability)) => {
            let words = super::effect_descriptions::words(&of.id);
            let taken =
                if calibration.withdrawn { "; the effect is therefore withdrawn" } else { "" };
            format!(
                "Of {machines} simulated machines without {words} ({}), {as_much} gave at least \
                 this gain (p = {probability:.2}){taken}.",
                of.site
            )
        }
        _ => format!(
            "Of {machines} simulated machines without a missing effect, {alarms} gave a false \
             alarm."
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_is_withdrawn_if_replicates_reach_its_gain_not_if_they_are_few() {
        let of = NullGains;
        // 1 of 39 and the one at hand are 0.05.
        assert!(!too_often(&of([vec![0.0; 38], vec![0.5]].concat()), 0.4));
        assert!(too_often(&of([vec![0.0; 18], vec![0.5]].concat()), 0.4));
        assert!(too_often(&of(vec![0.0, 0.5, 0.0]), 0.4));
        assert!(!too_often(&of(vec![0.0, 0.3, 0.0]), 0.4));
    }
}
