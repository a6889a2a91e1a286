//! Tests whether an effect merely compensates the integration error of the simulation.
//!
//! Where the control loop chatters between the voltage limits at a hundred reversals a second,
//! steps of 2 ms smooth dry friction visibly, which presliding hysteresis imitates. With finer
//! steps such an effect explains nothing.

use plant::effects::entry;

use super::dataset::{Dataset, Fitted};
use super::selection_round::FittedCandidate;
use super::transmission_model::TransmissionModel;
use super::validation::{least_beside, validate_beside};

/// Refinement factor of the step.
const FINER: u32 = 4;
/// Least share of its gain that an effect must keep.
const STAYS: f64 = 0.6;
/// Rounds of the fit with finer steps, with the effect.
const WITH: usize = 3;
/// Rounds of the fit without it.
const WITHOUT: usize = 4;

/// Whether an effect may be an artefact of the step.
pub fn may_be_step_artefact(id: &str) -> bool {
    entry(id).is_some_and(|entry| entry.search.imitates_coarse_steps)
}

/// Whether an effect keeps most of its gain with finer steps. If one of the fits diverges, the
/// effect stays: there is no evidence against it.
pub fn holds_with_finer_steps(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    now: &Fitted,
    added: &FittedCandidate,
) -> bool {
    let model = TransmissionModel { steps: FINER * fit.model.steps, ..fit.model.clone() };
    let [fit, select] = [fit, select].map(|dataset| Dataset { model: &model, ..dataset.clone() });
    let left = |fitted: &Fitted, rounds| {
        select.residuals(&fit.fit(&fitted.setting, &fitted.parameters, rounds)?.setting)
    };
    let (with, without) = rayon::join(|| left(&added.fitted, WITH), || left(now, WITHOUT));
    let Some((with, without)) = with.zip(without) else { return true };
    let beside = now.setting.placed.len();
    let gain = validate_beside(beside, added.validation.effect(), &without, &with).gain;
    gain >= least_beside(beside).max(STAYS * added.validation.gain)
}
