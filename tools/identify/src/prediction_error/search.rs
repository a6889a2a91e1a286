//! Stepwise selection of effects: forward rounds that fit, screen, refit and validate candidates,
//! with backward elimination and substitution after each.

use plant::effects::entry;
use plant::effects::search::Choice;

use super::backward_elimination::{
    DISTINCT_GAIN, equivalent_site, redundant_effect, rivals, single_effect_models, substitute,
    without_newest,
};
use super::candidates::{Candidate, candidates};
use super::dataset::{Dataset, Fitted};
use super::floor_comparison::FloorComparison;
use super::noise_floor::at_floor;
use super::nonparametric_search::{
    LEAST_HINT, NonparametricResult, least_hint, search_nonparametric,
};
use super::record_features::record_features;
use super::rectified_torque::{rectified_records, restore_signs};
use super::refit::{fit_base, refit, refit_declared};
use super::search_result::{SearchResult, SelectionStep, Unfinished};
use super::selection_round::{FittedCandidate, SelectionRound, winner};
use super::step_refinement::{holds_with_finer_steps, may_be_step_artefact, refine_steps};
use super::transmission_model::TransmissionModel;
use super::validation::{LEAST_FIRST, LEAST_GAIN, Validation, is_bistable, validate};
use crate::deadline::Deadline;
use crate::equation_error::block_roles::Role;

/// Gain over an added effect from which another candidate replaces it.
const REPLACEMENT_GAIN: f64 = 0.03;
/// Most effects added.
const MOST_EFFECTS: usize = 3;
/// Most rounds, including those whose effect was removed again.
const MOST_ROUNDS: usize = 5;
/// Least share of the first round's best gain from which another candidate that passed is tried
/// as the first effect. The right ones of the two pairs from which the limit is taken had 0.61 and
/// 0.82 of it.
const OTHER_FIRST_GAIN_SHARE: f64 = 0.5;
/// Least share of a round's best gain from which another candidate is tried in its place.
const RIVAL_GAIN_SHARE: f64 = 0.25;
/// Share of a model's gain that the same model with an equivalent effect must reach.
const EQUIVALENT_GAIN_SHARE: f64 = 0.75;
/// Fit rounds with an equivalent effect.
const EQUIVALENT_FIT_ROUNDS: usize = 3;
/// Colour below which a nonparametric function replaces named effects that leave no noise.
const WHITER: f64 = 0.75;
/// Share of the time limit after which no further effect is tried: what remains tells where an
/// effect acts that has no name.
const ROUNDS_SHARE: f64 = 0.75;
/// Fit rounds with the other instrument.
const CHOICE_FIT_ROUNDS: usize = 4;

/// Runs the whole selection, or as much of it as the deadline permits: effects of rounds that were
/// finished stay. Recovered signs of a rectified torque are stored in the records. `None` if not
/// even the declared model can be simulated along the records.
pub fn search(model: &mut TransmissionModel, deadline: &Deadline) -> Option<SearchResult> {
    prepare(model, deadline)?;
    let rounds = deadline.part(ROUNDS_SHARE);
    let mut search = Search::begin(model, &rounds)?;
    search.extend(|_| true);
    search.select_from_other_first_effects();
    Some(search.conclude(deadline))
}

/// Fits the declared model alone, as [`search`] begins with it.
pub fn fit_declared(model: &mut TransmissionModel, deadline: &Deadline) -> Option<Fitted> {
    prepare(model, deadline)?;
    Search::begin(model, deadline).map(|search| search.now)
}

/// Chooses the steps of the simulation, and recovers the signs of a rectified torque.
fn prepare(model: &mut TransmissionModel, deadline: &Deadline) -> Option<()> {
    refine_steps(model);
    let hands = rectified_records(model);
    if !hands.is_empty() {
        let idle = Dataset::of(model, Role::Fit).without(&hands).until(deadline);
        if !idle.records.is_empty() {
            let select = Dataset::of(model, Role::Select).without(&hands).until(deadline);
            let base = fit_base((&idle, &select))?;
            restore_signs(model, hands, &base.setting)?;
        }
    }
    Some(())
}

