//! Effects that are visible after the last one but not accepted, with their sizes.

use super::equation_error_parameters::effect_parameters;
use super::equation_error_result::Study;
use crate::equation_error::block_roles::Role;
use crate::equation_error::model::RegressionModel;
use crate::equation_error::search::of;
use crate::equation_error::validation::Validation;
use crate::outcome::Left;

/// Least gain that is reported (%).
const LEAST_PERCENT: f64 = 1.0;

/// Least block t that is reported.
const LEAST_T: f64 = 1.0;

/// Whether a candidate is visible.
pub(super) fn shows(c: &Validation) -> bool {
    c.gain_percent >= LEAST_PERCENT && c.t >= LEAST_T && c.better > c.worse
}

/// A note on a time shift that sampling explains.
pub(super) fn shift_note(regression: &RegressionModel, what: &Validation, shift: f64) -> String {
    let sampling = regression.balances.iter().map(|b| b.sampling).fold(0.0, f64::max);
    format!(
        "{}: {shift:.3e} s would reduce the error by {:.1} %; that is within one and a half \
         sampling periods of {sampling:.3e} s, as sampling and zero-order hold cause, and is not \
         accepted as an effect",
        what.id, what.gain_percent
    )
}

/// Returns listed effects and nonparametric functions that are visible on the selecting rows,
/// largest gain first. Each is fitted alone beside the model: two may describe the same effect.
pub(super) fn left(study: &Study) -> Vec<Left> {
    let (regression, found) = (&study.regression, &study.found);
    let select = of(&study.blocks, Role::Select);
    let unit = regression.axis.units.force;
    let mut left: Vec<Left> = Vec::new();
    for tried in found.last_round.iter().filter(|t| shows(&t.validation)) {
        let at = tried.structure.effects.len() - 1;
        left.push(Left {
            id: tried.validation.id.into(),
            site: Some(tried.sited.site.into()),
            size: regression.size_of_last(
                &tried.fitted,
                regression.terms_of(tried.sited.effect.regressor).len(),
                &select,
            ),
            unit: unit.into(),
            gain_percent: tried.validation.gain_percent,
            t: tried.validation.t,
            parameters: effect_parameters(regression, &tried.structure, at, &tried.fitted),
        });
    }
    for generic in found.nonparametric.iter().filter(|g| shows(&g.validation)) {
        left.push(Left {
            id: generic.validation.id.into(),
            site: None,
            size: generic.size,
            unit: unit.into(),
            gain_percent: generic.validation.gain_percent,
            t: generic.validation.t,
            parameters: Vec::new(),
        });
    }
    left.sort_by(|a, b| b.gain_percent.total_cmp(&a.gain_percent));
    left
}
