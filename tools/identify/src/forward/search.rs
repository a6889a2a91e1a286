//! From records to what the model lacks, round by round: fit, screen, refit the best, judge them on records that took no part.

use nalgebra::DMatrix;
use plant::effects::Site;

use super::catalogue::{Candidate, candidates};
use super::fit::{Fitted, View};
use super::folded::{folded, unfold};
use super::judge::{Judged, LEAST_GAIN, above_floor, at_floor, judge};
use super::knob::Knob;
use super::machine::{Machine, SMOOTHING, SMOOTHING_STARTS, Setting};
use super::prune::{Other, alone, effect_count, needless, rivals};
use super::round::{Round, Tried, winner};
use super::screen::scale;
use super::unnamed::{Nameless, functions};
use crate::inverse::split::Role;

/// A gain beyond that of the one that was added, by which another takes its place.
const BETTER: f64 = 0.03;
/// Most effects that are added.
const MOST_EFFECTS: usize = 3;
/// Most rounds, with those whose effect was given up again.
const MOST_ROUNDS: usize = 5;
/// Share of the best one's gain from which another of the first round may stand for several effects, or in the place of the best.
const A_RIVAL: f64 = 0.25;
/// Times that a model with an effect is fitted afresh as long as it ends above what repeats differ by, and what of its objective, for every
/// row, it must gain to be worth another.
const REFITS: usize = 3;
/// See there.
const LEAST_REFIT: f64 = 0.01;
/// A declared parameter that changes the residual by less than this share over its whole tolerance is not seen.
const SEEN: f64 = 0.002;
/// Most declared parameters that a fit moves.
const MOST_PARAMETERS: usize = 30;

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
    /// What of it the fits moved.
    pub knobs: Vec<Knob>,
    /// Effects in the order in which they were added.
    pub steps: Vec<Step>,
    /// All that were fitted in each round, best first; in the last round none passed, unless it is the third.
    pub rounds: Vec<Vec<Judged>>,
    /// Effects that were added and given up again when a later one explained what they had.
    pub given_up: Vec<(&'static str, Site)>,
    /// Functions without a name after that.
    pub generic: Vec<Judged>,
    /// The best of them, where it passes.
    pub nameless: Option<Nameless>,
    /// Knobs of the effects that were added.
    pub effect_knobs: Vec<Knob>,
    /// Whether so much is left beside what repeats differ by that no name is to be had.
    pub inadequate: bool,
}

impl Found {
    /// The model with all effects; with a function without a name where there is no name to be had.
    pub fn last(&self) -> &Fitted {
        let unnamed = self.nameless.as_ref().filter(|_| self.inadequate).map(|nameless| &nameless.fitted);
        self.steps.last().map(|step| &step.fitted).or(unnamed).unwrap_or(&self.base)
    }
}

/// The declared parameters that records show, the clearest first: each by what it changes beside those before it.
fn seen(view: &View<'_>, fitted: &Fitted) -> Option<Vec<Knob>> {
    let all: Vec<Knob> = (0..view.machine.base.len()).map(Knob::Base).collect();
    let weights = View::weights(&fitted.residuals);
    let mut slopes: DMatrix<f64> = view.slopes(fitted, &all, &weights)?;
    let least = SEEN * (slopes.nrows() as f64).sqrt();
    let mut chosen = Vec::new();
    while chosen.len() < MOST_PARAMETERS {
        let norms: Vec<f64> = slopes.column_iter().map(|column| column.norm()).collect();
        let Some((index, norm)) = norms.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if norm < least || norm.is_nan() {
            break;
        }
        let direction = slopes.column(index) / norm;
        let along = slopes.transpose() * &direction;
        slopes -= direction * along.transpose();
        slopes.column_mut(index).fill(0.0);
        chosen.push(all[index].clone());
    }
    Some(chosen)
}

