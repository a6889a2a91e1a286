//! From records to what the model lacks, round by round: fit, screen, refit the best, judge them on
//! records that took no part.

use plant::effects::Site;

use super::catalogue::{Candidate, candidates};
use super::finer::{holds, may_be_the_step};
use super::fit::{Fitted, View};
use super::folded::{folded, unfold};
use super::judge::{Judged, LEAST_GAIN, above_floor, at_floor, has_two_ways, judge};
use super::knob::Knob;
use super::machine::Machine;
use super::origin::Origin;
use super::prune::{AS_GOOD, Other, alone, effect_count, exchange, needless, rivals, twin};
use super::refit::{fit_base, refit};
use super::round::{Round, Tried, winner};
use super::screen::scale;
use super::unnamed::{Nameless, Unnamed, functions};
use crate::inverse::split::Role;

/// A gain beyond that of the one that was added, by which another takes its place.
const BETTER: f64 = 0.03;
/// Most effects that are added.
const MOST_EFFECTS: usize = 3;
/// Most rounds, with those whose effect was given up again.
const MOST_ROUNDS: usize = 5;
/// Share of the best one's gain from which another of the first round may stand for several
/// effects, or in the place of the best.
const A_RIVAL: f64 = 0.25;
/// Share of what a model gains that one with an effect's twin must.
const AS_MUCH: f64 = 0.75;
/// Rounds of the fit of an effect in another's place.
const AS_A_TWIN: usize = 3;
/// Rounds of the fit with the other encoder, which begins from the wave of this one.
const AS_ANOTHER_ENCODER: usize = 4;
/// Parameter of an encoder that is out of centre: which one.
pub const WHICH_ENCODER: &str = "on_master";
/// Rounds of the fit that follows when an effect is taken back.
const AFTER_TAKING_BACK: usize = 4;

/// An effect that was added.
#[derive(Clone, Debug)]
pub struct Step {
    /// The one that was added.
    pub added: Judged,
    /// What the records cannot tell from it.
    pub rivals: Vec<(&'static str, Site)>,
    /// The model with it.
    pub fitted: Fitted,
}

/// What a search found.
#[derive(Clone, Debug)]
pub struct Found {
    /// The declared model, fitted within its tolerances.
    pub base: Fitted,
    /// What of it its own fit moved.
    pub base_knobs: Vec<Knob>,
    /// What of it the last fit moved.
    pub knobs: Vec<Knob>,
    /// Effects in the order in which they were added.
    pub steps: Vec<Step>,
    /// All that were fitted in each round, best first; in the last round none passed, unless it is
    /// the third.
    pub rounds: Vec<Vec<Judged>>,
    /// Effects that were added and given up again when a later one explained what they had.
    pub given_up: Vec<(&'static str, Site)>,
    /// Functions without a name after that.
    pub generic: Vec<Judged>,
    /// The best of them, where it passes.
    pub nameless: Option<Nameless>,
    /// Where what has no name enters, whatever it depends on; told where there is no name to be
    /// had.
    pub origin: Option<Origin>,
    /// Knobs of the effects that were added.
    pub effect_knobs: Vec<Knob>,
    /// Whether so much is left beside what repeats differ by that no name is to be had.
    pub inadequate: bool,
}

impl Found {
    /// The model with all effects; with a function without a name where there is no name to be had.
    pub fn last(&self) -> &Fitted {
        let unnamed = self.unnamed().map(|nameless| &nameless.fitted);
        self.steps.last().map(|step| &step.fitted).or(unnamed).unwrap_or(&self.base)
    }

    /// The function without a name, where there is no name to be had.
    pub fn unnamed(&self) -> Option<&Nameless> {
        self.nameless.as_ref().filter(|_| self.inadequate)
    }

    /// Where what has no name acts, though no function of one variable explains it.
    pub fn acts_at(&self) -> Option<Site> {
        let origin = self.origin.as_ref().filter(|_| self.inadequate && self.nameless.is_none())?;
        // The motor's torque acts on the master: which of them it is, only what it depends on
        // tells.
        let best = self.generic.first().filter(|best| best.gain > 0.0);
        match origin.site() {
            Site::Master => Some(best.map_or(Site::Master, |best| best.site)),
            own => Some(own),
        }
    }

