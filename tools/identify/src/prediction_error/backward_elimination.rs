//! Backward elimination and substitution of effects that were added too early.

use plant::effects::{Site, entry};
use rayon::prelude::*;

use super::dataset::{Dataset, Fitted};
use super::free_parameter::FreeParameter;
use super::transmission_model::{Residual, Setting};
use super::validation::{LEAST_GAIN, Validation, validate, validate_beside};

/// Runners-up of the first round that are fitted alone.
const RUNNERS_UP: usize = 6;
/// A larger loss is not recovered by further fitting.
const FAR_BEHIND: f64 = 0.5;
/// Gain from which two effects are distinct; a smaller loss counts as none.
pub const DISTINCT_GAIN: f64 = 0.05;
/// Runners-up that are tried in an effect's place.
const SUBSTITUTES: usize = 3;
/// Fit rounds of each.
const SUBSTITUTION_ROUNDS: usize = 2;
/// Least gain of the best of them.
pub const LEAST_SUBSTITUTION: f64 = 0.1;
/// Fit rounds without the newest effect.
const WITHOUT_NEWEST_ROUNDS: usize = 4;
/// Block t beyond which two effects are distinguished.
const DISTINCT_T: f64 = 4.0;

/// Returns an effect that later ones made redundant: its index, and the model fitted without it.
/// The newest effect is exempt.
pub fn redundant_effect(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    now: &Fitted,
) -> Option<(usize, Fitted)> {
    let with = select.residuals(&now.setting)?;
    let (_, older) = now.setting.placed.split_last()?;
    older.iter().enumerate().find_map(|(at, placed)| {
        if fit.deadline.has_passed() {
            return None;
        }
        let fitted = fit.fit_without(now, at, 2)?;
        let without = select.residuals(&fitted.setting)?;
        let validation = validate((placed.id, placed.site), &without, &with);
        (validation.gain < LEAST_GAIN).then_some((at, fitted))
    })
}

/// Returns the model `with` an effect that was just added beside others, fitted without it, if the
/// effect no longer passes beside that. The fit starts where the one with the effect ended: the one
/// `before` it may have stopped in a local minimum, and any candidate that leads out of one gains.
pub fn without_newest(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    before: &Fitted,
    with: &Fitted,
) -> Option<Fitted> {
    let (newest, others) = with.setting.placed.split_last()?;
    let at = others.len();
    if others.is_empty() || fit.deadline.has_passed() {
        return None;
    }
    let fitted = fit.fit_without(with, at, WITHOUT_NEWEST_ROUNDS)?;
    if fitted.objective >= before.objective {
        return None;
    }
    let [without, with] = [&fitted, with].map(|fitted| select.residuals(&fitted.setting));
    let beside = validate_beside(at, (newest.id, newest.site), &without?, &with?);
    (!beside.accepted).then_some(fitted)
}

/// Another model than the current one.
pub struct Alternative {
    /// Its validation against the current model, or that of the current model against it.
    pub beside: Validation,
    /// The model.
    pub fitted: Fitted,
    /// Its residuals on the selecting records.
    pub selected: Vec<Residual>,
}

