//! Stepwise selection of the effects of an oscillator: screened by the equation error of the input,
//! validated by the output error.

use rayon::prelude::*;

use crate::effects::Regressor;
use crate::equation_error::block_roles::{Block, Role};
use crate::equation_error::fit::ShapeSearch;
use crate::equation_error::model::{Fitted, RegressionModel, Structure};
use crate::equation_error::search::{
    FittedCandidate, MOST_EFFECTS, RankedCandidate, SelectionRound, SitedEffect, Unlisted,
    candidates, choose, equally_good, nonparametric, of,
};
use crate::equation_error::spline::{Spline, Variable};
use crate::equation_error::validation::{LEAST_T, Validation, validate};
use crate::output_error::fit::{OutputErrorModel, Record, Simulated};
use crate::output_error::simulation::can_simulate;

/// Number of screened candidates that are simulated.
const SIMULATED: usize = 4;

/// A candidate that was simulated.
#[derive(Clone)]
pub(super) struct SimulatedCandidate {
    /// The effect.
    pub(super) sited: SitedEffect,
    /// Validation of its simulation on the selecting rows.
    pub(super) validation: Validation,
    /// The model with it.
    pub(super) structure: Structure<'static>,
    /// Its simulation.
    pub(super) simulated: Simulated,
    after: Vec<f64>,
    /// Its equation-error fit.
    screened: Fitted,
}

impl SimulatedCandidate {
    fn standing(&self) -> RankedCandidate<'_> {
        RankedCandidate { sited: self.sited, validation: &self.validation, after: &self.after }
    }
}

/// One step: an effect that was added.
pub(super) struct SelectionStep {
    /// Validated candidates: simulated ones first, then those that were only screened; whether each
    /// was simulated.
    pub(super) ranking: Vec<(Validation, bool)>,
    /// The effect that was added.
    pub(super) added: SimulatedCandidate,
    /// Its rivals.
    pub(super) rivals: Vec<SitedEffect>,
}

/// What the search found.
pub(super) struct SearchResult {
    /// The declared model, fitted within its tolerances.
    pub(super) base: Simulated,
    /// Effects in the order in which they were added.
    pub(super) steps: Vec<SelectionStep>,
    /// Candidates of the last round, in which none passed.
    pub(super) last_ranking: Vec<(Validation, bool)>,
    /// Those of them that were simulated.
    pub(super) last_simulated: Vec<SimulatedCandidate>,
    /// Nonparametric functions: validation, table, and whether it was simulated.
    pub(super) nonparametric: Vec<(Validation, Unlisted, bool)>,
    /// The best of them, if it passes.
    pub(super) unlisted: Option<Unlisted>,
}

impl SearchResult {
    /// The last model.
    pub(super) fn last(&self) -> &Simulated {
        self.steps.last().map_or(&self.base, |s| &s.added.simulated)
    }
    /// Its structure.
    pub(super) fn structure(&self) -> Structure<'static> {
        self.steps.last().map_or_else(Structure::default, |s| s.added.structure.clone())
    }
}

struct Search<'a> {
    simulation: OutputErrorModel<'a>,
    fit: Vec<Block>,
    select: Vec<Block>,
}

