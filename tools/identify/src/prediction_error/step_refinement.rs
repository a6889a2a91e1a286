//! Finer steps of the simulation: for the records that need them, and as a test whether an effect
//! merely compensates the integration error.
//!
//! Where the control loop chatters between the voltage limits at a hundred reversals a second, as
//! one with dead time may, steps of 2 ms smooth dry friction visibly. Presliding hysteresis
//! imitates that, and an effect that is fitted well still leaves many times the noise.

use plant::effects::entry;
use rayon::prelude::*;

use super::dataset::{Dataset, Fitted};
use super::noise_floor::least;
use super::record::rms;
use super::selection_round::FittedCandidate;
use super::transmission_model::{Channel, TransmissionModel};
use super::validation::{least_beside, validate_beside};

/// Refinement factor of the step.
const FINER: u32 = 4;
/// Least share of its gain that an effect must keep.
const STAYS: f64 = 0.6;
/// Rounds of the fit with finer steps, with the effect.
const WITH: usize = 3;
/// Rounds of the fit without it.
const WITHOUT: usize = 4;

/// Change of a record's innovations by finer steps beyond which the records are simulated with
/// them, in multiples of the lower limit of the noise floor: what rounding to encoder counts
/// leaves, or a thousandth of the movement. Simulated machines with a limit cycle had 7 to 9 at the
/// slave, others 1.4 at most.
const COARSE: f64 = 2.0;

/// Simulates the records with finer steps if the innovations along one of them, at the declared
/// values, change noticeably with the step. All of them: a fit would compromise between records
/// with an integration error and records without.
pub fn refine_steps(model: &mut TransmissionModel) {
    // Where an unobserved slave stops depends on any detail of the simulation.
    if model.slave_unobserved() || model.records.iter().any(|record| record.steps > 1) {
        return;
    }
    let finer = finer(model);
    let start = model.start();
    let limits = [Channel::Master, Channel::Slave].map(|channel| COARSE * least(model, channel));
    let needs_finer = |record: usize| {
        let both = [&*model, &finer].map(|model| model.residual(&start, record));
        let [Some(coarse), Some(fine)] = both else { return false };
        let changes = |(channel, limit)| {
            let rows = |of| model.channel_of(record, of, channel);
            let differ =
                |(a, b): (&Vec<f64>, &Vec<f64>)| rms(a.iter().zip(b).map(|(a, b)| a - b)) > limit;
            rows(&coarse).zip(rows(&fine)).is_some_and(differ)
        };
        [Channel::Master, Channel::Slave].into_iter().zip(limits).any(changes)
    };
    if (0..model.records.len()).into_par_iter().any(needs_finer) {
        model.records = finer.records;
    }
}

/// The same model, with finer steps along every record.
fn finer(model: &TransmissionModel) -> TransmissionModel {
    let mut finer = model.clone();
    finer.records.iter_mut().for_each(|record| record.steps *= FINER);
    finer
}

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
    let model = finer(fit.model);
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