    /// Takes the last effect back, and fits what is left; what was said beside it goes too. `None`
    /// where that cannot be simulated.
    pub fn without_last(&mut self, machine: &Machine) -> Option<()> {
        let Some(step) = self.steps.pop() else { return Some(()) };
        let at = step.fitted.setting.placed.len().saturating_sub(1);
        self.effect_knobs = self.effect_knobs.iter().filter_map(|knob| knob.without(at)).collect();
        self.is_unnamed(Unnamed::default());
        if self.steps.is_empty() {
            self.knobs.clone_from(&self.base_knobs);
        }
        if let Some(last) = self.steps.last_mut() {
            let mut setting = step.fitted.setting;
            setting.placed.truncate(at);
            let knobs: Vec<Knob> = self.knobs.iter().chain(&self.effect_knobs).cloned().collect();
            last.fitted = View::of(machine, Role::Fit).fit(&setting, &knobs, AFTER_TAKING_BACK)?;
        }
        Some(())
    }
}

impl Found {
    fn is_unnamed(&mut self, Unnamed { tried, best, origin }: Unnamed) {
        (self.generic, self.nameless, self.origin) = (tried, best, origin);
    }

    /// What is left once an effect was taken back: whether the model is one of this machine at all,
    /// and what has no name.
    pub fn judge_anew(&mut self, machine: &Machine) {
        let (fit, select) = (View::of(machine, Role::Fit), View::of(machine, Role::Select));
        let above = above_floor(machine, &select.records, &self.last().setting);
        if above.is_none_or(|above| above.at_floor()) {
            return;
        }
        self.inadequate = above.is_some_and(|above| above.inadequate());
        let knobs: Vec<Knob> = self.knobs.iter().chain(&self.effect_knobs).cloned().collect();
        let (now, knobs) = match self.inadequate {
            true => (self.base.clone(), self.base_knobs.clone()),
            false => (self.last().clone(), knobs),
        };
        self.is_unnamed(functions((&fit, &select), (&now, &knobs), self.inadequate));
        if self.inadequate {
            self.given_up.extend(self.steps.drain(..).map(|step| (step.added.id, step.added.site)));
            self.knobs.clone_from(&self.base_knobs);
            self.effect_knobs.clear();
        }
    }
}

/// The whole search; which sign a torque had, where the sensor does not tell, is left in the
/// records. `None` where not even the declared model can be simulated along the records.
pub fn search(machine: &mut Machine) -> Option<Found> {
    let hands = folded(machine);
    if !hands.is_empty() {
        let idle = View::of(machine, Role::Fit).without(&hands);
        if !idle.records.is_empty() {
            let (base, _) = fit_base(&idle)?;
            unfold(machine, hands, &base.setting)?;
        }
    }
    let mut search = Search::begin(machine)?;
    // Where a model loses a record that the one before it followed, what was found before stands.
    while search.steps.len() < MOST_EFFECTS && search.rounds.len() < MOST_ROUNDS && search.add() {
        search.give_up_needless();
        search.exchange();
        if search.hold_against_others().is_none() {
            break;
        }
    }
    Some(search.conclude())
}

/// A search under way.
struct Search<'a> {
    fit: View<'a>,
    select: View<'a>,
    base: Fitted,
    base_knobs: Vec<Knob>,
    /// The model so far, and what its fit moved.
    now: Fitted,
    knobs: Vec<Knob>,
    steps: Vec<Step>,
    rounds: Vec<Vec<Judged>>,
    given_up: Vec<(&'static str, Site)>,
    /// What else did well in the first round, and in the last one.
    others: Vec<Other>,
    /// See there.
    latest: Vec<Other>,
}

impl<'a> Search<'a> {
    fn begin(machine: &'a Machine) -> Option<Self> {
        let (fit, select) = (View::of(machine, Role::Fit), View::of(machine, Role::Select));
        let (base, base_knobs) = fit_base(&fit)?;
        let (now, knobs) = (base.clone(), base_knobs.clone());
        let (steps, rounds, given_up) = (Vec::new(), Vec::new(), Vec::new());
        let (others, latest) = (Vec::new(), Vec::new());
        Some(Self {
            fit,
            select,
            base,
            base_knobs,
            now,
            knobs,
            steps,
            rounds,
            given_up,
            others,
            latest,
        })
    }
}

impl Search<'_> {
    const fn views(&self) -> (&View<'_>, &View<'_>) {
        (&self.fit, &self.select)
    }