/// The listed effects that the records can reveal beside those of a model.
pub(super) fn candidates_beside(fit: &Dataset<'_>, now: &Fitted) -> Vec<Candidate> {
    let is_placed = |candidate: &Candidate| {
        let placed = now.setting.placed.iter();
        placed.map(|own| (own.id, own.site)).any(|own| own == (candidate.id, candidate.site))
    };
    let mut listed = candidates(&record_features(fit, now));
    listed.retain(|candidate| !is_placed(candidate));
    listed
}

/// State of the selection.
pub(super) struct Search<'a> {
    pub(super) fit: Dataset<'a>,
    pub(super) select: Dataset<'a>,
    /// The current model.
    pub(super) now: Fitted,
    /// Runners-up of the first round.
    pub(super) runners_up: Vec<Fitted>,
    /// Those of them that may be the first effect instead.
    pub(super) other_first_effects: Vec<Fitted>,
    /// Runners-up of the latest round.
    pub(super) latest: Vec<Fitted>,
    pub(super) found: SearchResult,
}

impl<'a> Search<'a> {
    /// A selection that has come to a model, without runners-up.
    pub(super) fn of(
        (fit, select): (Dataset<'a>, Dataset<'a>),
        now: Fitted,
        found: SearchResult,
    ) -> Self {
        let [runners_up, other_first_effects, latest] = Default::default();
        Self { fit, select, now, runners_up, other_first_effects, latest, found }
    }

    pub(super) fn begin(model: &'a TransmissionModel, deadline: &'a Deadline) -> Option<Self> {
        let [fit, select] =
            [Role::Fit, Role::Select].map(|role| Dataset::of(model, role).until(deadline));
        let base = fit_base((&fit, &select))?;
        let now = base.clone();
        let unfinished = deadline.left_work_out().then_some(Unfinished::DeclaredModel);
        let found = SearchResult { base, unfinished, ..SearchResult::default() };
        Some(Self::of((fit, select), now, found))
    }
}

impl<'a> Search<'a> {
    /// The error of a model on the selecting records against the noise floor.
    pub(super) fn against_floor(&self, fitted: &Fitted) -> FloorComparison {
        FloorComparison::of(self.fit.model, &self.select.records, &fitted.setting)
    }

    const fn views(&self) -> (&Dataset<'_>, &Dataset<'_>) {
        (&self.fit, &self.select)
    }

    /// Adds effects while there are any that pass and the model is `worthwhile` extending.
    pub(super) fn extend(&mut self, worthwhile: impl Fn(&Self) -> bool) {
        // If a later model diverges, the result so far stands.
        while self.found.steps.len() < MOST_EFFECTS
            && self.found.rounds.len() < MOST_ROUNDS
            && worthwhile(self)
            && self.add()
        {
            self.drop_redundant();
            self.substitute();
            if self.compare_with_runners_up().is_none() {
                break;
            }
        }
    }

