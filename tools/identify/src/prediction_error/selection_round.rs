//! One round of the forward selection: the best screened candidates are fitted beside the current
//! model, first briefly, then to convergence while they are competitive.

use plant::effects::search::{MultiStart, Scaling};
use plant::effects::{Site, entry};
use rayon::prelude::*;

use super::candidates::{Candidate, free_parameters_of};
use super::dataset::{Dataset, Fitted};
use super::free_parameter::{AT_BOUND, FreeParameter};
use super::known_columns::KnownColumns;
use super::localisation::localise;
use super::noise_floor::at_floor;
use super::screening::{Projection, ScoredCandidate};
use super::transmission_model::{PlacedEffect, Residual, Setting, TransmissionModel};
use super::validation::{LEAST_FIRST, Validation, validate_beside};

/// Gains within this share of the best count as equal: the fewest parameters win.
const EQUAL_GAIN_SHARE: f64 = 0.97;
/// Candidates that are fitted after the screening.
pub(super) const REFITTED: usize = 12;
/// Those of them that are fitted to convergence.
const FINISHED: usize = 3;
/// Candidates of the first round that are also fitted from the declared values.
const REFITTED_FROM_DECLARED: usize = 3;
/// Candidates fitted by their score at the declared values.
const FROM_DECLARED: usize = 5;
/// Fit rounds that compare several starting points.
const MULTI_START_ROUNDS: usize = 4;
/// Fit rounds from each starting point beside the declared values.
const START_ROUNDS: usize = 2;
/// A starting point is dropped if its brief fit is behind the best by this (log error).
const OUT_OF_REACH: f64 = 0.3;
/// A candidate with less than this share of the best gain is not refined.
const WITHIN_REACH: f64 = 0.6;
/// Smaller gains cannot pass after refinement.
const LEAST_PROMISING_GAIN: f64 = 0.5 * LEAST_FIRST;
/// Gauss-Newton steps before a candidate is continued or dropped.
const QUICK_STEPS: usize = 2;
/// Candidates, by score, that are fitted from all starting points where no model found explains the
/// records.
const LEADING_BY_SCORE: usize = 3;
/// Starting points of each that are fitted to convergence.
const CONTINUED: usize = 2;
/// Fit rounds to convergence.
const CONVERGENCE_ROUNDS: usize = 3;

/// A fitted candidate.
pub struct FittedCandidate {
    /// Index of the candidate.
    pub candidate: usize,
    /// The model with it; the candidate's own parameters are the last of the estimated ones.
    pub fitted: Fitted,
    /// Its validation.
    pub validation: Validation,
}

/// The state from which a round starts.
pub struct SelectionRound<'a> {
    /// Fitting records.
    pub fit: &'a Dataset<'a>,
    /// Selecting records.
    pub select: &'a Dataset<'a>,
    /// The current model.
    pub now: &'a Fitted,
    /// Its residuals on the selecting records.
    pub before: &'a [Residual],
    /// Candidates.
    pub candidates: &'a [Candidate],
}