    /// One round: the best candidate that passes comes in, and all is fitted again. Whether there
    /// was one.
    fn add(&mut self) -> bool {
        let (fit, select, now) = (&self.fit, &self.select, &self.now);
        let Some(before) = select.residuals(&now.setting) else { return false };
        let listed: Vec<Candidate> = candidates(&scale(fit, now))
            .into_iter()
            .filter(|candidate| {
                now.setting
                    .placed
                    .iter()
                    .all(|placed| (placed.id, placed.site) != (candidate.id, candidate.site))
            })
            .collect();
        let round =
            Round { fit, select, now, knobs: &self.knobs, before: &before, candidates: &listed };
        let mut tried = round.run();
        let held = |tried: &Tried| {
            now.setting.placed.is_empty()
                || !may_be_the_step(tried.judged.id)
                || holds(self.views(), now, &self.knobs, tried)
        };
        while let Some(at) =
            winner(&tried).filter(|winner| !held(winner)).map(|winner| winner.candidate)
        {
            if let Some(step) = tried.iter_mut().find(|tried| tried.candidate == at) {
                step.judged.accepted = false;
            }
        }
        self.rounds.push(tried.iter().map(|tried| tried.judged.clone()).collect());
        let Some(winner) = winner(&tried) else { return false };
        self.steps.push(Step {
            added: winner.judged.clone(),
            rivals: Vec::new(),
            fitted: winner.fitted.clone(),
        });
        let is_rival = |other: &&Tried| {
            other.candidate != winner.candidate && other.judged.gain >= A_RIVAL * winner.judged.gain
        };
        self.latest = tried.iter().filter(is_rival).filter_map(Other::of).collect();
        if self.rounds.len() == 1 {
            self.others.clone_from(&self.latest);
        }
        (self.now, self.knobs) = refit((fit, select), winner, &listed[winner.candidate]);
        true
    }

    /// Gives up what the newest effect made needless.
    fn give_up_needless(&mut self) {
        while let Some((at, fitted, left)) = needless(self.views(), &self.now, &self.knobs) {
            let step = self.steps.remove(at);
            self.given_up.push((step.added.id, step.added.site));
            (self.now, self.knobs) = (fitted, left);
        }
    }

    /// Puts another one in the place of an effect where that does clearly better beside the rest:
    /// until the floor is reached.
    fn exchange(&mut self) {
        let count = self.steps.len();
        for at in (0..count).filter(|_| count > 1) {
            if at_floor(self.fit.machine, &self.select.records, &self.now.setting) {
                return;
            }
            let others = if at + 1 == count { &self.latest } else { &self.others };
            let Some(found) = exchange(self.views(), &self.now, &self.knobs, at, others) else {
                continue;
            };
            let step = &mut self.steps[at];
            self.given_up.push((step.added.id, step.added.site));
            let gain = step.added.gain + found.beside.gain;
            step.added =
                Judged { id: found.beside.id, site: found.beside.site, gain, ..step.added };
            step.rivals.clear();
            (self.now, self.knobs) = (found.fitted, found.knobs);
        }
    }

    /// Tries the first round's others alone: one of them takes the place of all that is there where
    /// it does as well, and those that the records cannot tell from a single effect are its rivals.
    fn hold_against_others(&mut self) -> Option<()> {
        let alone = alone(self.views(), &self.now, &self.knobs, &self.others)?;
        let enough = if self.steps.len() > 1 { LEAST_GAIN } else { -BETTER };
        match &alone[..] {
            // One does as well as several, or better than the one that was best before all was
            // fitted again.
            [best, rest @ ..] if best.beside.gain < enough => {
                self.give_up_all();
                (self.now, self.knobs) = (best.fitted.clone(), best.knobs.clone());
                let added = self.beside_declared()?;
                let rivals = rivals(
                    (added.id, added.site),
                    &best.selected,
                    effect_count(&best.knobs),
                    rest.iter(),
                );
                self.steps.push(Step { added, rivals, fitted: self.now.clone() });
            }
            all => {
                if let [only] = &mut self.steps[..] {
                    let meant = (only.added.id, only.added.site);
                    let selected = self.select.residuals(&self.now.setting)?;
                    only.rivals = rivals(meant, &selected, effect_count(&self.knobs), all.iter());
                }
            }
        }
        if self.steps.len() == 1 && self.rounds.len() > 1 {
            // It may have come in beside another one.
            self.steps[0].added = self.beside_declared()?;
        }
        Some(())
    }

