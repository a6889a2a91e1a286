//! One round of the search: the best candidates of the screening, each fitted beside what there is,
//! first briefly, then as far as it is worth it.

use plant::effects::Site;
use rayon::prelude::*;

use super::catalogue::{AllStarts, Candidate, Way};
use super::fit::{Fitted, View};
use super::judge::{Judged, LEAST_FIRST, at_floor, judge_beside};
use super::knob::{AT_EDGE, Knob, knobs_of};
use super::machine::{Machine, Residual, Setting};
use super::origin::origin;
use super::screen::{Projection, Scored};

/// Gains so near to the best are as good: the fewest parameters win.
const AS_GOOD: f64 = 0.97;
/// Candidates that are fitted after the screening, and those of them that are fitted to the end.
const REFITTED: usize = 12;
const FINISHED: usize = 3;
/// Those of them that are fitted afresh as well, in the first round.
const AFRESH: usize = 3;
/// Candidates that are fitted because of how they look from the declared values.
const FROM_DECLARED: usize = 5;
/// Rounds of a fit that show which of several starts leads anywhere.
const TO_SHOW: usize = 4;
/// Rounds of a fit before that, from each start beside the declared values.
const TO_BEGIN: usize = 2;
/// A start whose brief fit stands so far behind the best that was tried, in the logarithm of the
/// error, goes no further.
const OUT_OF_REACH: f64 = 0.3;
/// A candidate whose gain is less than this share of the best one's is not fitted any closer.
const WITHIN_REACH: f64 = 0.6;
/// A gain so small does not pass whatever a closer fit gives.
const HOPELESS: f64 = 0.5 * LEAST_FIRST;
/// Steps of a candidate before it is finished or dropped.
const QUICK_STEPS: usize = 2;
/// Rounds of a fit that is to end where it ends.
const TO_THE_END: usize = 3;

/// One candidate, fitted.
pub struct Tried {
    /// Index of the candidate.
    pub candidate: usize,
    /// What the fit moved, the candidate's own knobs last.
    pub knobs: Vec<Knob>,
    /// The model with it.
    pub fitted: Fitted,
    /// How it did.
    pub judged: Judged,
}

/// Where a round begins.
pub struct Round<'a> {
    /// Fitting records.
    pub fit: &'a View<'a>,
    /// Selecting records.
    pub select: &'a View<'a>,
    /// The model so far.
    pub now: &'a Fitted,
    /// What its fit moved.
    pub knobs: &'a [Knob],
    /// What it leaves of the selecting records.
    pub before: &'a [Residual],
    /// What may be added.
    pub candidates: &'a [Candidate],
}

