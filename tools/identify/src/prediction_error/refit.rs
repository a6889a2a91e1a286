//! Fits of the whole model: as declared, and again after an effect was added.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::candidates::Candidate;
use super::dataset::{Dataset, Fitted};
use super::fit::foremost;
use super::free_parameter::FreeParameter;
use super::known_columns::KnownColumns;
use super::noise_floor::above_floor;
use super::transmission_model::{PlacedEffect, SMOOTHING, SMOOTHING_STARTS, Setting};

/// Most refits of a model with an effect while it stays above the noise floor.
const REFITS: usize = 3;
/// Decrease of the criterion per row for which another refit is worthwhile.
const LEAST_REFIT: f64 = 0.01;
/// Rounds of the last fit of the declared model.
const DECLARED_FIT_ROUNDS: usize = 4;
/// A declared parameter whose variation over half its tolerance changes the weighted residual by
/// less than this share of its rms is not estimated.
pub(super) const SENSITIVE: f64 = 0.002;
/// Most declared parameters in a fit.
const MOST_PARAMETERS: usize = 30;

/// Selects the declared parameters to be estimated by a pivoted orthogonalisation of the Jacobian,
/// the most sensitive first.
fn estimable(dataset: &Dataset<'_>, fitted: &Fitted) -> Vec<FreeParameter> {
    let all: Vec<FreeParameter> = (0..dataset.model.base.len()).map(FreeParameter::Base).collect();
    let weights = Dataset::weights(&fitted.residuals);
    let mut jacobian: DMatrix<f64> = dataset.jacobian(fitted, &all, &weights);
    let least = SENSITIVE * (jacobian.nrows() as f64).sqrt();
    let mut chosen = Vec::new();
    while chosen.len() < MOST_PARAMETERS {
        let norms: Vec<f64> = jacobian.column_iter().map(|column| column.norm()).collect();
        let Some((index, norm)) =
            norms.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
        else {
            break;
        };
        if norm < least || norm.is_nan() {
            break;
        }
        let direction = jacobian.column(index) / norm;
        let along = jacobian.transpose() * &direction;
        jacobian -= direction * along.transpose();
        jacobian.column_mut(index).fill(0.0);
        chosen.push(all[index].clone());
    }
    chosen
}

/// Fits the declared model within its tolerances.
pub fn fit_base((fit, select): (&Dataset<'_>, &Dataset<'_>)) -> Option<Fitted> {
    let model = fit.model;
    let smoothing = model.base.iter().position(|parameter| parameter.name == SMOOTHING);
    let starts = SMOOTHING_STARTS.par_iter().filter_map(|speed| {
        let mut start = model.start();
        if let Some(index) = smoothing {
            start.base[index] = *speed;
        }
        let fitted = fit.evaluate(start)?;
        let parameters = estimable(fit, &fitted);
        fit.fit(&fitted.setting, &parameters, 3)
    });
    let starts: Vec<Fitted> = starts.collect();
    let best = starts.into_iter().min_by(|a, b| a.objective.total_cmp(&b.objective))?;
    // A smaller residual reveals more parameters.
    let now = fit.fit(&best.setting, &estimable(fit, &best), 6)?;
    if !model.slave_unobserved() {
        return Some(now);
    }
    // No observer holds an unobserved slave to its record: its friction and the line's stiffness
    // trade off along the whole record, and the first fit often ends in a local minimum.
    let starts = |_: usize, now: &Setting, _: &[FreeParameter]| {
        vec![now.clone(), Setting { base: model.declared_with_estimated(now), ..now.clone() }]
    };
    Some(fit_repeatedly((fit, select), now, &|fitted| estimable(fit, fitted), &starts))
}