    /// Adds the best candidate that passes and refits; returns whether there was one. No candidate
    /// passes in a round that the deadline cut short: better ones may not have been tried.
    fn add(&mut self) -> bool {
        let (fit, select, now) = (&self.fit, &self.select, &self.now);
        if fit.deadline.has_passed() {
            return false;
        }
        let Some(before) = select.residuals(&now.setting) else { return false };
        let listed = candidates_beside(fit, now);
        let round = SelectionRound { fit, select, now, before: &before, candidates: &listed };
        let mut tried = round.run();
        let held = |tried: &FittedCandidate| {
            now.setting.placed.is_empty()
                || !may_be_step_artefact(tried.validation.id)
                || holds_with_finer_steps(self.views(), now, tried)
        };
        while let Some(at) =
            winner(&tried).filter(|winner| !held(winner)).map(|winner| winner.candidate)
        {
            if let Some(step) = tried.iter_mut().find(|tried| tried.candidate == at) {
                step.validation.accepted = false;
            }
        }
        if fit.deadline.left_work_out() {
            tried.iter_mut().for_each(|tried| tried.validation.accepted = false);
            self.found.unfinished = Some(Unfinished::Candidates);
        }
        self.found.rounds.push(tried.iter().map(|tried| tried.validation.clone()).collect());
        let Some(winner) = winner(&tried) else { return false };
        self.found.steps.push(SelectionStep {
            added: winner.validation.clone(),
            rivals: Vec::new(),
            fitted: winner.fitted.clone(),
        });
        let is_rival = |other: &&FittedCandidate| {
            let least = LEAST_FIRST.max(RIVAL_GAIN_SHARE * winner.validation.gain);
            other.candidate != winner.candidate && other.validation.gain >= least
        };
        self.latest = tried.iter().filter(is_rival).map(|other| other.fitted.clone()).collect();
        if self.found.rounds.len() == 1 {
            self.runners_up.clone_from(&self.latest);
            let least = OTHER_FIRST_GAIN_SHARE * winner.validation.gain;
            let may_be_first = |other: &&FittedCandidate| {
                is_rival(other) && other.validation.accepted && other.validation.gain >= least
            };
            let others = tried.iter().filter(may_be_first).map(|other| other.fitted.clone());
            self.other_first_effects = others.collect();
        }
        let with = refit((fit, select), &winner.fitted, &listed[winner.candidate]);
        self.now = match without_newest((fit, select), now, &with) {
            Some(without) => {
                let step = self.found.steps.pop();
                self.found.given_up.extend(step.map(|step| step.added.effect()));
                without
            }
            None => with,
        };
        true
    }

    /// Removes effects that the newest one made redundant.
    fn drop_redundant(&mut self) {
        while let Some((at, fitted)) = redundant_effect(self.views(), &self.now) {
            let step = self.found.steps.remove(at);
            self.found.given_up.push(step.added.effect());
            self.now = fitted;
        }
    }

    /// Substitutes effects by runners-up that do clearly better beside the rest, until the noise
    /// floor is reached in every octave.
    fn substitute(&mut self) {
        let count = self.found.steps.len();
        for at in (0..count).filter(|_| count > 1) {
            let floor = self.against_floor(&self.now);
            if floor.at_floor_in_sum() && floor.is_white() {
                return;
            }
            let runners_up = if at + 1 == count { &self.latest } else { &self.runners_up };
            let Some(found) = substitute(self.views(), &self.now, at, runners_up) else {
                continue;
            };
            let step = &mut self.found.steps[at];
            self.found.given_up.push(step.added.effect());
            let gain = step.added.gain + found.beside.gain;
            step.added =
                Validation { id: found.beside.id, site: found.beside.site, gain, ..step.added };
            step.rivals.clear();
            self.now = found.fitted;
        }
    }

    /// Fits the first round's runners-up alone: one that does as well replaces all effects; those
    /// that the records cannot distinguish from a single effect become its rivals.
    fn compare_with_runners_up(&mut self) -> Option<()> {
        let single_effect_models = single_effect_models(self.views(), &self.now, &self.runners_up)?;
        let enough = if self.found.steps.len() > 1 { LEAST_GAIN } else { -REPLACEMENT_GAIN };
        match &single_effect_models[..] {
            // One effect does as well as several, or better than the first winner after its refit.
            [best, rest @ ..] if best.beside.gain < enough => {
                self.found.give_up_all();
                self.now = best.fitted.clone();
                let added = self.beside_declared()?;
                let rivals = rivals(added.effect(), (&best.fitted, &best.selected), rest);
                self.found.steps.push(SelectionStep { added, rivals, fitted: self.now.clone() });
            }
            all => {
                if let [only] = &mut self.found.steps[..] {
                    let selected = self.select.residuals(&self.now.setting)?;
                    only.rivals = rivals(only.added.effect(), (&self.now, &selected), all);
                }
            }
        }
        if self.found.steps.len() == 1 && self.found.rounds.len() > 1 {
            // It may have been added beside another effect.
            self.found.steps[0].added = self.beside_declared()?;
        }
        Some(())
    }

