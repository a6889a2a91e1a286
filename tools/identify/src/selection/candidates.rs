//! Candidates of stepwise selection, and the choice among those that were fitted.

use super::validation::{Validation, validate};
use crate::effects::{Effect, all, find};
use crate::equation_error::model::{Column, Fitted, RegressionModel, Structure};

/// A rival is as good as the winner when its gain (in log error) is at least this share of the
/// winner's.
const RIVAL: f64 = 0.9;
/// The same for two effects that shift the force in time: below the cut-off a lag and a dead time
/// differ little, and the half sampling period of the zero-order hold favours the dead time.
const TIME_SHIFT_RIVAL: f64 = 0.8;

/// An effect at a site.
#[derive(Clone, Copy)]
pub struct SitedEffect {
    /// The effect.
    pub effect: &'static Effect,
    /// Its site.
    pub site: &'static str,
}

/// A model with some effects, fitted.
#[derive(Clone)]
pub struct FittedModel<'f> {
    /// Its effects.
    pub structure: Structure<'f>,
    /// Its fit: of the output error where the output is simulated.
    pub fitted: Fitted,
    /// Its equation-error fit, where the output is simulated.
    pub equation_error_fit: Option<Fitted>,
}

impl FittedModel<'_> {
    /// The fit that screening starts from.
    pub fn equation_error_fit(&self) -> &Fitted {
        self.equation_error_fit.as_ref().unwrap_or(&self.fitted)
    }
}

/// A candidate, fitted beside the current model and validated.
#[derive(Clone)]
pub struct FittedCandidate<'f> {
    /// The effect.
    pub sited: SitedEffect,
    /// Its validation.
    pub validation: Validation,
    /// The model with it.
    pub model: FittedModel<'f>,
    /// Mean squared residual of each selecting block.
    pub block_errors: Vec<f64>,
    /// Whether it was screened by its equation error only, where models are simulated: it cannot
    /// pass.
    pub screened_only: bool,
}

impl FittedCandidate<'_> {
    /// Decrease of the logarithm of the error.
    fn log_gain(&self) -> f64 {
        -(1.0 - self.validation.gain_percent / 100.0).max(1e-12).ln()
    }
}

/// Whether the model has that effect already: added, or declared as a parameter.
fn has(regression: &RegressionModel, added: &[SitedEffect], id: &str) -> bool {
    let same = find(id).and_then(|effect| effect.same_as).map(Column::of);
    same.is_some_and(|column| regression.declares(column))
        || added.iter().any(|a| a.effect.id == id)
}

/// Returns the candidates that are applicable beside the effects in the model.
pub fn candidates(
    regression: &RegressionModel,
    added: &[SitedEffect],
    current: &Fitted,
) -> Vec<SitedEffect> {
    let at_edge = |column| {
        regression
            .parameters
            .iter()
            .zip(&current.fit.at_bound)
            .any(|(p, edge)| p.column == column && *edge)
    };
    let rank = |site: &str| regression.sites.iter().position(|s| *s == site);
    let sited = |effect: &'static Effect| {
        let site = regression.sites.iter().find(|site| effect.sites.contains(site))?;
        Some(SitedEffect { effect, site })
    };
    let mut list: Vec<SitedEffect> = all()
        .into_iter()
        .filter_map(sited)
        .filter(|c| c.effect.repeats || !has(regression, added, c.effect.id))
        .filter(|c| (c.effect.applies)(&regression.axis))
        .filter(|c| c.effect.needs.iter().all(|need| has(regression, added, need)))
        .filter(|c| {
            !regression.frees(c.effect) || c.effect.lifts.map(Column::of).is_some_and(at_edge)
        })
        .collect();
    // Of two effects on the same parameter, the one at the first site is kept.
    let lifted: Vec<_> = list.iter().map(|c| (c.effect.lifts, rank(c.site))).collect();
    let taken = |(lifts, rank): &(Option<_>, Option<usize>)| {
        lifts.is_some() && lifted.iter().any(|(other, nearer)| other == lifts && nearer < rank)
    };
    let mut keep = lifted.iter().map(|l| !taken(l));
    list.retain(|_| keep.next().unwrap_or(true));
    list
}

/// Number of parameters of an effect.
fn freedom(regression: &RegressionModel, sited: &SitedEffect) -> usize {
    let terms = (sited.effect.terms)(&regression.axis);
    terms.iter().filter(|t| !t.is_given()).count() + (sited.effect.shapes)(&regression.axis).len()
}

