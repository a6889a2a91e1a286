//! Whether what an effect explains is still missing when the simulation takes finer steps.
//!
//! In a loop that swings from one end of the volts to the other, a hundred reversals a second, a
//! step of 2 ms rounds friction at rest visibly, and a travel before sliding is a good likeness of
//! that. With finer steps it has nothing left to explain.

use super::fit::{Fitted, View};
use super::judge::{judge_beside, least_beside};
use super::knob::Knob;
use super::machine::Machine;
use super::round::Tried;

/// Steps in the place of one.
const FINER: u32 = 4;
/// Share of its gain that an effect must keep.
const STAYS: f64 = 0.6;
/// Rounds of the fits with finer steps, with the effect and without it.
const WITH: usize = 3;
/// See there.
const WITHOUT: usize = 4;

/// Whether an effect that is to be added may be the step of the simulation.
pub fn may_be_the_step(id: &str) -> bool {
    id == "presliding_hysteresis"
}

/// Whether an effect explains with finer steps most of what it does with those of the search. An
/// effect with which, or without which, they lose a record keeps its place: nothing is known
/// against it.
pub fn holds(
    (fit, select): (&View<'_>, &View<'_>),
    now: &Fitted,
    knobs: &[Knob],
    added: &Tried,
) -> bool {
    let machine = Machine { steps: FINER * fit.machine.steps, ..fit.machine.clone() };
    let [fit, select] =
        [fit, select].map(|view| View { machine: &machine, records: view.records.clone() });
    let left = |setting, knobs, rounds| select.residuals(&fit.fit(setting, knobs, rounds)?.setting);
    let with = left(&added.fitted.setting, &added.knobs, WITH);
    let without = left(&now.setting, knobs, WITHOUT);
    let Some((with, without)) = with.zip(without) else { return true };
    let beside = now.setting.placed.len();
    let gain = judge_beside(beside, (added.judged.id, added.judged.site), &without, &with).gain;
    gain >= least_beside(beside).max(STAYS * added.judged.gain)
}