/// The declared model, fitted within its tolerances; and what of it they show.
fn fit_base(fit: &View<'_>) -> Option<(Fitted, Vec<Knob>)> {
    let machine = fit.machine;
    let smoothing = machine.base.iter().position(|parameter| parameter.name == SMOOTHING);
    let starts = SMOOTHING_STARTS.iter().filter_map(|speed| {
        let mut start = machine.start();
        if let Some(index) = smoothing {
            start.base[index] = *speed;
        }
        let fitted = fit.evaluate(start)?;
        let knobs = seen(fit, &fitted)?;
        fit.fit(&fitted.setting, &knobs, 3)
    });
    let best = starts.min_by(|a, b| a.objective.total_cmp(&b.objective))?;
    // What is left is smaller now, and shows more.
    let knobs = seen(fit, &best)?;
    let fitted = fit.fit(&best.setting, &knobs, 6)?;
    Some((fitted, knobs))
}

/// All of a model fitted again once an effect is in it, by what the records show now that less is left; and the knobs of that.
fn refit((fit, select): (&View<'_>, &View<'_>), winner: &Tried, of: &Candidate) -> Option<(Fitted, Vec<Knob>)> {
    let machine = fit.machine;
    let own: Vec<Knob> = winner.knobs.iter().filter(|knob| !knob.is_base()).cloned().collect();
    let shown = |fitted: &Fitted| Some([seen(fit, fitted)?, own.clone()].concat());
    let mut knobs = shown(&winner.fitted)?;
    let mut now = fit.fit(&winner.fitted.setting, &knobs, 6)?;
    for pass in 0..REFITS {
        if at_floor(machine, &select.records, &now.setting)? {
            break;
        }
        // What is left is smaller now, and shows more.
        knobs = shown(&now)?;
        // A fit that has gone astray looks exactly like a missing effect: from the declared values it may find its way back.
        let fresh = Setting { base: machine.start().base, ..now.setting.clone() };
        let before = now.objective;
        let mut starts = vec![now.setting.clone(), fresh.clone()];
        if of.sizes > 1 && pass == 0 {
            // Several numbers that grow together have many ways to go wrong.
            starts.extend([&fresh, &now.setting].into_iter().flat_map(|from| {
                of.starts.iter().filter_map(|start| {
                    let mut setting = from.clone();
                    setting.placed.last_mut()?.values.clone_from(&start.placed.values);
                    Some(setting)
                })
            }));
        }
        let again = starts.iter().map(|start| fit.fit(start, &knobs, 4));
        now = again.flatten().min_by(|a, b| a.objective.total_cmp(&b.objective))?;
        if before - now.objective < LEAST_REFIT * now.rows() as f64 {
            break;
        }
    }
    Some((now, knobs))
}