impl Round<'_> {
    /// All candidates that were fitted, best first.
    pub fn run(&self) -> Vec<Tried> {
        let projection = Projection::new(self.fit, self.now, self.knobs);
        let scored = projection.rank(self.fit, self.now, self.candidates);
        let mut tried: Vec<Tried> = scored
            .iter()
            .take(REFITTED)
            .filter_map(|scored| self.quick(scored, &projection))
            .collect();
        // Those that fit best and those that hold best go on.
        let mut chosen = foremost(&tried);
        for index in &chosen {
            let start = tried[*index].fitted.setting.clone();
            self.improve(&mut tried, *index, &start, 1);
        }
        let nearest = tried.iter().min_by(|a, b| a.fitted.objective.total_cmp(&b.fitted.objective));
        let Some(nearest) = nearest else { return tried };
        if !at_floor(self.fit.machine, &self.select.records, &nearest.fitted.setting) {
            self.look_from_declared(&mut tried, &chosen);
            self.look_from_all_starts(&mut tried);
            chosen = foremost(&tried);
        }
        // Those that are far behind by now do not come first whatever a closer fit gives.
        let most = chosen.iter().map(|index| tried[*index].judged.gain).fold(HOPELESS, f64::max);
        chosen.retain(|index| tried[*index].judged.gain >= WITHIN_REACH * most);
        for index in chosen {
            let start = tried[index].fitted.setting.clone();
            self.improve(&mut tried, index, &start, TO_THE_END);
        }
        self.elsewhere(&mut tried);
        tried.sort_by(|a, b| b.judged.gain.total_cmp(&a.judged.gain));
        tried
    }

    /// What is moved beside a candidate that stands last in a setting.
    fn free(&self, candidate: usize, setting: &Setting) -> Vec<Knob> {
        let own = knobs_of(&self.candidates[candidate], setting.placed.len().saturating_sub(1));
        self.knobs.iter().cloned().chain(own).collect()
    }

    fn judged(&self, candidate: usize, knobs: Vec<Knob>, fitted: Fitted) -> Option<Tried> {
        let selected = self.select.residuals(&fitted.setting)?;
        let of = &self.candidates[candidate];
        let beside = self.now.setting.placed.len();
        let mut judged = judge_beside(beside, (of.id, of.site), self.before, &selected);
        if beside > 0 {
            // A shape at the low end of its range has gone over into another law: beside an effect
            // it takes up what that leaves.
            let own = knobs_of(of, fitted.setting.placed.len().saturating_sub(1));
            let gone = |knob: &Knob| {
                matches!(knob, Knob::Effect { way: Way::Logarithmic, .. })
                    && knob.place(self.fit.machine, &fitted.setting) < -AT_EDGE
            };
            judged.accepted &= !own.iter().any(gone);
        }
        Some(Tried { candidate, knobs, fitted, judged })
    }

    fn fitted(&self, candidate: usize, start: &Setting, rounds: usize) -> Option<Tried> {
        let free = self.free(candidate, start);
        let fitted = self.fit.fit(start, &free, rounds)?;
        self.judged(candidate, free, fitted)
    }

    /// A step or two with the slopes that are known already.
    fn quick(&self, scored: &Scored, projection: &Projection) -> Option<Tried> {
        let start = self.now.setting.with(&scored.placed);
        let free = self.free(scored.candidate, &start);
        let own = &free[self.knobs.len()..];
        let mut fitted = self.fit.evaluate(self.fit.inside(start, &free))?;
        for _ in 0..QUICK_STEPS {
            let of_effect = self.fit.slopes(&fitted, own, &projection.weights);
            let mut slopes = projection.slopes.clone().resize_horizontally(free.len(), 0.0);
            slopes.columns_mut(self.knobs.len(), of_effect.ncols()).copy_from(&of_effect);
            match self.fit.step(&fitted, &free, &slopes, &projection.weights) {
                Some(better) => fitted = better,
                None => break,
            }
        }
        self.judged(scored.candidate, free, fitted)
    }

    fn improve(&self, tried: &mut Vec<Tried>, index: usize, start: &Setting, rounds: usize) {
        let found = self.fitted(tried[index].candidate, start, rounds);
        better_of(tried, found);
    }

    /// A fit without the effect may have gone astray, and bends declared parameters until little of
    /// it is left to be seen: from the declared values candidates are fitted and looked at as well.
    fn look_from_declared(&self, tried: &mut Vec<Tried>, chosen: &[usize]) {
        let machine = self.fit.machine;
        if self.now.setting.placed.is_empty() {
            for index in chosen.iter().take(AFRESH) {
                let fresh =
                    Setting { base: machine.start().base, ..tried[*index].fitted.setting.clone() };
                self.improve(tried, *index, &fresh, TO_THE_END);
            }
        }
        // Beside an effect the declared values themselves may lose a record.
        let start =
            self.fit.evaluate(self.fit.inside(declared(machine, &self.now.setting), self.knobs));
        let Some(start) = start else { return };
        let ranked =
            Projection::new(self.fit, &start, self.knobs).rank(self.fit, &start, self.candidates);
        for scored in ranked.iter().take(FROM_DECLARED) {
            let with = start.setting.with(&scored.placed);
            better_of(tried, self.fitted(scored.candidate, &with, QUICK_STEPS));
        }
    }

    /// Fits that do not follow from how a candidate looks at its start: from all starts beside the
    /// parameters as they are. Where what is missing enters at one place alone, from all of them
    /// beside the declared values too, and nowhere else.
    fn look_from_all_starts(&self, tried: &mut Vec<Tried>) {
        let origin = origin((self.fit, self.select), &self.now.setting)
            .filter(|origin| origin.site() != Site::Line);
        let started = |from: &Setting, of: &Candidate| -> Vec<Setting> {
            of.starts.iter().map(|start| from.with(&start.placed)).collect()
        };
        let declared = declared(self.fit.machine, &self.now.setting);
        for (candidate, of) in self.candidates.iter().enumerate() {
            let looked = match &origin {
                Some(origin) => of.from_all_starts.is_some() && origin.may_be_at(of.site),
                None => of.from_all_starts == Some(AllStarts::Always),
            };
            if !looked {
                continue;
            }
            let begun = |from: &Setting, rounds: usize| match started(from, of) {
                starts if starts.is_empty() => Vec::new(),
                starts => self.fit.leading(&starts, &self.free(candidate, &starts[0]), rounds),
            };
            let mut leading = begun(&self.now.setting, 1);
            if origin.is_some() {
                leading.extend(begun(&declared, TO_BEGIN));
            }
            let nearest =
                tried.iter().map(|tried| tried.fitted.objective).fold(f64::INFINITY, f64::min);
            let reach = nearest + OUT_OF_REACH * self.now.rows() as f64;
            leading.retain(|begun| begun.objective <= reach);
            let found: Vec<Tried> = leading
                .par_iter()
                .filter_map(|begun| self.fitted(candidate, &begun.setting, TO_SHOW))
                .collect();
            for found in found {
                better_of(tried, Some(found));
            }
        }
    }

    /// One candidate in the place of the last effect of a setting, from all its starts.
    fn instead(&self, tried: &mut Vec<Tried>, setting: &Setting, which: (&str, Site)) {
        let Some(candidate) = self.candidates.iter().position(|of| (of.id, of.site) == which)
        else {
            return;
        };
        for start in &self.candidates[candidate].starts {
            let mut with = setting.clone();
            if let Some(placed) = with.placed.last_mut() {
                *placed = start.placed.clone();
            }
            better_of(tried, self.fitted(candidate, &with, TO_SHOW));
        }
    }

    /// What the best has found may act at another site, or be the simpler one that it becomes at
    /// the end of its range.
    fn elsewhere(&self, tried: &mut Vec<Tried>) {
        let best = tried.iter().max_by(|a, b| a.judged.gain.total_cmp(&b.judged.gain));
        let Some(best) = best.filter(|best| best.judged.accepted) else { return };
        let (id, from, setting) = (best.judged.id, best.candidate, best.fitted.setting.clone());
        let own = knobs_of(&self.candidates[from], setting.placed.len().saturating_sub(1));
        let for_ever = |knob: &Knob| {
            matches!(knob, Knob::Effect { name: "time_constant_s", .. })
                && knob.place(self.fit.machine, &setting) > AT_EDGE
        };
        if id == "thermal_drift" && own.iter().any(for_ever) {
            self.instead(tried, &setting, ("coulomb_friction", self.candidates[from].site));
        }
        for (candidate, of) in self.candidates.iter().enumerate() {
            if of.id != id || candidate == from {
                continue;
            }
            let mut moved = setting.clone();
            if let Some(placed) = moved.placed.last_mut() {
                placed.site = of.site;
            }
            better_of(tried, self.fitted(candidate, &moved, TO_THE_END));
        }
    }
}

