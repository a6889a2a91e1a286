//! What the declared model lacks: forward selection, and the models that compete with its result.

use super::adequacy::Adequacy;
use super::candidates::{FittedCandidate, FittedModel};
use super::forward_selection::{Choice, Search, Selection, SelectionStep};
use super::nonparametric::{NonparametricFit, Unlisted};
use super::predictor::Predictor;
use super::validation::{Validation, least_percent, validate};
use crate::deadline::{Deadline, NEVER};
use crate::effects::Regressor;
use crate::equation_error::block_roles::{Block, Role, blocks_of_role};
use crate::equation_error::fit::ShapeSearch;
use crate::equation_error::model::Structure;
use crate::equation_error::spline::{Spline, Variable};

/// Least gain of a model with a nonparametric function over the listed effects alone, from which it
/// takes their place (%).
const LEAST_FUNCTION_PERCENT: f64 = 30.0;
/// Least gain of an effect beside a nonparametric function (%): the function has taken a part of
/// what an effect would explain, and could take the rest in another form.
const LEAST_BESIDE_PERCENT: f64 = 25.0;

/// All effects are candidates.
const ANY: Choice = Choice { allowed: |_, _| true, least_percent: 0.0 };

/// What the search found.
pub struct SearchResult<'f> {
    /// The declared model, fitted within its tolerances.
    pub base: FittedModel<'f>,
    /// The declared model with the nonparametric function that takes the place of listed effects;
    /// the effects were added to it.
    pub function: Option<FittedModel<'f>>,
    /// Effects in the order in which they were added.
    pub steps: Vec<SelectionStep<'f>>,
    /// Effects that were withdrawn, because most of the error is left with them.
    pub withdrawn: Vec<SelectionStep<'f>>,
    /// Listed candidates of the last round, in which none was added.
    pub last_round: Vec<FittedCandidate<'f>>,
    /// Nonparametric functions of one variable beside the last model, best first.
    pub nonparametric: Vec<NonparametricFit>,
    /// The function that takes the place of listed effects, or the best of those beside the last
    /// model, where it passes.
    pub unlisted: Option<Unlisted>,
    /// How much of the error is left, and how it is correlated.
    pub adequacy: Adequacy,
}

/// A model with a nonparametric function in place of listed effects.
struct Competitor<'f> {
    function: &'f Spline,
    /// The declared model with the function.
    model: FittedModel<'f>,
    /// The effects that were added to it.
    beside: Selection<'f>,
    /// Relative errors of the whole.
    errors: Vec<f64>,
}

/// The better of a nonparametric function in place of listed effects and these alone.
enum Comparison<'f> {
    /// The function takes their place.
    Function(Box<Competitor<'f>>),
    /// They stay; with the functions beside them, where the comparison needed those.
    Listed(Option<Vec<NonparametricFit>>),
}

impl<'f> SearchResult<'f> {
    /// The model with all effects that were added.
    pub fn last(&self) -> &FittedModel<'f> {
        let steps = self.steps.last().map(|step| &step.added.model);
        steps.or(self.function.as_ref()).unwrap_or(&self.base)
    }

    /// Whether no model that was tried describes the records.
    pub fn is_inadequate(&self) -> bool {
        self.leaves_too_much() || self.unsettled().is_some()
    }

    /// Whether effects were added beside which a large error is left that is no noise: they explain
    /// a part of what is missing, or something similar is.
    pub fn leaves_coloured(&self) -> bool {
        !self.steps.is_empty() && self.adequacy.is_coloured()
    }

    /// Whether nothing was added, and effects that were withdrawn leave most of a large error, or
    /// the declared model leaves a large error that is no noise.
    fn leaves_too_much(&self) -> bool {
        self.steps.is_empty()
            && self.unlisted.is_none()
            && (!self.withdrawn.is_empty() || self.adequacy.is_coloured())
    }

    /// The candidate or function that takes the most of the error on most blocks and yet does not
    /// pass, where nothing was added for another reason: neither that it is missing nor that
    /// nothing is can be said then.
    pub fn unsettled(&self) -> Option<&Validation> {
        let found = !self.steps.is_empty() || self.unlisted.is_some();
        if found || self.leaves_too_much() || self.adequacy.is_negligible() {
            return None;
        }
        let listed = self.last_round.iter().filter(|own| !own.screened_only);
        let listed = listed.map(|own| &own.validation);
        let functions = self.nonparametric.iter().filter(|own| !own.screened_only);
        let all = listed.chain(functions.map(|own| &own.validation));
        let least_percent = least_percent(self.adequacy.selected_percent);
        all.filter(|own| !own.accepted && own.takes_part_of_most(least_percent))
            .max_by(|a, b| a.gain_percent.total_cmp(&b.gain_percent))
    }
}

