//! Greedy forward selection of effects, validated on rows that took no part in the fit.
//!
//! Where the output is simulated, candidates are screened by their equation error, and the best few
//! are simulated, fitted to the output and validated by it.

use std::sync::Arc;

use rayon::prelude::*;

use super::candidates::{
    FittedCandidate, FittedModel, SitedEffect, best_accepted, candidates, equally_good,
};
use super::predictor::Predictor;
use super::tones::is_tone_of_motion;
use super::validation::{LEAST_T, Validation, least_percent, validate};
use crate::deadline::Deadline;
use crate::effects::{Axis, Effect};
use crate::equation_error::block_roles::Block;
use crate::equation_error::fit::ShapeSearch;
use crate::equation_error::model::Fitted;
use crate::output_error::fit::OutputErrorModel;
use crate::output_error::simulation::can_simulate;

/// Most effects that are added: more would be curve fitting, not an explanation.
const MOST_EFFECTS: usize = 3;
/// Most steps: an effect that may repeat, as waves of several orders, counts once.
const MOST_STEPS: usize = 6;
/// Largest mean square of a block's noise, as a multiple of the expected one: band-limited noise of
/// 16 periods scatters by a quarter, and that of a coarse encoder is not quite white.
const MOST_OF_NOISE: f64 = 2.0;
/// Number of screened candidates that are simulated.
const REFINED: usize = 4;

/// A validated candidate of a round.
pub struct Ranked {
    /// Its validation.
    pub validation: Validation,
    /// Whether it was screened by its equation error only.
    pub screened_only: bool,
}

/// One step of the search: the validated candidates, and the effect that was added.
pub struct SelectionStep<'f> {
    /// All candidates, best first; those that were only screened come last.
    pub ranking: Vec<Ranked>,
    /// The effect that was added, with the model after it.
    pub added: FittedCandidate<'f>,
    /// Rivals: equally good effects that add nothing to the winner.
    pub rivals: Vec<SitedEffect>,
}

/// A model with the rows on which candidates are fitted, and those on which they are validated.
pub struct Search<'a> {
    pub(super) predictor: &'a Predictor<'a>,
    /// When nothing more is tried.
    pub(super) deadline: &'a Deadline,
    pub(super) fit: Vec<Block>,
    pub(super) select: Vec<Block>,
}

/// Which effects a selection may add.
#[derive(Clone, Copy)]
pub struct Choice {
    /// Whether an effect is a candidate.
    pub allowed: fn(&Effect, &Axis) -> bool,
    /// Least gain (%), where it exceeds that of every validation.
    pub least_percent: f64,
}

/// The effects that were added, and the candidates of the last round, in which none was.
pub struct Selection<'f> {
    pub(super) steps: Vec<SelectionStep<'f>>,
    pub(super) last_round: Vec<FittedCandidate<'f>>,
}

impl<'f> Selection<'f> {
    /// The model with all effects that were added to `base`.
    pub(super) fn last<'s>(&'s self, base: &'s FittedModel<'f>) -> &'s FittedModel<'f> {
        self.steps.last().map_or(base, |step| &step.added.model)
    }
}

