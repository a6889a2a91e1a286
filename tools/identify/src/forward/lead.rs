//! A listed effect in the place of a function without a name.
//!
//! A fit of an effect can go astray where one of a function does not: beside declared friction that may take its part, friction more of the
//! same kind gains nothing near where the search begins. The function, which bends wherever it likes, has led the declared
//! parameters to where they belong; from there the effects that act at its place are looked at once more.

use plant::effects::Site;

use super::catalogue::{Candidate, candidates};
use super::fit::{Fitted, View};
use super::judge::{Judged, at_floor, judge};
use super::knob::{Knob, knobs_of};
use super::machine::Setting;
use super::refit::refit;
use super::round::Tried;
use super::screen::{Projection, scale};
use super::unnamed::Nameless;

/// How many are fitted of those that look best from there, and the rounds of each fit.
const FITTED: usize = 4;
/// See there.
const ROUNDS: usize = 3;
/// What a function may explain more than the effect in its place: it has twenty numbers more to do it with.
const AS_GOOD: f64 = 0.1;

/// A model with the effect.
pub struct Led {
    /// How it does beside the declared model.
    pub judged: Judged,
    /// The model.
    pub fitted: Fitted,
    /// What its fit moved.
    pub knobs: Vec<Knob>,
}

/// Whether two sites act on the same inertia.
fn together(one: Site, other: Site) -> bool {
    let of_master = |site| matches!(site, Site::Drive | Site::Master);
    one == other || of_master(one) && of_master(other)
}

/// The listed effect that explains what a function does, found from where the function has led: it must pass beside the declared model, reach what
/// repeats differ by, and leave hardly more than the function. `None` where none does.
pub fn led((fit, select): (&View<'_>, &View<'_>), base: &Fitted, function: &Nameless) -> Option<Led> {
    let mut there: Setting = function.fitted.setting.clone();
    (there.tables, there.placed) = (Vec::new(), Vec::new());
    let knobs: Vec<Knob> = function.knobs.iter().filter(|knob| knob.is_base()).cloned().collect();
    let from = fit.evaluate(fit.inside(there, &knobs))?;
    let listed: Vec<Candidate> = candidates(&scale(fit, &from))
        .into_iter()
        .filter(|candidate| together(candidate.site, function.table.site))
        .collect();
    let before = select.residuals(&base.setting)?;
    let by_function = select.residuals(&function.fitted.setting)?;
    let ranked = Projection::new(fit, &from, &knobs).rank(fit, &from, &listed);
    let tried = ranked.iter().take(FITTED).filter_map(|scored| {
        let mut start = from.setting.clone();
        start.placed.push(scored.placed.clone());
        let of = &listed[scored.candidate];
        let free: Vec<Knob> = knobs.iter().cloned().chain(knobs_of(of, 0)).collect();
        let fitted = fit.fit(&start, &free, ROUNDS)?;
        let judged = judge((of.id, of.site), &before, &select.residuals(&fitted.setting)?);
        Some(Tried { candidate: scored.candidate, knobs: free, fitted, judged })
    });
    let best = tried.min_by(|a, b| a.fitted.objective.total_cmp(&b.fitted.objective))?;
    let of = &listed[best.candidate];
    let (fitted, knobs) = refit((fit, select), &best, of);
    let selected = select.residuals(&fitted.setting)?;
    let judged = judge((of.id, of.site), &before, &selected);
    let more = judge((of.id, of.site), &selected, &by_function).gain;
    let holds = judged.accepted && more <= AS_GOOD && at_floor(fit.machine, &select.records, &fitted.setting);
    holds.then_some(Led { judged, fitted, knobs })
}
