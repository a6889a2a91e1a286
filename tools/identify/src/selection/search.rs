//! Stepwise selection of effects, validated on rows that took no part in the fit.
//!
//! Where the output is simulated, candidates are screened by their equation error, and the best few
//! are simulated, fitted to the output and validated by it.

use std::sync::Arc;

use rayon::prelude::*;

use super::candidates::{
    FittedCandidate, FittedModel, SitedEffect, best_accepted, candidates, equally_good,
};
use super::predictor::Predictor;
use super::validation::{LEAST_T, Validation, validate};
use crate::effects::Regressor;
use crate::equation_error::block_roles::{Block, Role, blocks_of_role};
use crate::equation_error::fit::ShapeSearch;
use crate::equation_error::model::{Fitted, Structure};
use crate::equation_error::spline::{Spline, Variable};
use crate::output_error::fit::OutputErrorModel;
use crate::output_error::simulation::can_simulate;

/// Most effects that are added: more would be curve fitting, not an explanation.
const MOST_EFFECTS: usize = 3;
/// Number of screened candidates that are simulated.
const REFINED: usize = 4;
/// Least gain of a nonparametric function in screening for which it is simulated (%).
const LEAST_NONPARAMETRIC_PERCENT: f64 = 3.0;

/// A validated candidate of a round.
pub struct Ranked {
    /// Its validation.
    pub validation: Validation,
    /// Whether it was screened by its equation error only.
    pub screened_only: bool,
}

/// One step of the search: the validated candidates, and the effect that was added.
pub struct SelectionStep {
    /// All candidates, best first; those that were only screened come last.
    pub ranking: Vec<Ranked>,
    /// The effect that was added, with the model after it.
    pub added: FittedCandidate,
    /// Rivals: equally good effects that add nothing to the winner.
    pub rivals: Vec<SitedEffect>,
}

/// A residual that no listed effect explains, as a function of one variable.
#[derive(Clone, Debug)]
pub struct Unlisted {
    /// What it depends on.
    pub variable: Variable,
    /// Abscissa, force, standard deviation.
    pub table: Vec<[f64; 3]>,
}

impl Unlisted {
    /// The table of a fitted spline, whose amplitudes are the last of the model.
    fn new(variable: Variable, spline: &Spline, fitted: &Fitted) -> Self {
        let from = fitted.fit.coefficients.len() - spline.knots.len();
        let row = |(i, knot): (usize, &f64)| {
            [*knot, fitted.fit.coefficients[from + i], fitted.std[from + i]]
        };
        Self { variable, table: spline.knots.iter().enumerate().map(row).collect() }
    }
}

/// A nonparametric function of one variable, fitted beside the model.
pub struct NonparametricFit {
    /// Its validation.
    pub validation: Validation,
    /// Its table.
    pub unlisted: Unlisted,
    /// Rms of its force on the selection rows.
    pub size: f64,
    /// Whether it was screened by its equation error only.
    pub screened_only: bool,
}

/// What the search found.
pub struct SearchResult {
    /// The declared model, fitted within its tolerances.
    pub base: FittedModel,
    /// Effects in the order in which they were added.
    pub steps: Vec<SelectionStep>,
    /// Listed candidates of the last round, in which none was added.
    pub last_round: Vec<FittedCandidate>,
    /// Nonparametric functions of one variable, best first.
    pub nonparametric: Vec<NonparametricFit>,
    /// The best of them, where it passes.
    pub unlisted: Option<Unlisted>,
}

impl SearchResult {
    /// The model with all effects that were added.
    pub fn last(&self) -> &FittedModel {
        self.steps.last().map_or(&self.base, |step| &step.added.model)
    }
}

struct Search<'a> {
    predictor: &'a Predictor<'a>,
    fit: Vec<Block>,
    select: Vec<Block>,
}