impl Search<'_> {
    pub(super) const fn screening(&self) -> Predictor<'_> {
        Predictor::EquationError(self.predictor.regression())
    }

    /// Fits one candidate's equation error on the fitting blocks and validates it on the selecting
    /// ones.
    fn screen_one<'f>(
        &self,
        current: &FittedModel<'f>,
        sited: SitedEffect,
        before: &[f64],
        model: &Arc<Vec<Vec<f64>>>,
    ) -> Option<FittedCandidate<'f>> {
        let regression = self.predictor.regression();
        // A simulation refines what the screening leaves coarse.
        let shape_search = match self.predictor {
            Predictor::EquationError(_) => ShapeSearch::Refine,
            Predictor::OutputError(_) => ShapeSearch::GridOnly,
        };
        let mut structure = current.structure.clone();
        structure.effects.push(sited.effect);
        structure.model = Arc::clone(model);
        let shapes = &current.equation_error_fit().shapes;
        let mut fitted = regression.fit(&structure, &self.fit, shapes, shape_search)?;
        if structure.effects.iter().any(|e| e.declaration().uses_model) {
            // The predicted force was that of the model without the effect.
            structure.model = Arc::new(regression.force(&structure, &fitted));
            fitted = regression.fit(&structure, &self.fit, &fitted.shapes, shape_search)?;
        }
        let block_errors = self.screening().mean_squares(&fitted, &self.select);
        let model = FittedModel { structure, fitted, equation_error_fit: None };
        let beyond_noise =
            self.beyond_noise_of_position((current, before), (&model, &block_errors));
        let mut validation = validate(sited.effect.id, before, &beyond_noise);
        let FittedModel { structure, fitted, .. } = &model;
        validation.exclude_if(
            regression.sampling_delay(structure, fitted).is_some()
                || regression.shape_at_end(structure, fitted)
                || !self.passes_while_moving(current, fitted),
        );
        Some(FittedCandidate { sited, validation, model, block_errors, screened_only: false })
    }

    /// The mean squared residuals of a candidate, without what noise of the position adds to them:
    /// a mass brings that of the acceleration into blocks in which nothing accelerates. This undoes
    /// deteriorations alone, since an improvement must show in spite of the noise.
    fn beyond_noise_of_position(
        &self,
        (current, before): (&FittedModel<'_>, &[f64]),
        (candidate, after): (&FittedModel<'_>, &[f64]),
    ) -> Vec<f64> {
        let regression = self.predictor.regression();
        let noise = |model: &FittedModel<'_>, block: &Block| {
            let block = std::slice::from_ref(block);
            regression.noise_square(&model.structure, model.equation_error_fit(), block)
        };
        let beyond = |((block, before), after): ((&Block, &f64), &f64)| {
            if after <= before {
                return *after;
            }
            let added = (noise(candidate, block) - noise(current, block)).max(0.0);
            (after - MOST_OF_NOISE * added).max(*before)
        };
        self.select.iter().zip(before).zip(after).map(beyond).collect()
    }

    /// Tries every candidate, in parallel on the current thread pool; best first.
    fn try_all<'f>(
        &self,
        current: &FittedModel<'f>,
        candidates: &[SitedEffect],
    ) -> Vec<FittedCandidate<'f>> {
        let (regression, fitted) = (self.predictor.regression(), current.equation_error_fit());
        let before = self.screening().mean_squares(fitted, &self.select);
        let model = Arc::new(regression.force(&current.structure, fitted));
        let screen = |sited: &SitedEffect| match self.deadline.has_passed() {
            true => None,
            false => self.screen_one(current, *sited, &before, &model),
        };
        let mut screened: Vec<FittedCandidate<'f>> =
            candidates.par_iter().filter_map(screen).collect();
        best_first(&mut screened);
        match self.predictor {
            Predictor::EquationError(_) => screened,
            Predictor::OutputError(simulation) => self.simulate_best(simulation, current, screened),
        }
    }

    /// Simulates the best screened candidates: they come first.
    fn simulate_best<'f>(
        &self,
        simulation: &OutputErrorModel<'_>,
        current: &FittedModel<'f>,
        screened: Vec<FittedCandidate<'f>>,
    ) -> Vec<FittedCandidate<'f>> {
        let before = self.predictor.mean_squares(&current.fitted, &self.select);
        let promising: Vec<&FittedCandidate<'f>> = screened
            .iter()
            .filter(|t| t.validation.accepted || t.validation.t >= LEAST_T)
            .filter(|t| t.validation.gain_percent > 0.0)
            .take(REFINED)
            .collect();
        let simulate = |candidate: &FittedCandidate<'f>| {
            if self.deadline.has_passed() {
                return None;
            }
            let FittedModel { structure, fitted: equation_error_fit, .. } = candidate.model.clone();
            let smoothed = simulation.regression.uses_sign(&current.structure);
            let near = starting_point(&equation_error_fit, &current.fitted, smoothed);
            let fit = |start: &Fitted| simulation.fit(&structure, &self.fit, start, &[]);
            // What the model without the effect was bent to may lie at another minimum.
            let squares = |start: &Fitted| simulation.squares(&structure, &self.fit, start);
            let far = match (squares(&near), squares(&equation_error_fit)) {
                (Some(near), Some(far)) => far < near,
                (near, far) => near.is_none() && far.is_some(),
            };
            let starts = std::iter::once(&near).chain(far.then_some(&equation_error_fit));
            let fits = starts.filter_map(fit);
            let fitted = fits.min_by(|a, b| a.fit.squares.total_cmp(&b.fit.squares))?;
            let block_errors = self.predictor.mean_squares(&fitted, &self.select);
            let mut validation = validate(candidate.validation.id, &before, &block_errors);
            validation
                .exclude_if(simulation.regression.sampling_delay(&structure, &fitted).is_some());
            let equation_error_fit = Some(equation_error_fit);
            let model = FittedModel { structure, fitted, equation_error_fit };
            let sited = candidate.sited;
            Some(FittedCandidate { sited, validation, model, block_errors, screened_only: false })
        };
        let mut simulated: Vec<FittedCandidate<'f>> =
            promising.into_par_iter().filter_map(simulate).collect();
        best_first(&mut simulated);
        for mut candidate in screened {
            if simulated.iter().all(|own| own.validation.id != candidate.validation.id) {
                candidate.validation.accepted = false;
                simulated.push(FittedCandidate { screened_only: true, ..candidate });
            }
        }
        simulated
    }

    /// Returns at most two equally good candidates that add nothing to the winner.
    fn rivals(
        &self,
        winner: &FittedCandidate<'_>,
        equally_good: Vec<SitedEffect>,
    ) -> Vec<SitedEffect> {
        if equally_good.is_empty() {
            return equally_good;
        }
        let beside = self.try_all(&winner.model, &equally_good);
        let adds = |c: &SitedEffect| {
            beside.iter().any(|b| b.validation.id == c.effect.id && b.validation.accepted)
        };
        equally_good.into_iter().filter(|c| !adds(c)).take(2).collect()
    }

    /// Mean squared residual of each selecting block, as a share of the variance that the target
    /// keeps: an effect that takes a part of the measured force away must not gain by shrinking
    /// what is left to be explained.
    pub(super) fn relative_errors(&self, model: &FittedModel<'_>) -> Vec<f64> {
        let regression = self.predictor.regression();
        let kept = regression.target_share(&model.structure, &model.fitted, &self.select);
        let mut errors = self.predictor.mean_squares(&model.fitted, &self.select);
        errors.iter_mut().for_each(|error| *error /= kept);
        errors
    }

    /// Whether what was added to a model passes on the rows in which the machine moves, too: at
    /// rest dry friction takes any value below its limit. Of an output that is simulated, this is
    /// not asked.
    pub(super) fn passes_while_moving(&self, model: &FittedModel<'_>, with: &Fitted) -> bool {
        let Predictor::EquationError(_) = self.predictor else { return true };
        let [before, after] = [&model.fitted, with].map(|fitted| {
            self.predictor.moving_mean_squares(&model.structure, fitted, &self.select)
        });
        validate("", &before, &after).accepted
    }

    /// The least decrease (%) that counts beside a model, by what it leaves on the selecting rows.
    pub(super) fn least_percent(&self, fitted: &Fitted) -> f64 {
        let (error, size) = self.predictor.error(fitted, &self.select);
        least_percent(100.0 * error / size.max(f64::MIN_POSITIVE))
    }

    /// Greedy forward selection: the best accepted candidate is added and all is fitted again,
    /// until none passes or the model has `MOST_EFFECTS` effects.
    pub(super) fn forward<'f>(&self, base: &FittedModel<'f>, choice: Choice) -> Selection<'f> {
        let regression = self.predictor.regression();
        let mut steps: Vec<SelectionStep<'f>> = Vec::new();
        let last_round = loop {
            let current = steps.last().map_or(base, |step| &step.added.model);
            let added: Vec<SitedEffect> = steps.iter().map(|step| step.added.sited).collect();
            let mut list = candidates(regression, &added, &current.fitted);
            list.retain(|c| (choice.allowed)(c.effect, &regression.axis));
            if let Predictor::OutputError(_) = self.predictor {
                list.retain(|c| regression.frees(c.effect) || can_simulate(c.effect));
            }
            let mut tried = self.try_all(current, &list);
            let least_percent = choice.least_percent.max(self.least_percent(&current.fitted));
            for candidate in &mut tried {
                let validation = &candidate.validation;
                let may_pass = validation.accepted || validation.takes_part_of_most(least_percent);
                let tone = may_pass && is_tone_of_motion(regression, candidate, &self.fit);
                candidate.validation.accepted &= candidate.validation.gain_percent >= least_percent;
                candidate.validation.exclude_if(tone);
            }
            if self.deadline.left_work_out() {
                // Better candidates may not have been tried.
                tried.iter_mut().for_each(|candidate| candidate.validation.accepted = false);
                break tried;
            }
            let mut different: Vec<&str> = added.iter().map(|sited| sited.effect.id).collect();
            different.sort_unstable();
            different.dedup();
            let room = different.len() < MOST_EFFECTS && added.len() < MOST_STEPS;
            let Some(best) = best_accepted(regression, &added, &tried).filter(|_| room) else {
                break tried;
            };
            let rivals = self.rivals(&tried[best], equally_good(regression, &tried, best));
            let ranked = |tried: &FittedCandidate<'f>| Ranked {
                validation: tried.validation.clone(),
                screened_only: tried.screened_only,
            };
            let ranking = tried.iter().map(ranked).collect();
            steps.push(SelectionStep { ranking, added: tried.swap_remove(best), rivals });
        };
        Selection { steps, last_round }
    }
}