/// Nonparametric functions, with knots over the fitting rows, that may take the place of listed
/// effects.
pub fn functions(predictor: &Predictor<'_>, blocks: &[Block]) -> Vec<Spline> {
    let search = Search::new(predictor, blocks, &NEVER);
    let variables = Variable::ALL.into_iter().filter(|variable| *variable != Variable::Time);
    variables.filter_map(|variable| search.function_of(variable)).collect()
}

/// The declared model, fitted on `blocks` within its tolerances; `None` where it cannot be.
pub fn fit_declared<'f>(predictor: &Predictor<'_>, blocks: &[Block]) -> Option<FittedModel<'f>> {
    let (regression, structure) = (predictor.regression(), Structure::default());
    let fitted = regression.fit(&structure, blocks, &[], ShapeSearch::Refine)?;
    Some(match predictor {
        Predictor::EquationError(_) => FittedModel { structure, fitted, equation_error_fit: None },
        Predictor::OutputError(simulation) => FittedModel {
            fitted: simulation.fit(&structure, blocks, &fitted, &[])?,
            equation_error_fit: Some(fitted),
            structure,
        },
    })
}

/// Searches the effects that the declared model lacks; after the deadline no further ones. `None`
/// where not even the declared model can be fitted.
///
/// Where the error is that of a force, two further models compete with the result of the forward
/// selection: without effects that take a part of the measured force away, and with a nonparametric
/// function in place of listed effects.
pub fn search<'f>(
    predictor: &Predictor<'_>,
    blocks: &[Block],
    functions: &'f [Spline],
    deadline: &Deadline,
) -> Option<SearchResult<'f>> {
    let search = Search::new(predictor, blocks, deadline);
    let base = fit_declared(predictor, &search.fit)?;
    let mut selection = search.forward(&base, ANY);
    let (mut function, mut unlisted, mut nonparametric) = (None, None, None);
    if let Predictor::EquationError(_) = predictor {
        selection = search.without_altered_target(&base, selection);
        match search.beside_function(&base, &selection, functions) {
            Comparison::Listed(beside) => nonparametric = beside,
            Comparison::Function(better) => {
                let variable = better.function.variable();
                unlisted = Some(Unlisted::new(variable, better.function, &better.model.fitted));
                (function, selection) = (Some(better.model), better.beside);
            }
        }
    }
    let Selection { steps, last_round } = selection;
    let mut found = SearchResult {
        base,
        function,
        steps,
        withdrawn: Vec::new(),
        last_round,
        nonparametric: Vec::new(),
        unlisted,
        adequacy: Adequacy::default(),
    };
    found.nonparametric = nonparametric.unwrap_or_else(|| search.nonparametric(found.last()));
    let best = found.nonparametric.iter().find(|function| function.validation.accepted);
    found.unlisted = found.unlisted.or_else(|| best.map(|best| best.unlisted.clone()));
    let report = blocks_of_role(blocks, Role::Report);
    found.adequacy = Adequacy::of(predictor, (&found.base, found.last()), &search.select, &report);
    let added = found.function.is_some() || !found.steps.is_empty();
    if added && found.adequacy.takes_little_of_negligible() {
        (found.function, found.unlisted) = (None, None);
        (found.steps, found.nonparametric) = (Vec::new(), Vec::new());
        found.last_round = Vec::new();
        let declared = (&found.base, &found.base);
        found.adequacy = Adequacy::of(predictor, declared, &search.select, &report);
    } else if found.function.is_none() && added && found.adequacy.leaves_most() {
        found.withdrawn = std::mem::take(&mut found.steps);
    }
    Some(found)
}