/// Refits the whole model after an effect, fitted as the last of `added`, was added.
pub fn refit(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    added: &Fitted,
    of: &Candidate,
) -> Fitted {
    let model = fit.model;
    let own: Vec<FreeParameter> = added.of_effects().cloned().collect();
    let shown = |fitted: &Fitted| [estimable(fit, fitted), own.clone()].concat();
    let parameters = shown(added);
    let now = fit.fit(&added.setting, &parameters, 6).unwrap_or_else(|| added.clone());
    let starts = |pass: usize, now: &Setting, parameters: &[FreeParameter]| {
        // The declared values may lead out of a local minimum.
        let fresh = Setting { base: model.start().base, ..now.clone() };
        let mut starts = vec![now.clone(), fresh.clone()];
        if (of.sizes > 1 || of.multi_start.is_some()) && pass == 0 {
            // Correlated parameters have several local minima.
            starts.extend(other_starts(fit, of, [&fresh, now], parameters));
        }
        starts
    };
    fit_repeatedly((fit, select), now, &shown, &starts)
}

/// Fits the declared model again, from the declared values and from those of another setting;
/// `None` where neither lowers the criterion.
pub fn refit_declared(fit: &Dataset<'_>, base: &Fitted, there: Option<&Setting>) -> Option<Fitted> {
    let there = there.map(|setting| setting.base.clone());
    let starts = [there, Some(fit.model.declared_with_estimated(&base.setting))];
    let again = starts.into_par_iter().flatten().filter_map(|values| {
        let start = Setting { base: values, ..Setting::default() };
        fit.fit(&start, &base.parameters, DECLARED_FIT_ROUNDS)
    });
    let best = again.min_by(|a, b| a.objective.total_cmp(&b.objective));
    best.filter(|fitted| fitted.objective < base.objective)
}

/// Starting points of a refit: from its pass, the present setting and the parameters estimated.
type Starts<'a> = dyn Fn(usize, &Setting, &[FreeParameter]) -> Vec<Setting> + 'a;

/// Fits again from the starting points that `starts` returns for a pass, the present setting and
/// the parameters that are `shown`, until the selecting records are at the noise floor or the
/// criterion no longer falls: a local minimum looks like a missing effect.
fn fit_repeatedly(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    mut now: Fitted,
    shown: &dyn Fn(&Fitted) -> Vec<FreeParameter>,
    starts: &Starts<'_>,
) -> Fitted {
    let mut parameters = now.parameters.clone();
    for pass in 0..REFITS {
        if fit.deadline.has_passed() {
            break;
        }
        if above_floor(fit.model, &select.records, &now.setting)
            .is_some_and(|above| above.well_at_floor())
        {
            break;
        }
        // A smaller residual reveals more parameters.
        parameters = shown(&now);
        let before = now.objective;
        let starts = starts(pass, &now.setting, &parameters);
        let again = starts.par_iter().filter_map(|start| fit.fit(start, &parameters, 4));
        let again: Vec<Fitted> = again.collect();
        let Some(best) = again.into_iter().min_by(|a, b| a.objective.total_cmp(&b.objective))
        else {
            break;
        };
        now = best;
        if before - now.objective < LEAST_REFIT * now.rows() as f64 {
            break;
        }
    }
    Fitted { parameters, ..now }
}

/// Returns the best starting points of an effect in place of the last, from several settings, after
/// a brief fit with the Jacobian of each setting.
fn other_starts(
    fit: &Dataset<'_>,
    of: &Candidate,
    from: [&Setting; 2],
    parameters: &[FreeParameter],
) -> Vec<Setting> {
    let base: Vec<FreeParameter> =
        parameters.iter().filter(|parameter| parameter.is_base()).cloned().collect();
    let brief = |from: &Setting| -> Vec<Fitted> {
        let here = fit.evaluate(fit.inside(from.clone(), parameters));
        let columns = here.map(|here| KnownColumns::at(fit, &here, &base));
        let with = |start: &PlacedEffect| {
            let mut setting = from.clone();
            setting.placed.last_mut()?.values.clone_from(&start.values);
            Some(setting)
        };
        let starts: Vec<Setting> = of.starts.iter().filter_map(with).collect();
        fit.leading(&starts, parameters, 1, columns.as_ref())
    };
    let begun = foremost(from.into_iter().flat_map(brief).collect());
    begun.into_iter().map(|begun| begun.setting).collect()
}