    /// Adds the equivalent effect at another site as a rival where it explains nearly as much: the
    /// difference is numerical.
    fn name_equivalents(&mut self) -> Option<()> {
        let (without, with) = (
            self.select.residuals(&self.found.base.setting)?,
            self.select.residuals(&self.now.setting)?,
        );
        for at in 0..self.found.steps.len() {
            let added = self.found.steps[at].added.effect();
            let (id, Some(site)) = (added.0, equivalent_site(added)) else { continue };
            let already_present =
                self.now.setting.placed.iter().any(|placed| (placed.id, placed.site) == (id, site));
            if already_present || !self.found.steps[at].rivals.is_empty() {
                continue;
            }
            let mut setting = self.now.setting.clone();
            setting.placed[at].site = site;
            let Some(fitted) = self.fit.fit(&setting, &self.now.parameters, EQUIVALENT_FIT_ROUNDS)
            else {
                continue;
            };
            let moved = self.select.residuals(&fitted.setting)?;
            let [own_gain, equivalent_gain] =
                [&with, &moved].map(|after| validate((id, site), &without, after).gain);
            if equivalent_gain >= EQUIVALENT_GAIN_SHARE * own_gain {
                self.found.steps[at].rivals.push((id, site));
            }
        }
        Some(())
    }

    /// Compares the effect of one instrument with that of the other, where the two are hard to
    /// distinguish; the other replaces it only if it gains [`REPLACEMENT_GAIN`] more.
    fn compare_instruments(&mut self) -> Option<()> {
        let mut with = self.select.residuals(&self.now.setting)?;
        for at in 0..self.found.steps.len() {
            let (id, site) = self.found.steps[at].added.effect();
            let mut setting = self.now.setting.clone();
            let choice = entry(id).and_then(|entry| entry.search.choice);
            let instrument = choice.and_then(|Choice { parameter, .. }| {
                setting.placed[at].values.iter_mut().find(|(name, _)| *name == parameter)
            });
            let Some(instrument) = instrument else { continue };
            instrument.1 = 1.0 - instrument.1;
            let Some(other) = self.fit.fit(&setting, &self.now.parameters, CHOICE_FIT_ROUNDS)
            else {
                continue;
            };
            let Some(there) = self.select.residuals(&other.setting) else { continue };
            let mut beside = validate((id, site), &there, &with).gain;
            if beside < -REPLACEMENT_GAIN {
                (self.now, with, beside) = (other, there, -beside);
            }
            if beside < DISTINCT_GAIN && self.found.steps[at].rivals.is_empty() {
                self.found.steps[at].rivals.push((id, site));
            }
        }
        Some(())
    }

    /// Validates a single-effect model against the declared one.
    pub(super) fn beside_declared(&self) -> Option<Validation> {
        let only = self.now.setting.placed.first()?;
        let [before, after] =
            [&self.found.base, &self.now].map(|fitted| self.select.residuals(&fitted.setting));
        Some(validate((only.id, only.site), &before?, &after?))
    }

    /// Fits the declared model once more, from where the extended one ended and from the declared
    /// values. Where it reaches the noise floor and the effects no longer pass, nothing is missing.
    fn refit_declared(&mut self) {
        let named = !self.found.steps.is_empty();
        let (model, records) = (self.fit.model, &self.select.records);
        let floor = |fitted: &Fitted| at_floor(model, records, &fitted.setting);
        if self.fit.deadline.has_passed() || (!named && floor(&self.found.base)) {
            return;
        }
        let there = named.then_some(&self.now.setting);
        let Some(fitted) = refit_declared(&self.fit, &self.found.base, there) else { return };
        let enough = floor(&fitted);
        self.found.base = fitted;
        // Effects of few rows pass at the floor; of an unobserved slave some imitate its creep.
        let fails = |beside: Validation| {
            model.slave_unobserved() || !beside.accepted || beside.gain < LEAST_GAIN
        };
        if !named || (enough && self.beside_declared().is_some_and(fails)) {
            self.found.give_up_all();
            self.now = self.found.base.clone();
        }
    }