/// Chooses, of the accepted candidates with about the best gain, the one with the fewest
/// parameters. A simpler effect that it contains as a limit takes its place unless it improves on
/// that by as much as an effect must. `tried` is in the order of gains.
pub fn best_accepted(
    regression: &RegressionModel,
    added: &[SitedEffect],
    tried: &[FittedCandidate<'_>],
) -> Option<usize> {
    let top = tried.iter().find(|t| t.validation.accepted)?.log_gain();
    let is_near = |t: &FittedCandidate<'_>| t.validation.accepted && t.log_gain() >= RIVAL * top;
    let best = (0..tried.len())
        .filter(|i| is_near(&tried[*i]))
        .min_by_key(|i| freedom(regression, &tried[*i].sited))?;
    let simpler = tried[best].sited.effect.refines.filter(|id| !has(regression, added, id));
    let simpler = simpler
        .and_then(|id| tried.iter().position(|t| t.validation.id == id && t.validation.accepted));
    Some(
        simpler
            .filter(|s| !validate("", &tried[*s].block_errors, &tried[best].block_errors).accepted)
            .unwrap_or(best),
    )
}

/// Returns candidates with about the winner's gain and no more parameters that are not nested with
/// it.
pub fn equally_good(
    regression: &RegressionModel,
    tried: &[FittedCandidate<'_>],
    best: usize,
) -> Vec<SitedEffect> {
    let winner = &tried[best];
    let shifts = |tried: &FittedCandidate<'_>| {
        regression.time_shift(&tried.model.structure, &tried.model.fitted).is_some()
    };
    let least = |tried: &FittedCandidate<'_>| match shifts(tried) && shifts(winner) {
        true => TIME_SHIFT_RIVAL,
        false => RIVAL,
    };
    let nested = |a: &SitedEffect, b: &SitedEffect| a.effect.refines == Some(b.effect.id);
    tried
        .iter()
        .enumerate()
        .filter(|(i, t)| *i != best && t.validation.accepted)
        .filter(|(_, t)| !nested(&t.sited, &winner.sited) && !nested(&winner.sited, &t.sited))
        .filter(|(_, t)| t.log_gain() >= least(t) * winner.log_gain())
        .filter(|(_, t)| freedom(regression, &t.sited) <= freedom(regression, &winner.sited))
        .map(|(_, t)| t.sited)
        .collect()
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::effects::{Axis, Units};
    use crate::regression::Fit;

    /// An axis of a test.
    pub(in crate::selection) const AXIS: Axis = Axis {
        units: Units::LINEAR,
        rotary: false,
        turn: None,
        spring: false,
        commanded: true,
        positions: (0.0, 1.0),
        velocity_rms: 1.0,
        velocity_peak: 1.0,
        force_rms: 1.0,
        force_peak: 1.0,
        seconds: 1.0,
        cut_off: 40.0,
    };

    /// A candidate that passed, with one amplitude for each term and its share of the log gain of a
    /// winner that halves the error.
    fn passed(id: &str, share: f64) -> FittedCandidate<'static> {
        let effect = find(id).unwrap();
        let (terms, shapes) = ((effect.terms)(&AXIS).len(), (effect.shapes)(&AXIS).len());
        let fit = Fit {
            coefficients: DVector::from_element(terms, 0.003),
            at_bound: vec![false; terms],
            squares: 1.0,
        };
        let fitted = Fitted {
            fit,
            std: vec![0.0; terms],
            correlation: DMatrix::zeros(0, 0),
            shapes: vec![0.003; 1 + shapes],
            columns: Vec::new(),
            outputs: Vec::new(),
        };
        let structure = Structure { effects: vec![effect], ..Structure::default() };
        let mut validation = validate(effect.id, &[1.0; 9], &[0.1; 9]);
        validation.gain_percent = 100.0 * (1.0 - 0.5f64.powf(share));
        FittedCandidate {
            sited: SitedEffect { effect, site: effect.sites[0] },
            validation,
            model: FittedModel { structure, fitted, equation_error_fit: None },
            block_errors: Vec::new(),
            screened_only: false,
        }
    }

    #[test]
    fn a_lag_and_a_dead_time_are_rivals_at_a_lower_share_than_others() {
        let regression = RegressionModel {
            balances: Vec::new(),
            parameters: Vec::new(),
            axis: AXIS,
            sites: &["master"],
        };
        let rivals = |winner: &str, other: &str, share: f64| {
            let tried = [passed(winner, 1.0), passed(other, share)];
            equally_good(&regression, &tried, 0).len()
        };
        assert_eq!(rivals("transport_delay", "amplifier_lag", 0.85), 1);
        assert_eq!(rivals("transport_delay", "amplifier_lag", 0.75), 0);
        assert_eq!(rivals("transport_delay", "viscous_friction", 0.85), 0);
        assert_eq!(rivals("transport_delay", "viscous_friction", 0.95), 1);
    }
}