impl Search<'_> {
    /// A round of screening from a structure and its fit to the balance of the input.
    fn round<'a>(
        &'a self,
        structure: &'a Structure<'static>,
        now: &'a Fitted,
        how: ShapeSearch,
    ) -> SelectionRound<'a> {
        let Self { simulation, fit, select } = self;
        SelectionRound { regression: simulation.regression, structure, now, fit, select, how }
    }

    /// Simulates the best screened candidates; best first.
    fn simulate_best(&self, tried: &[FittedCandidate], now: &Simulated) -> Vec<SimulatedCandidate> {
        let before = self.simulation.mean_squares(now, &self.select);
        let promising: Vec<&FittedCandidate> = tried
            .iter()
            .filter(|t| t.validation.t >= LEAST_T && t.validation.gain_percent > 0.0)
            .take(SIMULATED)
            .collect();
        let simulate = |tried: &FittedCandidate| {
            let start = from_here(&tried.fitted, now);
            let simulated = self.simulation.fit(&tried.structure, &self.fit, &start, &[])?;
            let after = self.simulation.mean_squares(&simulated, &self.select);
            let mut validation = validate(tried.validation.id, &before, &after);
            validation.accepted &= self
                .simulation
                .regression
                .hidden_shift(&tried.structure, &simulated.fitted)
                .is_none();
            let (structure, screened) = (tried.structure.clone(), tried.fitted.clone());
            Some(SimulatedCandidate {
                sited: tried.sited,
                validation,
                structure,
                simulated,
                after,
                screened,
            })
        };
        let mut ranked: Vec<SimulatedCandidate> =
            promising.into_par_iter().filter_map(simulate).collect();
        ranked.sort_by(|a, b| b.validation.gain_percent.total_cmp(&a.validation.gain_percent));
        ranked
    }

    /// Returns at most two equally good candidates that add nothing to the winner.
    fn rivals(&self, winner: &SimulatedCandidate, near: Vec<SitedEffect>) -> Vec<SitedEffect> {
        if near.is_empty() {
            return near;
        }
        let round = self.round(&winner.structure, &winner.screened, ShapeSearch::GridOnly);
        let beside = self.simulate_best(&round.try_all(&near), &winner.simulated);
        let adds = |c: &SitedEffect| {
            beside.iter().any(|b| b.validation.id == c.effect.id && b.validation.accepted)
        };
        near.into_iter().filter(|c| !adds(c)).take(2).collect()
    }

    /// Nonparametric functions, screened, the promising ones simulated.
    fn nonparametric(
        &self,
        round: &SelectionRound<'_>,
        now: &Simulated,
    ) -> Vec<(Validation, Unlisted, bool)> {
        let mut all: Vec<_> = nonparametric(round)
            .into_iter()
            .map(|g| {
                let shows = g.validation.t >= LEAST_T && g.validation.gain_percent > 3.0;
                let ranked = shows
                    .then(|| self.simulate_nonparametric(round, g.unlisted.variable, now))
                    .flatten();
                match ranked {
                    Some((validation, unlisted)) => (validation, unlisted, true),
                    None => (Validation { accepted: false, ..g.validation }, g.unlisted, false),
                }
            })
            .collect();
        all.sort_by(|a, b| {
            (b.2, b.0.gain_percent)
                .partial_cmp(&(a.2, a.0.gain_percent))
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        all
    }

    fn simulate_nonparametric(
        &self,
        round: &SelectionRound<'_>,
        variable: Variable,
        now: &Simulated,
    ) -> Option<(Validation, Unlisted)> {
        let before = &self.simulation.mean_squares(now, &self.select);
        let regression = self.simulation.regression;
        let spline = Spline::over(variable, regression.balances.iter().map(|b| &b.signals))?;
        let nonparametric: &dyn Regressor = &spline;
        nonparametric.law()?;
        let effects = round.structure.effects.iter().copied().chain([nonparametric]).collect();
        let wider = Structure { effects, model: round.structure.model.clone() };
        let start = regression.fit(&wider, &self.fit, &round.now.shapes, ShapeSearch::Fixed)?;
        let simulated = self.simulation.fit(&wider, &self.fit, &from_here(&start, now), &[])?;
        let validation = validate(
            variable.name(),
            before,
            &self.simulation.mean_squares(&simulated, &self.select),
        );
        let fitted = &simulated.fitted;
        let from = fitted.fit.coefficients.len() - spline.knots.len();
        let at =
            |i: usize| [spline.knots[i], fitted.fit.coefficients[from + i], fitted.std[from + i]];
        Some((validation, Unlisted { variable, table: (0..spline.knots.len()).map(at).collect() }))
    }
}

/// Starts known parameters at the simulated model's values, new ones at the screening's.
fn from_here(screened: &Fitted, now: &Simulated) -> Fitted {
    let mut start = screened.clone();
    let known = &now.fitted;
    for (to, from) in start.fit.coefficients.iter_mut().zip(known.fit.coefficients.iter()) {
        *to = *from;
    }
    start.shapes[1..known.shapes.len()].copy_from_slice(&known.shapes[1..]);
    start
}

/// Simulated candidates first, then those that were screened only, which cannot pass.
fn ranking(ranked: &[SimulatedCandidate], tried: &[FittedCandidate]) -> Vec<(Validation, bool)> {
    let simulated = |id: &str| ranked.iter().any(|p| p.validation.id == id);
    let screened = tried.iter().filter(|t| !simulated(t.validation.id)).map(|t| &t.validation);
    let screened = screened.map(|v| (Validation { accepted: false, ..v.clone() }, false));
    ranked.iter().map(|p| (p.validation.clone(), true)).chain(screened).collect()
}

/// Greedy search by simulated output. `None` where not even the declared model can be fitted.
pub(super) fn search(
    regression: &RegressionModel,
    records: &[Record],
    blocks: &[Block],
) -> Option<SearchResult> {
    let (fit, select) = (of(blocks, Role::Fit), of(blocks, Role::Select));
    let search = Search { simulation: OutputErrorModel { regression, records }, fit, select };
    let mut structure = Structure::default();
    let mut screened = regression.fit(&structure, &search.fit, &[], ShapeSearch::Refine)?;
    let base = search.simulation.fit(&structure, &search.fit, &screened, &[])?;
    let mut now = base.clone();
    let mut steps: Vec<SelectionStep> = Vec::new();
    let (last_ranking, last_simulated) = loop {
        let added: Vec<SitedEffect> = steps.iter().map(|s| s.added.sited).collect();
        let list: Vec<SitedEffect> = candidates(regression, &added, &now.fitted)
            .into_iter()
            .filter(|c| regression.frees(c.effect.regressor) || can_simulate(c.effect.regressor))
            .collect();
        // The simulation refines what the screening leaves coarse.
        let round = search.round(&structure, &screened, ShapeSearch::GridOnly);
        let tried = round.try_all(&list);
        let ranked = search.simulate_best(&tried, &now);
        let ranking = ranking(&ranked, &tried);
        let standings: Vec<RankedCandidate<'_>> =
            ranked.iter().map(SimulatedCandidate::standing).collect();
        let room = steps.len() < MOST_EFFECTS;
        let Some(best) = choose(regression, &added, &standings).filter(|_| room) else {
            break (ranking, ranked);
        };
        let rivals = search.rivals(&ranked[best], equally_good(regression, &standings, best));
        let added = ranked[best].clone();
        structure = added.structure.clone();
        screened = added.screened.clone();
        now = added.simulated.clone();
        steps.push(SelectionStep { ranking, added, rivals });
    };
    let round = search.round(&structure, &screened, ShapeSearch::Fixed);
    let nonparametric = search.nonparametric(&round, &now);
    let unlisted = nonparametric.iter().find(|g| g.0.accepted).map(|g| g.1.clone());
    Some(SearchResult { base, steps, last_ranking, last_simulated, nonparametric, unlisted })
}