impl SelectionRound<'_> {
    /// Returns all candidates that were fitted, best first; after the deadline nothing more is
    /// fitted, and the round is incomplete.
    pub fn run(&self) -> Vec<FittedCandidate> {
        let projection = Projection::new(self.fit, self.now);
        let scored = projection.rank(self.fit, self.now, self.candidates);
        let mut tried: Vec<FittedCandidate> = scored
            .par_iter()
            .take(REFITTED)
            .filter_map(|scored| self.quick(scored, &projection))
            .collect();
        // The best by fit and by validation continue.
        let mut chosen = foremost(&tried);
        self.improve(&mut tried, &chosen, 1);
        let nearest = tried.iter().min_by(|a, b| a.fitted.objective.total_cmp(&b.fitted.objective));
        let Some(nearest) = nearest else { return tried };
        let mut foremost_by_score = leading_candidates(&scored);
        let mut at_declared = None;
        if !at_floor(self.fit.model, &self.select.records, &nearest.fitted.setting) {
            at_declared = self.refit_from_declared(&mut tried, &chosen);
            let at_declared = at_declared.as_ref().map(|(projection, _)| projection);
            self.refit_from_all_starts(&mut tried, (&projection, at_declared));
            chosen = foremost(&tried);
        }
        // Candidates far behind cannot win after refinement.
        let most = chosen
            .iter()
            .map(|index| tried[*index].validation.gain)
            .fold(LEAST_PROMISING_GAIN, f64::max);
        chosen.retain(|index| tried[*index].validation.gain >= WITHIN_REACH * most);
        self.improve(&mut tried, &chosen, CONVERGENCE_ROUNDS);
        self.elsewhere(&mut tried);
        // In the first round only: it takes as long as the rest of a round, and in trials later
        // rounds gained nothing by it.
        if self.now.setting.placed.is_empty() && !self.is_explained(&tried) {
            let (at_declared, there) = at_declared.unzip();
            foremost_by_score.extend(there.unwrap_or_default());
            foremost_by_score.sort_unstable();
            foremost_by_score.dedup();
            let projections = (&projection, at_declared.as_ref());
            self.refit_leading_candidates(&mut tried, &foremost_by_score, projections);
            self.elsewhere(&mut tried);
        }
        tried.sort_by(|a, b| b.validation.gain.total_cmp(&a.validation.gain));
        tried
    }

    /// Free parameters with the candidate as the last effect of the setting.
    fn free(&self, candidate: usize, setting: &Setting) -> Vec<FreeParameter> {
        let own =
            free_parameters_of(&self.candidates[candidate], setting.placed.len().saturating_sub(1));
        self.now.parameters.iter().cloned().chain(own).collect()
    }

    fn validation(&self, candidate: usize, fitted: Fitted) -> Option<FittedCandidate> {
        let selected = self.select.residuals(&fitted.setting)?;
        let of = &self.candidates[candidate];
        let beside = self.now.setting.placed.len();
        let mut validation = validate_beside(beside, (of.id, of.site), self.before, &selected);
        if beside > 0 {
            // A shape at its lower bound has degenerated into another law, which absorbs the
            // residual of the effect beside it.
            let own = free_parameters_of(of, fitted.setting.placed.len().saturating_sub(1));
            let gone = |parameter: &FreeParameter| {
                matches!(parameter, FreeParameter::Effect { range, .. }
                    if range.scaling == Scaling::Logarithmic)
                    && parameter.normalised(self.fit.model, &fitted.setting) < -AT_BOUND
            };
            validation.accepted &= !own.iter().any(gone);
        }
        Some(FittedCandidate { candidate, fitted, validation })
    }

    fn fitted(
        &self,
        candidate: usize,
        start: &Setting,
        rounds: usize,
        columns: Option<&KnownColumns>,
    ) -> Option<FittedCandidate> {
        if self.fit.deadline.has_passed() {
            return None;
        }
        let free = self.free(candidate, start);
        let fitted = self.fit.fit_beginning_with(start, &free, rounds, columns)?;
        self.validation(candidate, fitted)
    }

    /// Takes a step or two with the Jacobian of the current model.
    fn quick(&self, scored: &ScoredCandidate, projection: &Projection) -> Option<FittedCandidate> {
        if self.fit.deadline.has_passed() {
            return None;
        }
        let start = self.now.setting.with(&scored.placed);
        let free = self.free(scored.candidate, &start);
        let known = self.now.parameters.len();
        let own = &free[known..];
        let mut fitted = self.fit.evaluate(self.fit.inside(start, &free))?;
        for _ in 0..QUICK_STEPS {
            let KnownColumns { weights, jacobian, .. } = &projection.columns;
            let of_effect = self.fit.jacobian(&fitted, own, weights);
            let mut jacobian = jacobian.clone().resize_horizontally(free.len(), 0.0);
            jacobian.columns_mut(known, of_effect.ncols()).copy_from(&of_effect);
            match self.fit.step(&fitted, &free, &jacobian, weights) {
                Some(better) => fitted = better,
                None => break,
            }
        }
        self.validation(scored.candidate, Fitted { parameters: free, ..fitted })
    }

    /// Fits some of the candidates further.
    fn improve(&self, tried: &mut Vec<FittedCandidate>, chosen: &[usize], rounds: usize) {
        let start = |index: &usize| (tried[*index].candidate, tried[*index].fitted.setting.clone());
        let starts: Vec<(usize, Setting)> = chosen.iter().map(start).collect();
        self.fit_from(tried, &starts, rounds, None);
    }

    /// Fits candidates from starting points, in parallel.
    fn fit_from(
        &self,
        tried: &mut Vec<FittedCandidate>,
        starts: &[(usize, Setting)],
        rounds: usize,
        columns: Option<&KnownColumns>,
    ) {
        let found: Vec<FittedCandidate> = starts
            .par_iter()
            .filter_map(|(candidate, start)| self.fitted(*candidate, start, rounds, columns))
            .collect();
        found.into_iter().for_each(|found| better_of(tried, found));
    }

    /// Without the effect, declared parameters may have been biased until little of it shows;
    /// candidates are therefore also screened and fitted from the declared values. Returns the
    /// projection there and the leading candidates by score; `None` if that cannot be simulated, or
    /// after the deadline.
    fn refit_from_declared(
        &self,
        tried: &mut Vec<FittedCandidate>,
        chosen: &[usize],
    ) -> Option<(Projection, Vec<usize>)> {
        let model = self.fit.model;
        if self.now.setting.placed.is_empty() {
            let fresh = |index: &usize| {
                let FittedCandidate { candidate, fitted, .. } = &tried[*index];
                (*candidate, Setting { base: model.start().base, ..fitted.setting.clone() })
            };
            let starts: Vec<(usize, Setting)> =
                chosen.iter().take(REFITTED_FROM_DECLARED).map(fresh).collect();
            self.fit_from(tried, &starts, CONVERGENCE_ROUNDS, None);
        }
        if self.fit.deadline.has_passed() {
            return None;
        }
        // Beside an effect the declared values may diverge.
        let parameters = self.now.parameters.clone();
        let declared = self.fit.inside(declared(model, &self.now.setting), &parameters);
        let start = Fitted { parameters, ..self.fit.evaluate(declared)? };
        let projection = Projection::new(self.fit, &start);
        let ranked = projection.rank(self.fit, &start, self.candidates);
        let with =
            |scored: &ScoredCandidate| (scored.candidate, start.setting.with(&scored.placed));
        let starts: Vec<(usize, Setting)> = ranked.iter().take(FROM_DECLARED).map(with).collect();
        self.fit_from(tried, &starts, QUICK_STEPS, Some(&projection.columns));
        Some((projection, leading_candidates(&ranked)))
    }

    /// Whether the current model or the winner, as fitted so far, reaches the noise floor.
    fn is_explained(&self, tried: &[FittedCandidate]) -> bool {
        let reached =
            |fitted: &Fitted| at_floor(self.fit.model, &self.select.records, &fitted.setting);
        winner(tried).is_some_and(|winner| reached(&winner.fitted)) || reached(self.now)
    }

    /// Fits candidates from all their starting points to convergence, at the current parameters and
    /// at the declared ones: a local minimum refutes no candidate, and the size that the score
    /// suggests is too small where declared parameters have absorbed most of the effect.
    fn refit_leading_candidates(
        &self,
        tried: &mut Vec<FittedCandidate>,
        leading: &[usize],
        (here, at_declared): (&Projection, Option<&Projection>),
    ) {
        let declared = declared(self.fit.model, &self.now.setting);
        for candidate in leading.iter().copied() {
            if self.fit.deadline.has_passed() {
                return;
            }
            let mut begun = self.begin(candidate, &self.now.setting, 1, Some(here));
            begun.extend(self.begin(candidate, &declared, START_ROUNDS, at_declared));
            begun.sort_by(|a, b| a.objective.total_cmp(&b.objective));
            begun.truncate(CONTINUED);
            self.finish(tried, candidate, begun);
        }
    }

    /// Fits a candidate briefly beside a setting, from all its starting points.
    fn begin(
        &self,
        candidate: usize,
        from: &Setting,
        rounds: usize,
        at: Option<&Projection>,
    ) -> Vec<Fitted> {
        let of = &self.candidates[candidate];
        let starts: Vec<Setting> = of.starts.iter().map(|start| from.with(start)).collect();
        let Some(first) = starts.first() else { return Vec::new() };
        let free = self.free(candidate, first);
        self.fit.leading(&starts, &free, rounds, at.map(|at| &at.columns))
    }

    /// Continues those brief fits of a candidate that are within reach of the nearest one.
    fn finish(&self, tried: &mut Vec<FittedCandidate>, candidate: usize, begun: Vec<Fitted>) {
        let nearest =
            tried.iter().map(|tried| tried.fitted.objective).fold(f64::INFINITY, f64::min);
        let reach = nearest + OUT_OF_REACH * self.now.rows() as f64;
        let within = begun.into_iter().filter(|begun| begun.objective <= reach);
        let starts: Vec<(usize, Setting)> =
            within.map(|begun| (candidate, begun.setting)).collect();
        self.fit_from(tried, &starts, MULTI_START_ROUNDS, None);
    }

    /// Fits multi-start candidates from all their starting points, at the current parameters; where
    /// the unmodelled torque was localised, only candidates at that site, and from the declared
    /// values too.
    fn refit_from_all_starts(
        &self,
        tried: &mut Vec<FittedCandidate>,
        (here, at_declared): (&Projection, Option<&Projection>),
    ) {
        let localisation = localise((self.fit, self.select), &self.now.setting)
            .filter(|localisation| localisation.site() != Site::Line);
        let declared = declared(self.fit.model, &self.now.setting);
        for (candidate, of) in self.candidates.iter().enumerate() {
            let from_all_starts = match &localisation {
                Some(localisation) => of.multi_start.is_some() && localisation.may_be_at(of.site),
                None => of.multi_start == Some(MultiStart::Always),
            };
            if !from_all_starts {
                continue;
            }
            if self.fit.deadline.has_passed() {
                return;
            }
            let mut begun = self.begin(candidate, &self.now.setting, 1, Some(here));
            if localisation.is_some() {
                begun.extend(self.begin(candidate, &declared, START_ROUNDS, at_declared));
            }
            self.finish(tried, candidate, begun);
        }
    }

    /// Fits a candidate in place of the last effect of a setting, from all its starting points.
    fn instead(&self, tried: &mut Vec<FittedCandidate>, setting: &Setting, which: (&str, Site)) {
        let Some(candidate) = self.candidates.iter().position(|of| (of.id, of.site) == which)
        else {
            return;
        };
        let with = |start: &PlacedEffect| {
            let mut with = setting.clone();
            if let Some(placed) = with.placed.last_mut() {
                *placed = start.clone();
            }
            (candidate, with)
        };
        let starts: Vec<(usize, Setting)> =
            self.candidates[candidate].starts.iter().map(with).collect();
        self.fit_from(tried, &starts, MULTI_START_ROUNDS, None);
    }

    /// Fits the best effect at its other sites, and the simpler effect that it degenerates into at
    /// its bound.
    fn elsewhere(&self, tried: &mut Vec<FittedCandidate>) {
        let best = tried.iter().max_by(|a, b| a.validation.gain.total_cmp(&b.validation.gain));
        let Some(best) = best.filter(|best| best.validation.accepted) else { return };
        let (id, from, setting) = (best.validation.id, best.candidate, best.fitted.setting.clone());
        let own =
            free_parameters_of(&self.candidates[from], setting.placed.len().saturating_sub(1));
        let at_bound = |name: &str| {
            own.iter().any(|parameter| {
                matches!(parameter, FreeParameter::Effect { range, .. } if range.name == name)
                    && parameter.normalised(self.fit.model, &setting) > AT_BOUND
            })
        };
        let becomes = entry(id).and_then(|entry| entry.search.becomes);
        if let Some(simpler) = becomes.filter(|simpler| at_bound(simpler.parameter)) {
            self.instead(tried, &setting, (simpler.id, self.candidates[from].site));
        }
        let moved = |(candidate, of): (usize, &Candidate)| {
            let mut moved = setting.clone();
            if let Some(placed) = moved.placed.last_mut() {
                placed.site = of.site;
            }
            (candidate, moved)
        };
        let others = self.candidates.iter().enumerate();
        let others = others.filter(|(candidate, of)| of.id == id && *candidate != from);
        let starts: Vec<(usize, Setting)> = others.map(moved).collect();
        self.fit_from(tried, &starts, CONVERGENCE_ROUNDS, None);
    }
}