/// Those that fit best and those that hold best.
fn foremost(tried: &[Tried]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..tried.len()).collect();
    order.sort_by(|a, b| tried[*a].fitted.objective.total_cmp(&tried[*b].fitted.objective));
    let mut chosen: Vec<usize> = order.iter().copied().take(FINISHED).collect();
    order.sort_by(|a, b| tried[*b].judged.gain.total_cmp(&tried[*a].judged.gain));
    let holders: Vec<usize> =
        order.into_iter().take(2).filter(|index| !chosen.contains(index)).collect();
    chosen.extend(holders);
    chosen
}

/// Takes in a candidate, or keeps the better fit of the two where it is there already.
fn better_of(tried: &mut Vec<Tried>, found: Option<Tried>) {
    let Some(found) = found else { return };
    match tried.iter_mut().find(|known| known.candidate == found.candidate) {
        Some(known) if known.fitted.objective <= found.fitted.objective => {}
        Some(known) => *known = found,
        None => tried.push(found),
    }
}

/// A setting with all that is declared at its declared value; what is not stays as it was fitted.
fn declared(machine: &Machine, now: &Setting) -> Setting {
    let base = machine
        .base
        .iter()
        .zip(&now.base)
        .map(|(parameter, fitted)| parameter.declared.unwrap_or(*fitted));
    Setting { base: base.collect(), ..now.clone() }
}

/// The one that is added, of those that passed: of the best, the one with the fewest parameters.
pub fn winner(tried: &[Tried]) -> Option<&Tried> {
    let passed = || tried.iter().filter(|tried| tried.judged.accepted);
    let most = passed().map(|tried| tried.judged.gain).max_by(f64::total_cmp)?;
    passed()
        .filter(|tried| tried.judged.gain >= AS_GOOD * most)
        .min_by_key(|tried| tried.knobs.len())
}