impl Search<'_> {
    const fn screening(&self) -> Predictor<'_> {
        Predictor::EquationError(self.predictor.regression())
    }

    /// Fits one candidate's equation error on the fitting blocks and validates it on the selecting
    /// ones.
    fn screen_one(
        &self,
        current: &FittedModel,
        sited: SitedEffect,
        before: &[f64],
        model: &Arc<Vec<Vec<f64>>>,
    ) -> Option<FittedCandidate> {
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
        let mut validation = validate(sited.effect.id, before, &block_errors);
        validation.accepted &= regression.sampling_delay(&structure, &fitted).is_none();
        let model = FittedModel { structure, fitted, equation_error_fit: None };
        Some(FittedCandidate { sited, validation, model, block_errors, screened_only: false })
    }

    /// Tries every candidate, in parallel on the current thread pool; best first.
    fn try_all(&self, current: &FittedModel, candidates: &[SitedEffect]) -> Vec<FittedCandidate> {
        let (regression, fitted) = (self.predictor.regression(), current.equation_error_fit());
        let before = self.screening().mean_squares(fitted, &self.select);
        let model = Arc::new(regression.force(&current.structure, fitted));
        let screen = |sited: &SitedEffect| self.screen_one(current, *sited, &before, &model);
        let mut screened: Vec<FittedCandidate> = candidates.par_iter().filter_map(screen).collect();
        best_first(&mut screened);
        match self.predictor {
            Predictor::EquationError(_) => screened,
            Predictor::OutputError(simulation) => self.simulate_best(simulation, current, screened),
        }
    }

    /// Simulates the best screened candidates: they come first.
    fn simulate_best(
        &self,
        simulation: &OutputErrorModel<'_>,
        current: &FittedModel,
        screened: Vec<FittedCandidate>,
    ) -> Vec<FittedCandidate> {
        let before = self.predictor.mean_squares(&current.fitted, &self.select);
        let promising: Vec<&FittedCandidate> = screened
            .iter()
            .filter(|t| t.validation.t >= LEAST_T && t.validation.gain_percent > 0.0)
            .take(REFINED)
            .collect();
        let simulate = |candidate: &FittedCandidate| {
            let FittedModel { structure, fitted: equation_error_fit, .. } = candidate.model.clone();
            let start = starting_point(&equation_error_fit, &current.fitted);
            let fitted = simulation.fit(&structure, &self.fit, &start, &[])?;
            let block_errors = self.predictor.mean_squares(&fitted, &self.select);
            let mut validation = validate(candidate.validation.id, &before, &block_errors);
            validation.accepted &=
                simulation.regression.sampling_delay(&structure, &fitted).is_none();
            let equation_error_fit = Some(equation_error_fit);
            let model = FittedModel { structure, fitted, equation_error_fit };
            let sited = candidate.sited;
            Some(FittedCandidate { sited, validation, model, block_errors, screened_only: false })
        };
        let mut simulated: Vec<FittedCandidate> =
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
    fn rivals(&self, winner: &FittedCandidate, equally_good: Vec<SitedEffect>) -> Vec<SitedEffect> {
        if equally_good.is_empty() {
            return equally_good;
        }
        let beside = self.try_all(&winner.model, &equally_good);
        let adds = |c: &SitedEffect| {
            beside.iter().any(|b| b.validation.id == c.effect.id && b.validation.accepted)
        };
        equally_good.into_iter().filter(|c| !adds(c)).take(2).collect()
    }

    /// Fits nonparametric functions of one variable to the residual; best first.
    fn nonparametric(&self, current: &FittedModel) -> Vec<NonparametricFit> {
        let one = |variable: Variable| self.nonparametric_in(current, variable);
        let mut tried: Vec<NonparametricFit> = Variable::ALL.into_iter().filter_map(one).collect();
        let gain = |tried: &NonparametricFit| tried.validation.gain_percent;
        tried.sort_by(|a, b| {
            a.screened_only.cmp(&b.screened_only).then(gain(b).total_cmp(&gain(a)))
        });
        tried
    }

    fn nonparametric_in(
        &self,
        current: &FittedModel,
        variable: Variable,
    ) -> Option<NonparametricFit> {
        let (regression, known) = (self.predictor.regression(), current.equation_error_fit());
        let spline = Spline::over(variable, regression.balances.iter().map(|b| &b.signals))?;
        let effects =
            current.structure.effects.iter().copied().chain([&spline as &dyn Regressor]).collect();
        let wider = Structure { effects, model: Arc::clone(&current.structure.model) };
        // Shapes are held: a spline must not compensate for a worse smoothing speed.
        let fitted = regression.fit(&wider, &self.fit, &known.shapes, ShapeSearch::Fixed)?;
        let [before, after] =
            [known, &fitted].map(|fitted| self.screening().mean_squares(fitted, &self.select));
        let screened = NonparametricFit {
            validation: validate(variable.name(), &before, &after),
            unlisted: Unlisted::new(variable, &spline, &fitted),
            size: regression.size_of_last(&fitted, spline.knots.len(), &self.select),
            screened_only: false,
        };
        let Predictor::OutputError(simulation) = self.predictor else { return Some(screened) };
        let Validation { t, gain_percent, .. } = screened.validation;
        let shows = t >= LEAST_T && gain_percent > LEAST_NONPARAMETRIC_PERCENT;
        let start = starting_point(&fitted, &current.fitted);
        let simulate = || simulation.fit(&wider, &self.fit, &start, &[]);
        let simulated = (shows && spline.is_force()).then(simulate).flatten();
        let Some(fitted) = simulated else {
            let validation = Validation { accepted: false, ..screened.validation };
            return Some(NonparametricFit { validation, screened_only: true, ..screened });
        };
        let [before, after] = [&current.fitted, &fitted]
            .map(|fitted| self.predictor.mean_squares(fitted, &self.select));
        let validation = validate(variable.name(), &before, &after);
        let unlisted = Unlisted::new(variable, &spline, &fitted);
        Some(NonparametricFit { validation, unlisted, ..screened })
    }
}