/// The candidates with the highest scores.
fn leading_candidates(ranked: &[ScoredCandidate]) -> Vec<usize> {
    ranked.iter().take(LEADING_BY_SCORE).map(|scored| scored.candidate).collect()
}

/// The best by fit, then the best by validation.
fn foremost(tried: &[FittedCandidate]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..tried.len()).collect();
    order.sort_by(|a, b| tried[*a].fitted.objective.total_cmp(&tried[*b].fitted.objective));
    let mut chosen: Vec<usize> = order.iter().copied().take(FINISHED).collect();
    order.sort_by(|a, b| tried[*b].validation.gain.total_cmp(&tried[*a].validation.gain));
    let holders: Vec<usize> =
        order.into_iter().take(2).filter(|index| !chosen.contains(index)).collect();
    chosen.extend(holders);
    chosen
}

/// Inserts a candidate, or keeps the better fit if it is present already.
fn better_of(tried: &mut Vec<FittedCandidate>, found: FittedCandidate) {
    match tried.iter_mut().find(|known| known.candidate == found.candidate) {
        Some(known) if known.fitted.objective <= found.fitted.objective => {}
        Some(known) => *known = found,
        None => tried.push(found),
    }
}

/// Returns a setting with declared parameters at their declared values; others stay as fitted.
fn declared(model: &TransmissionModel, now: &Setting) -> Setting {
    let base = model
        .base
        .iter()
        .zip(&now.base)
        .map(|(parameter, fitted)| parameter.declared.unwrap_or(*fitted));
    Setting { base: base.collect(), ..now.clone() }
}

/// Returns the winner: of the candidates that passed with about the best gain, the one with the
/// fewest parameters.
pub fn winner(tried: &[FittedCandidate]) -> Option<&FittedCandidate> {
    let passed = || tried.iter().filter(|tried| tried.validation.accepted);
    let most = passed().map(|tried| tried.validation.gain).max_by(f64::total_cmp)?;
    passed()
        .filter(|tried| tried.validation.gain >= EQUAL_GAIN_SHARE * most)
        .min_by_key(|tried| tried.fitted.parameters.len())
}
