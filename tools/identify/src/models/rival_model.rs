//! The fitted model in which a rival replaces an effect.

use plant::effects::{Site, entry};

use super::transmission_study::Study;
use crate::equation_error::block_roles::Role;
use crate::prediction_error::candidates::{Candidate, candidates, free_parameters_of};
use crate::prediction_error::dataset::{Dataset, Fitted};
use crate::prediction_error::free_parameter::FreeParameter;
use crate::prediction_error::record_features::record_features;
use crate::prediction_error::transmission_model::{PlacedEffect, Setting};

/// Fits the model with the effect at index `at` replaced by a rival to the same records; returns it
/// with its estimated parameters.
pub(super) fn rival_of(
    study: &Study<'_>,
    at: usize,
    rival: (&'static str, Site),
) -> Option<(Setting, Vec<FreeParameter>)> {
    let model = &study.model;
    let found = &study.found;
    let fit = Dataset::of(model, Role::Fit);
    let now = fit.evaluate(found.last().setting.clone())?;
    let listed: Vec<Candidate> = candidates(&record_features(&fit, &now));
    let candidate = listed.iter().find(|candidate| (candidate.id, candidate.site) == rival)?;
    let placed = candidate.starts.iter().flat_map(|start| {
        let sign_flipped = candidate.signed.then(|| {
            let mut sign_flipped = start.clone();
            sign_flipped.values.iter_mut().take(1).for_each(|(_, size)| *size = -*size);
            sign_flipped
        });
        [Some(start.clone()), candidate.quadrature(start), sign_flipped]
    });
    // An effect that is its own rival acts on the other instrument.
    let instrument = |placed: &PlacedEffect| {
        entry(placed.id)?.search.choice.and_then(|choice| placed.value(choice.parameter))
    };
    let own = &now.setting.placed[at];
    let another = |placed: &PlacedEffect| {
        (placed.id, placed.site) != (own.id, own.site)
            || instrument(placed).is_none()
            || instrument(placed) != instrument(own)
    };
    let starts: Vec<Fitted> = placed
        .flatten()
        .filter(another)
        .filter_map(|placed| {
            let mut setting = now.setting.clone();
            setting.placed[at] = placed;
            fit.evaluate(setting)
        })
        .collect();
    let best = starts.into_iter().min_by(|a, b| a.objective.total_cmp(&b.objective))?;
    let others = found.last().parameters.iter().filter(|parameter| !parameter.is_of(at)).cloned();
    let parameters: Vec<FreeParameter> = others.chain(free_parameters_of(candidate, at)).collect();
    let fitted = fit.fit(&best.setting, &parameters, 4)?;
    Some((fitted.setting, parameters))
}