    /// Names beside each effect that has no rival the one that does the same elsewhere, where a
    /// model with that explains nearly as much: what it explains less is how it is computed.
    fn name_twins(&mut self) -> Option<()> {
        let (without, with) =
            (self.select.residuals(&self.base.setting)?, self.select.residuals(&self.now.setting)?);
        for at in 0..self.steps.len() {
            let id = self.steps[at].added.id;
            let Some(site) = twin((id, self.steps[at].added.site)) else { continue };
            let there =
                self.now.setting.placed.iter().any(|placed| (placed.id, placed.site) == (id, site));
            if there || !self.steps[at].rivals.is_empty() {
                continue;
            }
            let mut setting = self.now.setting.clone();
            setting.placed[at].site = site;
            let Some(fitted) = self.fit.fit(&setting, &self.knobs, AS_A_TWIN) else { continue };
            let there = self.select.residuals(&fitted.setting)?;
            let [meant, twin] =
                [&with, &there].map(|after| judge((id, site), &without, after).gain);
            if twin >= AS_MUCH * meant {
                self.steps[at].rivals.push((id, site));
            }
        }
        Some(())
    }

    /// Says of an encoder that is out of centre whether it may be the other one: small movements do
    /// not tell. The one that explains more is meant.
    fn name_other_encoder(&mut self) -> Option<()> {
        let mut with = self.select.residuals(&self.now.setting)?;
        for at in 0..self.steps.len() {
            let (id, site) = (self.steps[at].added.id, self.steps[at].added.site);
            let mut setting = self.now.setting.clone();
            let Some(encoder) =
                setting.placed[at].values.iter_mut().find(|(name, _)| *name == WHICH_ENCODER)
            else {
                continue;
            };
            encoder.1 = 1.0 - encoder.1;
            let Some(other) = self.fit.fit(&setting, &self.knobs, AS_ANOTHER_ENCODER) else {
                continue;
            };
            let Some(there) = self.select.residuals(&other.setting) else { continue };
            let mut beside = judge((id, site), &there, &with).gain;
            if beside < -BETTER {
                (self.now, with, beside) = (other, there, -beside);
            }
            if beside < AS_GOOD && self.steps[at].rivals.is_empty() {
                self.steps[at].rivals.push((id, site));
            }
        }
        Some(())
    }

    fn give_up_all(&mut self) {
        self.given_up.extend(self.steps.drain(..).map(|step| (step.added.id, step.added.site)));
    }

    /// How a model with a single effect does beside the declared one.
    fn beside_declared(&self) -> Option<Judged> {
        let only = self.now.setting.placed.first()?;
        let [before, after] =
            [&self.base, &self.now].map(|fitted| self.select.residuals(&fitted.setting));
        Some(judge((only.id, only.site), &before?, &after?))
    }

    /// Whether there is a name to be had, and what is left.
    fn conclude(mut self) -> Found {
        self.name_twins();
        self.name_other_encoder();
        if let Some(step) = self.steps.last_mut() {
            step.fitted = self.now.clone();
        }
        let above = above_floor(self.fit.machine, &self.select.records, &self.now.setting);
        let at_floor = above.is_some_and(|above| above.at_floor());
        let mut inadequate = above.is_some_and(|above| above.inadequate());
        let declared = (&self.base, &self.base_knobs[..]);
        // Names that leave so much are wrong, and would bend a function.
        let mut unnamed = inadequate.then(|| functions(self.views(), declared, true));
        // A name must hold against functions that have none: where one of them alone explains more,
        // the name is wrong.
        if !inadequate && !at_floor && !self.steps.is_empty() {
            let others = functions(self.views(), declared, false);
            if let Some(best) = others.best.as_ref().filter(|best| best.judged.accepted) {
                let [named, nameless] =
                    [&self.now, &best.fitted].map(|fitted| self.select.residuals(&fitted.setting));
                let names = self.steps.iter().map(|step| (step.added.id, step.added.site));
                let by = names
                    .into_iter()
                    .find(|(id, _)| has_two_ways(id))
                    .unwrap_or((best.judged.id, best.judged.site));
                let more =
                    named.zip(nameless).map(|(named, nameless)| judge(by, &named, &nameless).gain);
                if more.is_some_and(|more| more >= LEAST_GAIN) {
                    (inadequate, unnamed) = (true, Some(others));
                }
            }
        }
        let Unnamed { tried: generic, best: nameless, origin } = match unnamed {
            Some(unnamed) => unnamed,
            None if at_floor => Unnamed::default(),
            None => functions(self.views(), (&self.now, &self.knobs), false),
        };
        if inadequate {
            self.give_up_all();
            self.knobs.clone_from(&self.base_knobs);
        }
        let (knobs, effect_knobs) = self.knobs.into_iter().partition(Knob::is_base);
        let Self { base, base_knobs, steps, rounds, given_up, .. } = self;
        Found {
            base,
            base_knobs,
            knobs,
            steps,
            rounds,
            given_up,
            generic,
            nameless,
            origin,
            effect_knobs,
            inadequate,
        }
    }
}