impl<'a> Search<'a> {
    fn new(predictor: &'a Predictor<'a>, blocks: &[Block], deadline: &'a Deadline) -> Self {
        let [fit, select] = [Role::Fit, Role::Select].map(|role| blocks_of_role(blocks, role));
        Self { predictor, deadline, fit, select }
    }

    /// Keeps an effect that takes a part of the measured force away only if the selection without
    /// such effects explains clearly less of what each leaves to be explained.
    fn without_altered_target<'f>(
        &self,
        base: &FittedModel<'f>,
        with: Selection<'f>,
    ) -> Selection<'f> {
        let axis = &self.predictor.regression().axis;
        if !with.steps.iter().any(|step| step.added.sited.effect.alters_target(axis)) {
            return with;
        }
        let allowed = Choice { allowed: |effect, axis| !effect.alters_target(axis), ..ANY };
        let without = self.forward(base, allowed);
        let [after, before] =
            [&with, &without].map(|selection| self.relative_errors(selection.last(base)));
        let stays = validate("", &before, &after).accepted && !self.deadline.left_work_out();
        if stays { with } else { without }
    }

    /// The declared model with the nonparametric function that takes the place of listed effects,
    /// and effects beside it. It does where it explains clearly more than the listed effects alone;
    /// or where it explains as much, and a function of the same variable takes a good part of what
    /// the listed effects leave. What noise of the position leaves of the listed effects is not
    /// there to be explained.
    fn beside_function<'f>(
        &self,
        base: &FittedModel<'f>,
        listed: &Selection<'f>,
        functions: &'f [Spline],
    ) -> Comparison<'f> {
        let competitors: Vec<Competitor<'f>> =
            functions.iter().filter_map(|function| self.competitor(base, function)).collect();
        let sum = |errors: &[f64]| errors.iter().sum::<f64>();
        let best = competitors.iter().min_by(|a, b| sum(&a.errors).total_cmp(&sum(&b.errors)));
        let Some(best) = best.filter(|_| !self.deadline.left_work_out()) else {
            return Comparison::Listed(None);
        };
        let before = self.relative_errors(listed.last(base));
        let takes_much =
            |own: &Validation| own.accepted && own.gain_percent >= LEAST_FUNCTION_PERCENT;
        let beyond_noise = self.less_noise_of_position(listed.last(base), &before);
        let (chosen, beside) = if takes_much(&validate("", &beyond_noise, &best.errors)) {
            (Some(best.function.variable()), None)
        } else {
            let beside = self.nonparametric(listed.last(base));
            let left = beside.iter().find(|left| takes_much(&left.validation));
            (left.map(|left| left.unlisted.variable), Some(beside))
        };
        let takes_place = |own: &Competitor<'f>| {
            Some(own.function.variable()) == chosen && sum(&own.errors) <= sum(&before)
        };
        match competitors.into_iter().find(takes_place) {
            Some(better) => Comparison::Function(Box::new(better)),
            None => Comparison::Listed(beside),
        }
    }

    /// The declared model with a nonparametric function, where that explains something by itself,
    /// and with effects beside it.
    fn competitor<'f>(
        &self,
        base: &FittedModel<'f>,
        function: &'f Spline,
    ) -> Option<Competitor<'f>> {
        if self.deadline.has_passed() {
            return None;
        }
        let effects = vec![function as &dyn Regressor];
        let structure = Structure { effects, ..Structure::default() };
        let regression = self.predictor.regression();
        let fitted = regression.fit(&structure, &self.fit, &[], ShapeSearch::Refine)?;
        let model = FittedModel { structure, fitted, equation_error_fit: None };
        let [before, alone] = [base, &model].map(|model| self.relative_errors(model));
        if !validate("", &before, &alone).accepted || !self.passes_while_moving(base, &model.fitted)
        {
            return None;
        }
        let allowed = Choice {
            allowed: |effect, _| effect.beside_functions,
            least_percent: LEAST_BESIDE_PERCENT,
        };
        let beside = self.forward(&model, allowed);
        let errors = self.relative_errors(beside.last(&model));
        Some(Competitor { function, model, beside, errors })
    }
}