    /// Decides on adequacy and searches nonparametric functions, until a deadline that is later
    /// than that of the rounds.
    fn conclude(mut self, deadline: &'a Deadline) -> SearchResult {
        let cut_short = self.fit.deadline.left_work_out();
        self.fit = self.fit.until(deadline);
        self.select = self.select.until(deadline);
        self.refit_declared();
        self.name_equivalents();
        self.compare_instruments();
        if let Some(step) = self.found.steps.last_mut() {
            step.fitted = self.now.clone();
        }
        let floor = self.against_floor(&self.now);
        let coloured = floor.is_coloured();
        let at_floor = floor.at_floor_in_sum() && !coloured;
        let late = deadline.has_passed();
        let short = cut_short || late;
        // Names that leave the error far above the repeatability are no names.
        if short && floor.in_sum.is_some_and(|above| above.inadequate()) {
            self.found.give_up_all();
        }
        let what = match self.found.steps.is_empty() {
            true => Unfinished::Candidates,
            false => Unfinished::Comparison,
        };
        if short {
            self.found.unfinished.get_or_insert(what);
        }
        let mut inadequate = self.found.is_refuted(self.views(), &floor);
        // A fitted model that is refuted lacks something, whatever was not tried: it is placed.
        let refuted = inadequate && self.found.unfinished != Some(Unfinished::DeclaredModel);
        if late || (cut_short && !refuted) {
            self.found.conclude_early(true, what, at_floor);
            return self.found;
        }
        // Inadequate effects would distort a function beside them.
        let declared = &self.found.base;
        let mut nonparametric = inadequate.then(|| {
            let hint = least_hint(self.found.rounds.first());
            search_nonparametric(self.views(), declared, Some(hint))
        });
        if !inadequate && !at_floor && !self.found.steps.is_empty() {
            nonparametric = self.function_instead(coloured);
            inadequate = nonparametric.is_some();
        }
        let nonparametric = match nonparametric {
            Some(nonparametric) => nonparametric,
            None if at_floor => NonparametricResult::default(),
            None => search_nonparametric(self.views(), &self.now, coloured.then_some(LEAST_HINT)),
        };
        self.found.take_nonparametric(&self.select, nonparametric, (inadequate, coloured));
        let functions_left_out = deadline.left_work_out();
        self.found.conclude_early(functions_left_out, Unfinished::Functions, at_floor);
        let in_sum = floor.in_sum;
        self.found.hidden_by_friction = in_sum.is_some_and(|above| above.hidden_by_friction());
        self.found
    }

    /// A single nonparametric function that explains more than the effects named, which leave what
    /// is `coloured` or not: listed effects must not lose against it.
    fn function_instead(&self, coloured: bool) -> Option<NonparametricResult> {
        let anonymous = search_nonparametric(self.views(), &self.found.base, None);
        let best = anonymous.best.as_ref().filter(|best| best.validation.accepted)?;
        let [named, unlisted_function] =
            [&self.now, &best.fitted].map(|fitted| self.select.residuals(&fitted.setting));
        let by = (self.found.steps.iter().map(|step| step.added.effect()))
            .find(|(id, _)| is_bistable(id))
            .unwrap_or(best.validation.effect());
        let more = named
            .zip(unlisted_function)
            .map(|(named, unlisted_function)| validate(by, &named, &unlisted_function).gain);
        let function = self.against_floor(&best.fitted);
        let whiter = coloured && function.colour.is_some_and(|colour| colour < WHITER);
        (whiter || more.is_some_and(|more| more >= LEAST_GAIN)).then_some(anonymous)
    }
}
