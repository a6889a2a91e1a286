//! Stepwise selection of effects, validated on rows that took no part in the fit.

use std::sync::Arc;

use rayon::prelude::*;

use super::block_roles::{Block, Role};
use super::fit::ShapeSearch;
use super::model::{Column, Fitted, RegressionModel, Structure};
use super::spline::{Spline, Variable};
use super::validation::{Validation, mean_squares, validate};
use crate::effects::{ALL, Effect, Regressor};

/// A rival is as good as the winner when its gain (in log error) is at least this share of the
/// winner's.
const RIVAL: f64 = 0.9;

/// Most effects that are added: more would be curve fitting, not an explanation.
pub const MOST_EFFECTS: usize = 3;

/// An effect at a site.
#[derive(Clone, Copy)]
pub struct SitedEffect {
    /// The effect.
    pub effect: &'static Effect,
    /// Its site.
    pub site: &'static str,
}

/// A candidate, fitted beside the current model and validated.
#[derive(Clone)]
pub struct FittedCandidate {
    /// The effect.
    pub sited: SitedEffect,
    /// Its validation.
    pub validation: Validation,
    /// The model with it.
    pub structure: Structure<'static>,
    /// Its fit.
    pub fitted: Fitted,
    /// Mean squared residual of each selecting block.
    pub after: Vec<f64>,
}

impl FittedCandidate {
    fn standing(&self) -> RankedCandidate<'_> {
        RankedCandidate { sited: self.sited, validation: &self.validation, after: &self.after }
    }
}

/// One step of the search: the validated candidates, and the model after it.
pub struct SelectionStep {
    /// All candidates, best first.
    pub ranking: Vec<Validation>,
    /// The effect that was added.
    pub added: SitedEffect,
    /// Rivals: equally good effects that add nothing to the winner.
    pub rivals: Vec<SitedEffect>,
    /// The model with it.
    pub structure: Structure<'static>,
    /// Its fit.
    pub fitted: Fitted,
}

/// A residual that no listed effect explains, as a function of one variable.
#[derive(Clone, Debug)]
pub struct Unlisted {
    /// What it depends on.
    pub variable: Variable,
    /// Abscissa, force, standard deviation.
    pub table: Vec<[f64; 3]>,
}

/// A nonparametric function of one variable, fitted beside the model.
#[derive(Clone, Debug)]
pub struct NonparametricFit {
    /// Its validation.
    pub validation: Validation,
    /// Its table.
    pub unlisted: Unlisted,
    /// Rms of its force on the selecting rows.
    pub size: f64,
}

/// What the search found.
pub struct SearchResult {
    /// The declared model, fitted within its tolerances.
    pub base: Fitted,
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
    pub fn last(&self) -> &Fitted {
        self.steps.last().map_or(&self.base, |s| &s.fitted)
    }

    /// Its structure.
    pub fn structure(&self) -> Structure<'static> {
        self.steps.last().map_or_else(Structure::default, |s| s.structure.clone())
    }
}

/// Blocks of one role.
pub fn of(blocks: &[Block], role: Role) -> Vec<Block> {
    blocks.iter().filter(|b| b.role == role).cloned().collect()
}

/// Whether the model has that effect already: added, or declared as a parameter.
fn has(regression: &RegressionModel, added: &[SitedEffect], id: &str) -> bool {
    id == "coulomb_friction" && regression.declares(Column::Sign)
        || added.iter().any(|a| a.effect.id == id)
}

/// Returns the candidates that are applicable beside the effects in the model.
pub fn candidates(
    regression: &RegressionModel,
    added: &[SitedEffect],
    now: &Fitted,
) -> Vec<SitedEffect> {
    let at_edge = |column| {
        regression
            .parameters
            .iter()
            .zip(&now.fit.at_bound)
            .any(|(p, edge)| p.column == column && *edge)
    };
    let rank = |site: &str| regression.sites.iter().position(|s| *s == site);
    let sited = |effect: &'static Effect| {
        let site = regression.sites.iter().find(|site| effect.sites.contains(site))?;
        Some(SitedEffect { effect, site })
    };
    let mut list: Vec<SitedEffect> = ALL
        .iter()
        .filter_map(sited)
        .filter(|c| {
            !has(regression, added, c.effect.id) && c.effect.regressor.applies(&regression.axis)
        })
        .filter(|c| c.effect.regressor.needs().iter().all(|need| has(regression, added, need)))
        .filter(|c| {
            !regression.frees(c.effect.regressor)
                || c.effect.regressor.lifts().map(Column::of).is_some_and(at_edge)
        })
        .collect();
    // Of two effects on the same parameter, the one at the first site is kept.
    let lifted: Vec<_> = list.iter().map(|c| (c.effect.regressor.lifts(), rank(c.site))).collect();
    let taken = |(lifts, rank): &(Option<_>, Option<usize>)| {
        lifts.is_some() && lifted.iter().any(|(other, nearer)| other == lifts && nearer < rank)
    };
    let mut keep = lifted.iter().map(|l| !taken(l));
    list.retain(|_| keep.next().unwrap_or(true));
    list
}