fn best_first(tried: &mut [FittedCandidate]) {
    tried.sort_by(|a, b| b.validation.gain_percent.total_cmp(&a.validation.gain_percent));
}

/// Starts known parameters at the simulated model's values, new ones at the screening's.
fn starting_point(equation_error_fit: &Fitted, known: &Fitted) -> Fitted {
    let mut start = equation_error_fit.clone();
    for (to, from) in start.fit.coefficients.iter_mut().zip(known.fit.coefficients.iter()) {
        *to = *from;
    }
    start.shapes[1..known.shapes.len()].copy_from_slice(&known.shapes[1..]);
    start
}

/// Greedy search: the best accepted candidate is added and all is fitted again, until none passes
/// or `MOST_EFFECTS` are in. `None` where not even the declared model can be fitted.
pub fn search(predictor: &Predictor<'_>, blocks: &[Block]) -> Option<SearchResult> {
    let [fit, select] = [Role::Fit, Role::Select].map(|role| blocks_of_role(blocks, role));
    let search = Search { predictor, fit, select };
    let (regression, structure) = (predictor.regression(), Structure::default());
    let fitted = regression.fit(&structure, &search.fit, &[], ShapeSearch::Refine)?;
    let base = match predictor {
        Predictor::EquationError(_) => FittedModel { structure, fitted, equation_error_fit: None },
        Predictor::OutputError(simulation) => FittedModel {
            fitted: simulation.fit(&structure, &search.fit, &fitted, &[])?,
            equation_error_fit: Some(fitted),
            structure,
        },
    };
    let mut steps: Vec<SelectionStep> = Vec::new();
    let last_round = loop {
        let current = steps.last().map_or(&base, |step| &step.added.model);
        let added: Vec<SitedEffect> = steps.iter().map(|step| step.added.sited).collect();
        let mut list = candidates(regression, &added, &current.fitted);
        if let Predictor::OutputError(_) = predictor {
            list.retain(|c| regression.frees(c.effect) || can_simulate(c.effect));
        }
        let mut tried = search.try_all(current, &list);
        let below_limit = steps.len() < MOST_EFFECTS;
        let Some(best) = best_accepted(regression, &added, &tried).filter(|_| below_limit) else {
            break tried;
        };
        let rivals = search.rivals(&tried[best], equally_good(regression, &tried, best));
        let ranked = |tried: &FittedCandidate| Ranked {
            validation: tried.validation.clone(),
            screened_only: tried.screened_only,
        };
        let ranking = tried.iter().map(ranked).collect();
        steps.push(SelectionStep { ranking, added: tried.swap_remove(best), rivals });
    };
    let nonparametric = search.nonparametric(steps.last().map_or(&base, |step| &step.added.model));
    let unlisted = nonparametric.iter().find(|g| g.validation.accepted).map(|g| g.unlisted.clone());
    Some(SearchResult { base, steps, last_round, nonparametric, unlisted })
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::effects::{Axis, Effect, Units};
    use crate::equation_error::model::RegressionModel;
    use crate::regression::Fit;

    #[test]
    fn a_gain_on_one_block_alone_is_not_accepted() {
        let before = [1.0; 10];
        let mut after = [1.0; 10];
        after[3] = 0.0;
        assert!(!validate("x", &before, &after).accepted, "5 % only");
        let before = [1.0, 1.0, 1.0, 1.0, 9.0];
        let after = [1.0, 1.0, 1.0, 1.0, 1.0];
        let validation = validate("x", &before, &after);
        assert!(validation.gain_percent > 30.0 && !validation.accepted, "{validation:?}");
    }

    #[test]
    fn a_uniform_gain_is_accepted_and_a_loss_is_not() {
        let before: Vec<f64> = (0..10).map(|i| 1.0 + 0.1 * f64::from(i % 3)).collect();
        let after: Vec<f64> = before.iter().map(|b| 0.7 * b).collect();
        assert!(validate("x", &before, &after).accepted);
        assert!(!validate("x", &after, &before).accepted);
    }

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
        let axis = Axis {
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
        let regression = RegressionModel {
            balances: Vec::new(),
            parameters: Vec::new(),
            axis,
            sites: &["master"],
        };
        let fit = Fit { coefficients: DVector::zeros(0), at_bound: Vec::new(), squares: 0.0 };
        let (std, columns, outputs) = (Vec::new(), Vec::new(), Vec::new());
        let fitted = Fitted { fit, std, shapes: vec![0.1], columns, outputs };
        let current =
            FittedModel { structure: Structure::default(), fitted, equation_error_fit: None };
        let predictor = Predictor::EquationError(&regression);
        let search = Search { predictor: &predictor, fit: Vec::new(), select: Vec::new() };
        search.try_all(&current, &[SitedEffect { effect: &PANICKING, site: "master" }]);
    }
}
