//! The declared model of a transmission fitted alone.

use super::DeclaredFit;
use super::transmission_outcome::{error, parameters};
use super::transmission_study::Study;
use crate::equation_error::block_roles::Role;
use crate::prediction_error::dataset::Dataset;
use crate::prediction_error::validation::BLOCK;

/// Parameters and errors of a study that has tried no effect; `None` if the model cannot be
/// simulated.
pub(super) fn conclude(study: &Study<'_>) -> Option<DeclaredFit> {
    let fit = Dataset::of(&study.model, Role::Fit);
    let with_deviation = fit.deviations(study.found.last(), BLOCK);
    let early = study.deadline.left_work_out().then(|| {
        "the time limit (--limit-s) passed before the declared model was fitted to the end"
            .to_owned()
    });
    Some(DeclaredFit {
        error: error(study)?,
        parameters: parameters(study, &with_deviation),
        notes: study.notes.iter().cloned().chain(early).collect(),
    })
}