/// The model a round starts from.
pub struct SelectionRound<'a> {
    /// The machine.
    pub regression: &'a RegressionModel,
    /// What is in the model.
    pub structure: &'a Structure<'static>,
    /// Its fit.
    pub now: &'a Fitted,
    /// Rows that fit.
    pub fit: &'a [Block],
    /// Rows that select.
    pub select: &'a [Block],
    /// What to do with the shapes: [`ShapeSearch::Refine`], or [`ShapeSearch::GridOnly`].
    pub how: ShapeSearch,
}

impl SelectionRound<'_> {
    /// Fits one candidate on the fitting blocks and validates it on the selecting ones.
    fn attempt(
        &self,
        sited: SitedEffect,
        before: &[f64],
        model: &Arc<Vec<Vec<f64>>>,
    ) -> Option<FittedCandidate> {
        let regression = self.regression;
        let mut structure = self.structure.clone();
        structure.effects.push(sited.effect.regressor);
        structure.model = Arc::clone(model);
        let mut fitted = regression.fit(&structure, self.fit, &self.now.shapes, self.how)?;
        if structure.effects.iter().any(|e| e.uses_model()) {
            // The predicted force was that of the model without the effect.
            structure.model = Arc::new(regression.force(&structure, &fitted));
            fitted = regression.fit(&structure, self.fit, &fitted.shapes, self.how)?;
        }
        let after = mean_squares(regression, &fitted, self.select);
        let mut validation = validate(sited.effect.id, before, &after);
        validation.accepted &= regression.hidden_shift(&structure, &fitted).is_none();
        Some(FittedCandidate { sited, validation, structure, fitted, after })
    }

    /// Tries every candidate, in parallel on the current thread pool; best first.
    pub fn try_all(&self, candidates: &[SitedEffect]) -> Vec<FittedCandidate> {
        let before = mean_squares(self.regression, self.now, self.select);
        let model = Arc::new(self.regression.force(self.structure, self.now));
        let attempt = |candidate: &SitedEffect| self.attempt(*candidate, &before, &model);
        let mut tried: Vec<FittedCandidate> = candidates.par_iter().filter_map(attempt).collect();
        tried.sort_by(|a, b| b.validation.gain_percent.total_cmp(&a.validation.gain_percent));
        tried
    }
}

/// A ranked candidate.
pub struct RankedCandidate<'a> {
    /// The effect.
    pub sited: SitedEffect,
    /// Its validation.
    pub validation: &'a Validation,
    /// Mean squared residual of each selecting block.
    pub after: &'a [f64],
}

impl RankedCandidate<'_> {
    /// Decrease of the logarithm of the error.
    fn log_gain(&self) -> f64 {
        -(1.0 - self.validation.gain_percent / 100.0).max(1e-12).ln()
    }
}

/// Number of parameters of an effect.
fn freedom(regression: &RegressionModel, sited: &SitedEffect) -> usize {
    let terms = sited.effect.regressor.terms(&regression.axis);
    terms.iter().filter(|t| !t.is_given()).count()
        + sited.effect.regressor.shapes(&regression.axis).len()
}