fn best_first(tried: &mut [FittedCandidate<'_>]) {
    tried.sort_by(|a, b| b.validation.gain_percent.total_cmp(&a.validation.gain_percent));
}

/// Starts known parameters at the simulated model's values, new ones at the screening's: among
/// these the smoothing speed, unless the simulated model is `smoothed`.
pub(super) fn starting_point(
    equation_error_fit: &Fitted,
    known: &Fitted,
    smoothed: bool,
) -> Fitted {
    let mut start = equation_error_fit.clone();
    for (to, from) in start.fit.coefficients.iter_mut().zip(known.fit.coefficients.iter()) {
        *to = *from;
    }
    let from = usize::from(!smoothed);
    start.shapes[from..known.shapes.len()].copy_from_slice(&known.shapes[from..]);
    start
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::super::candidates::tests::AXIS;
    use super::*;
    use crate::deadline::NEVER;
    use crate::equation_error::model::{RegressionModel, Structure};
    use crate::regression::Fit;

    static PANICKING: Effect = Effect {
        id: "panicking",
        sites: &["master"],
        words: "nothing",
        experiment: "none",
        terms: |_| panic!("a defect of an effect"),
        ..Effect::NONE
    };

    #[test]
    #[should_panic(expected = "a defect of an effect")]
    fn a_panic_of_a_candidate_is_propagated() {
        let regression = RegressionModel {
            balances: Vec::new(),
            parameters: Vec::new(),
            axis: AXIS,
            sites: &["master"],
        };
        let fit = Fit { coefficients: DVector::zeros(0), at_bound: Vec::new(), squares: 0.0 };
        let (std, columns, outputs) = (Vec::new(), Vec::new(), Vec::new());
        let correlation = DMatrix::zeros(0, 0);
        let fitted = Fitted { fit, std, correlation, shapes: vec![0.1], columns, outputs };
        let current =
            FittedModel { structure: Structure::default(), fitted, equation_error_fit: None };
        let predictor = Predictor::EquationError(&regression);
        let search =
            Search { predictor: &predictor, deadline: &NEVER, fit: Vec::new(), select: Vec::new() };
        search.try_all(&current, &[SitedEffect { effect: &PANICKING, site: "master" }]);
    }
}