/// Substitutes the effect at `at` by the best runner-up, since early effects were selected while
/// later ones were missing. `None` if none does clearly better.
pub fn substitute(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    now: &Fitted,
    at: usize,
    runners_up: &[Fitted],
) -> Option<Alternative> {
    let with = select.residuals(&now.setting)?;
    let one = |other: &Fitted| -> Option<Alternative> {
        let placed = other.setting.placed.last().filter(|_| !fit.deadline.has_passed())?;
        let mut setting = now.setting.clone();
        *setting.placed.get_mut(at)? = placed.clone();
        let kept = now.parameters.iter().filter(|parameter| !parameter.is_of(at)).cloned();
        let last = other.setting.placed.len() - 1;
        let own = other.parameters.iter().filter(|parameter| parameter.is_of(last));
        let free: Vec<FreeParameter> =
            kept.chain(own.map(|parameter| parameter.moved_to(at))).collect();
        let fitted = fit.fit(&setting, &free, SUBSTITUTION_ROUNDS)?;
        let selected = select.residuals(&fitted.setting)?;
        let beside = validate((placed.id, placed.site), &with, &selected);
        Some(Alternative { beside, fitted, selected })
    };
    let there = |other: &&Fitted| {
        let own = other.setting.placed.last();
        own.is_some_and(|own| {
            now.setting.placed.iter().all(|placed| (placed.id, placed.site) != (own.id, own.site))
        })
    };
    let others: Vec<&Fitted> = runners_up.iter().filter(there).take(SUBSTITUTES).collect();
    let tried: Vec<Alternative> = others.into_par_iter().filter_map(one).collect();
    tried
        .into_iter()
        .max_by(|a, b| a.beside.gain.total_cmp(&b.beside.gain))
        .filter(|best| best.beside.gain >= LEAST_SUBSTITUTION)
}

/// Fits each runner-up of the first round as the only effect, starting from the current declared
/// parameters as well; the current model is validated against each. Best first; those far behind
/// are left out.
pub fn single_effect_models(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    now: &Fitted,
    runners_up: &[Fitted],
) -> Option<Vec<Alternative>> {
    let with = select.residuals(&now.setting)?;
    let one = |other: &Fitted| -> Option<Alternative> {
        let placed = other.setting.placed.first().filter(|_| !fit.deadline.has_passed())?;
        let mut free: Vec<FreeParameter> =
            now.parameters.iter().filter(|parameter| parameter.is_base()).cloned().collect();
        free.extend(other.of_effects().cloned());
        let there = Setting { placed: vec![placed.clone()], ..now.setting.clone() };
        let starts = [there, other.setting.clone()].map(|start| fit.evaluate(start));
        let first =
            starts.into_iter().flatten().min_by(|a, b| a.objective.total_cmp(&b.objective))?;
        let beside = |fitted: &Fitted| {
            let selected = select.residuals(&fitted.setting)?;
            Some((validate((placed.id, placed.site), &selected, &with), selected))
        };
        let near = fit.fit(&first.setting, &free, 1)?;
        if beside(&near)?.0.gain > FAR_BEHIND {
            return None;
        }
        let fitted = fit.fit(&near.setting, &free, 2)?;
        let (beside, selected) = beside(&fitted)?;
        Some(Alternative { beside, fitted, selected })
    };
    let mut found: Vec<Alternative> =
        runners_up.par_iter().take(RUNNERS_UP).filter_map(one).collect();
    found.sort_by(|a, b| a.beside.gain.total_cmp(&b.beside.gain));
    Some(found)
}

/// Whether two effects are equivalent on every record, apart from numerics.
pub fn are_equivalent(one: (&str, Site), other: (&str, Site)) -> bool {
    let at = |site| entry(one.0).is_some_and(|own| own.search.equivalent_sites.contains(&site));
    one.0 == other.0 && at(one.1) && at(other.1)
}

/// Returns the site at which an effect would be equivalent.
pub fn equivalent_site((id, site): (&str, Site)) -> Option<Site> {
    entry(id)?.search.equivalent_site(site)
}

/// Returns at most two of some models that the selecting records cannot distinguish from the effect
/// `meant`, whose model has the residuals `selected`. Models with more parameters are no rivals.
pub fn rivals(
    meant: (&str, Site),
    (fitted, selected): (&Fitted, &[Residual]),
    models: &[Alternative],
) -> Vec<(&'static str, Site)> {
    models
        .iter()
        .filter(|model| model.fitted.of_effects().count() <= fitted.of_effects().count())
        .filter(|model| {
            let beside = validate(model.beside.effect(), &model.selected, selected);
            let same = are_equivalent(meant, model.beside.effect());
            beside.gain < DISTINCT_GAIN && beside.t.abs() < DISTINCT_T
                || same && beside.gain < LEAST_GAIN
        })
        .map(|model| model.beside.effect())
        .take(2)
        .collect()
}