/// Chooses, of the accepted candidates with about the best gain, the one with the fewest
/// parameters. A simpler effect that it contains as a limit takes its place unless it improves on
/// that by as much as an effect must. `tried` is in the order of gains.
pub fn choose(
    regression: &RegressionModel,
    added: &[SitedEffect],
    tried: &[RankedCandidate<'_>],
) -> Option<usize> {
    let top = tried.iter().find(|t| t.validation.accepted)?.log_gain();
    let is_near = |t: &RankedCandidate<'_>| t.validation.accepted && t.log_gain() >= RIVAL * top;
    let best = (0..tried.len())
        .filter(|i| is_near(&tried[*i]))
        .min_by_key(|i| freedom(regression, &tried[*i].sited))?;
    let simpler =
        tried[best].sited.effect.regressor.refines().filter(|id| !has(regression, added, id));
    let simpler = simpler
        .and_then(|id| tried.iter().position(|t| t.validation.id == id && t.validation.accepted));
    Some(
        simpler
            .filter(|s| !validate("", tried[*s].after, tried[best].after).accepted)
            .unwrap_or(best),
    )
}

/// Returns candidates with about the winner's gain and no more parameters that are not nested with
/// it.
pub fn equally_good(
    regression: &RegressionModel,
    tried: &[RankedCandidate<'_>],
    best: usize,
) -> Vec<SitedEffect> {
    let winner = &tried[best];
    let nested =
        |a: &SitedEffect, b: &SitedEffect| a.effect.regressor.refines() == Some(b.effect.id);
    tried
        .iter()
        .enumerate()
        .filter(|(i, t)| *i != best && t.validation.accepted)
        .filter(|(_, t)| !nested(&t.sited, &winner.sited) && !nested(&winner.sited, &t.sited))
        .filter(|(_, t)| t.log_gain() >= RIVAL * winner.log_gain())
        .filter(|(_, t)| freedom(regression, &t.sited) <= freedom(regression, &winner.sited))
        .map(|(_, t)| t.sited)
        .collect()
}

/// Returns at most two equally good candidates that add nothing to the winner.
fn rivals(
    round: &SelectionRound<'_>,
    winner: &FittedCandidate,
    near: Vec<SitedEffect>,
) -> Vec<SitedEffect> {
    let beside = SelectionRound { structure: &winner.structure, now: &winner.fitted, ..*round }
        .try_all(&near);
    let adds = |c: &SitedEffect| {
        beside.iter().any(|b| b.validation.id == c.effect.id && b.validation.accepted)
    };
    near.into_iter().filter(|c| !adds(c)).take(2).collect()
}

/// Greedy search: the best accepted candidate is added and all is fitted again, until none passes
/// or [`MOST_EFFECTS`] are in. `None` where not even the declared model can be fitted.
pub fn search(regression: &RegressionModel, blocks: &[Block]) -> Option<SearchResult> {
    let (fit, select) = (of(blocks, Role::Fit), of(blocks, Role::Select));
    let mut structure = Structure::default();
    let base = regression.fit(&structure, &fit, &[], ShapeSearch::Refine)?;
    let mut now = base.clone();
    let mut steps: Vec<SelectionStep> = Vec::new();
    let last_round = loop {
        let added: Vec<SitedEffect> = steps.iter().map(|s| s.added).collect();
        let how = ShapeSearch::Refine;
        let round = SelectionRound {
            regression,
            structure: &structure,
            now: &now,
            fit: &fit,
            select: &select,
            how,
        };
        let tried = round.try_all(&candidates(regression, &added, &now));
        let room = steps.len() < MOST_EFFECTS;
        let standings: Vec<RankedCandidate<'_>> =
            tried.iter().map(FittedCandidate::standing).collect();
        let Some(best) = choose(regression, &added, &standings).filter(|_| room) else {
            break tried;
        };
        let rivals = rivals(&round, &tried[best], equally_good(regression, &standings, best));
        let ranking = tried.iter().map(|t| t.validation.clone()).collect();
        let FittedCandidate { sited, structure: wider, fitted, .. } = tried[best].clone();
        (structure, now) = (wider.clone(), fitted.clone());
        steps.push(SelectionStep { ranking, added: sited, rivals, structure: wider, fitted });
    };
    let round = SelectionRound {
        regression,
        structure: &structure,
        now: &now,
        fit: &fit,
        select: &select,
        how: ShapeSearch::Fixed,
    };
    let nonparametric = nonparametric(&round);
    let unlisted = nonparametric.iter().find(|g| g.validation.accepted).map(|g| g.unlisted.clone());
    Some(SearchResult { base, steps, last_round, nonparametric, unlisted })
}

/// Fits nonparametric functions of one variable to the residual; best first.
pub fn nonparametric(round: &SelectionRound<'_>) -> Vec<NonparametricFit> {
    let regression = round.regression;
    let before = mean_squares(regression, round.now, round.select);
    let mut tried: Vec<NonparametricFit> = Vec::new();
    for variable in Variable::ALL {
        let Some(spline) = Spline::over(variable, regression.balances.iter().map(|b| &b.signals))
        else {
            continue;
        };
        let effects =
            round.structure.effects.iter().copied().chain([&spline as &dyn Regressor]).collect();
        let wider = Structure { effects, model: Arc::clone(&round.structure.model) };
        // Shapes are held: a spline must not compensate for a worse smoothing speed.
        let Some(fitted) = regression.fit(&wider, round.fit, &round.now.shapes, ShapeSearch::Fixed)
        else {
            continue;
        };
        let validation =
            validate(variable.name(), &before, &mean_squares(regression, &fitted, round.select));
        let knots = spline.knots.len();
        let from = fitted.fit.coefficients.len() - knots;
        let at =
            |i: usize| [spline.knots[i], fitted.fit.coefficients[from + i], fitted.std[from + i]];
        let unlisted = Unlisted { variable, table: (0..knots).map(at).collect() };
        tried.push(NonparametricFit {
            validation,
            unlisted,
            size: regression.size_of_last(&fitted, knots, round.select),
        });
    }
    tried.sort_by(|a, b| b.validation.gain_percent.total_cmp(&a.validation.gain_percent));
    tried
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::effects::{Axis, Term, Units};
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
        regressor: &Panicking,
    };

    struct Panicking;

    impl Regressor for Panicking {
        fn terms(&self, _: &Axis) -> Vec<Term> {
            panic!("a defect of an effect")
        }
    }

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
        let now = Fitted { fit, std: Vec::new(), shapes: vec![0.1], columns: Vec::new() };
        let round = SelectionRound {
            regression: &regression,
            structure: &Structure::default(),
            now: &now,
            fit: &[],
            select: &[],
            how: ShapeSearch::Refine,
        };
        round.try_all(&[SitedEffect { effect: &PANICKING, site: "master" }]);
    }
}
