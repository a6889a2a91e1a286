//! Effects that are visible after the last one but not accepted, with their sizes.

use super::single_channel_parameters::effect_parameters;
use super::single_channel_result::Study;
use crate::equation_error::block_roles::{Block, Role, blocks_of_role};
use crate::outcome::Left;
use crate::selection::candidates::FittedCandidate;
use crate::selection::predictor::Predictor;
use crate::selection::validation::Validation;

/// Least gain that is reported (%).
const LEAST_PERCENT: f64 = 1.0;

/// Least block t that is reported.
const LEAST_T: f64 = 1.0;

/// Whether a candidate is visible.
fn shows(c: &Validation) -> bool {
    c.gain_percent >= LEAST_PERCENT && c.t >= LEAST_T && c.better > c.worse
}

/// Visible candidates of the last round, and effects that were withdrawn.
fn visible<'a>(study: &'a Study<'_>) -> impl Iterator<Item = &'a FittedCandidate<'a>> {
    let withdrawn = study.found.withdrawn.iter().map(|step| &step.added);
    let rest = study.found.last_round.iter().chain(withdrawn);
    rest.filter(|c| !c.screened_only && shows(&c.validation))
}

/// Notes on time shifts that sampling explains.
pub(super) fn sampling_delay_notes(study: &Study<'_>) -> impl Iterator<Item = String> {
    let regression = study.predictor.regression();
    let sampling = regression.balances.iter().map(|b| b.sampling).fold(0.0, f64::max);
    visible(study).filter_map(move |c| {
        let shift = regression.sampling_delay(&c.model.structure, &c.model.fitted)?;
        Some(format!(
            "{}: {shift:.3e} s would reduce the error by {:.1} %; that is within one and a half \
             sampling periods of {sampling:.3e} s, as sampling and zero-order hold cause, and is \
             not accepted as an effect",
            c.validation.id, c.validation.gain_percent
        ))
    })
}

/// Rms of what a candidate changes on some rows: of its force, or of the simulated output.
fn size(study: &Study<'_>, candidate: &FittedCandidate<'_>, blocks: &[Block]) -> f64 {
    let with = &candidate.model.fitted;
    match &study.predictor {
        Predictor::EquationError(regression) => {
            let terms = regression.terms_of(candidate.sited.effect).len();
            regression.size_of_last(with, terms, blocks)
        }
        Predictor::OutputError(_) => {
            let without = &study.found.last().fitted;
            let (mut sum, mut rows) = (0.0, 0usize);
            for block in blocks {
                let [with, without] = [with, without].map(|model| &model.outputs[block.record]);
                sum += block.rows.clone().map(|r| (with[r] - without[r]).powi(2)).sum::<f64>();
                rows += block.rows.len();
            }
            (sum / rows.max(1) as f64).sqrt()
        }
    }
}

/// Returns listed effects, and nonparametric functions of a force, that are visible on the
/// selection rows, largest gain first. Each is fitted alone beside the model: two may describe the
/// same effect.
pub(super) fn left(study: &Study<'_>) -> Vec<Left> {
    let select = blocks_of_role(&study.blocks, Role::Select);
    let row = |validation: &Validation, size: f64| Left {
        id: validation.id.into(),
        site: None,
        size,
        unit: study.predictor.unit().into(),
        gain_percent: validation.gain_percent,
        t: validation.t,
        parameters: Vec::new(),
    };
    let regression = study.predictor.regression();
    let mut left: Vec<Left> = visible(study)
        .map(|c| Left {
            site: Some(c.sited.site.into()),
            parameters: effect_parameters(
                regression,
                &c.model,
                c.model.structure.effects.len() - 1,
            ),
            ..row(&c.validation, size(study, c, &select))
        })
        .collect();
    if let Predictor::EquationError(_) = study.predictor {
        let functions = study.found.nonparametric.iter().filter(|g| shows(&g.validation));
        left.extend(functions.map(|g| row(&g.validation, g.size)));
    }
    left.sort_by(|a, b| b.gain_percent.total_cmp(&a.gain_percent));
    left
}