/// The whole search; which sign a torque had, where the sensor does not tell, is left in the records. `None` where not even the declared model can be simulated along the records.
pub fn search(machine: &mut Machine) -> Option<Found> {
    let hands = folded(machine);
    if !hands.is_empty() {
        let idle = View::of(machine, Role::Fit).without(&hands);
        if !idle.records.is_empty() {
            let (base, _) = fit_base(&idle)?;
            unfold(machine, hands, &base.setting)?;
        }
    }
    let machine = &*machine;
    let (fit, select) = (View::of(machine, Role::Fit), View::of(machine, Role::Select));
    let (base, base_knobs) = fit_base(&fit)?;
    let (mut now, mut knobs) = (base.clone(), base_knobs.clone());
    let (mut steps, mut rounds, mut given_up) = (Vec::<Step>::new(), Vec::new(), Vec::new());
    let mut others = Vec::new();
    while steps.len() < MOST_EFFECTS && rounds.len() < MOST_ROUNDS {
        let before = select.residuals(&now.setting)?;
        let listed: Vec<Candidate> = candidates(&scale(&fit, &now))
            .into_iter()
            .filter(|candidate| {
                now.setting.placed.iter().all(|placed| (placed.id, placed.site) != (candidate.id, candidate.site))
            })
            .collect();
        let round =
            Round { fit: &fit, select: &select, now: &now, knobs: &knobs, before: &before, candidates: &listed };
        let tried = round.run()?;
        rounds.push(tried.iter().map(|tried| tried.judged.clone()).collect());
        let Some(winner) = winner(&tried) else { break };
        steps.push(Step { added: winner.judged.clone(), rivals: Vec::new(), fitted: winner.fitted.clone() });
        if rounds.len() == 1 {
            others = tried
                .iter()
                .filter(|other| {
                    other.candidate != winner.candidate && other.judged.gain >= A_RIVAL * winner.judged.gain
                })
                .filter_map(Other::of)
                .collect();
        }
        (now, knobs) = refit((&fit, &select), winner, &listed[winner.candidate])?;
        let several = steps.len() > 1;
        while let Some((at, fitted, left)) = needless((&fit, &select), &now, &knobs) {
            let step = steps.remove(at);
            given_up.push((step.added.id, step.added.site));
            (now, knobs) = (fitted, left);
        }
        let alone = alone((&fit, &select), &now, &knobs, &others)?;
        let enough = if steps.len() > 1 { LEAST_GAIN } else { -BETTER };
        match &alone[..] {
            // One does as well as several, or better than the one that was best before all was fitted again.
            [best, rest @ ..] if best.beside.gain < enough => {
                given_up.extend(steps.drain(..).map(|step| (step.added.id, step.added.site)));
                (now, knobs) = (best.fitted.clone(), best.knobs.clone());
                let added = judge_against(&select, &base, &now)?;
                let meant = (added.id, added.site);
                let rivals = rivals(meant, &best.selected, effect_count(&best.knobs), rest.iter());
                steps.push(Step { added, rivals, fitted: now.clone() });
            }
            all => {
                if let [only] = &mut steps[..] {
                    let meant = (only.added.id, only.added.site);
                    only.rivals = rivals(meant, &select.residuals(&now.setting)?, effect_count(&knobs), all.iter());
                }
            }
        }
        if let Some(step) = steps.last_mut() {
            step.fitted = now.clone();
        }
        if let ([only], true) = (&mut steps[..], several) {
            only.added = judge_against(&select, &base, &now)?;
        }
    }
    let above = above_floor(machine, &select.records, &now.setting)?;
    let views = (&fit, &select);
    let at_floor = above.is_some_and(|above| above.at_floor());
    let mut inadequate = above.is_some_and(|above| above.inadequate());
    // Names that leave so much are wrong, and would bend a function.
    let mut unnamed = if inadequate { Some(functions(views, (&base, &base_knobs), true)?) } else { None };
    // A name must hold against functions that have none: where one of them alone explains more, the name is wrong.
    if !inadequate && !at_floor && !steps.is_empty() {
        let (generic, best) = functions(views, (&base, &base_knobs), false)?;
        if let Some(best) = best.filter(|best| best.judged.accepted) {
            let with_names = select.residuals(&now.setting)?;
            let of = (best.judged.id, best.judged.site);
            if judge(of, &with_names, &select.residuals(&best.fitted.setting)?).gain >= LEAST_GAIN {
                (inadequate, unnamed) = (true, Some((generic, Some(best))));
            }
        }
    }
    let (generic, nameless) = match unnamed {
        Some(unnamed) => unnamed,
        None if at_floor => (Vec::new(), None),
        None => functions(views, (&now, &knobs), false)?,
    };
    if inadequate {
        given_up.extend(steps.drain(..).map(|step| (step.added.id, step.added.site)));
        knobs = base_knobs;
    }
    let (knobs, effect_knobs) = knobs.into_iter().partition(Knob::is_base);
    Some(Found { base, knobs, steps, rounds, given_up, generic, nameless, effect_knobs, inadequate })
}

/// How a model with a single effect does beside the declared one.
fn judge_against(select: &View<'_>, base: &Fitted, now: &Fitted) -> Option<Judged> {
    let only = now.setting.placed.first()?;
    Some(judge((only.id, only.site), &select.residuals(&base.setting)?, &select.residuals(&now.setting)?))
}
