//! Fits of the whole model: the declared one at first, and again once an effect is in it.

use nalgebra::DMatrix;

use super::catalogue::Candidate;
use super::fit::{Fitted, View};
use super::judge::above_floor;
use super::knob::Knob;
use super::machine::{SMOOTHING, SMOOTHING_STARTS, Setting};
use super::round::Tried;

/// Times that a model with an effect is fitted afresh as long as it ends above what repeats differ
/// by, and what of its objective, for every row, it must gain to be worth another.
const REFITS: usize = 3;
/// See there.
const LEAST_REFIT: f64 = 0.01;
/// A declared parameter that changes the residual by less than this share over its whole tolerance
/// is not seen.
pub(super) const SEEN: f64 = 0.002;
/// Most declared parameters that a fit moves.
const MOST_PARAMETERS: usize = 30;

/// The declared parameters that records show, the clearest first: each by what it changes beside
/// those before it.
fn seen(view: &View<'_>, fitted: &Fitted) -> Vec<Knob> {
    let all: Vec<Knob> = (0..view.machine.base.len()).map(Knob::Base).collect();
    let weights = View::weights(&fitted.residuals);
    let mut slopes: DMatrix<f64> = view.slopes(fitted, &all, &weights);
    let least = SEEN * (slopes.nrows() as f64).sqrt();
    let mut chosen = Vec::new();
    while chosen.len() < MOST_PARAMETERS {
        let norms: Vec<f64> = slopes.column_iter().map(|column| column.norm()).collect();
        let Some((index, norm)) =
            norms.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
        else {
            break;
        };
        if norm < least || norm.is_nan() {
            break;
        }
        let direction = slopes.column(index) / norm;
        let along = slopes.transpose() * &direction;
        slopes -= direction * along.transpose();
        slopes.column_mut(index).fill(0.0);
        chosen.push(all[index].clone());
    }
    chosen
}

/// The declared model, fitted within its tolerances; and what of it they show.
pub fn fit_base(fit: &View<'_>) -> Option<(Fitted, Vec<Knob>)> {
    let machine = fit.machine;
    let smoothing = machine.base.iter().position(|parameter| parameter.name == SMOOTHING);
    let starts = SMOOTHING_STARTS.iter().filter_map(|speed| {
        let mut start = machine.start();
        if let Some(index) = smoothing {
            start.base[index] = *speed;
        }
        let fitted = fit.evaluate(start)?;
        let knobs = seen(fit, &fitted);
        fit.fit(&fitted.setting, &knobs, 3)
    });
    let best = starts.min_by(|a, b| a.objective.total_cmp(&b.objective))?;
    // What is left is smaller now, and shows more.
    let knobs = seen(fit, &best);
    let fitted = fit.fit(&best.setting, &knobs, 6)?;
    Some((fitted, knobs))
}

/// All of a model fitted again once an effect is in it, by what the records show now that less is
/// left; and the knobs of that.
pub fn refit(
    (fit, select): (&View<'_>, &View<'_>),
    winner: &Tried,
    of: &Candidate,
) -> (Fitted, Vec<Knob>) {
    let machine = fit.machine;
    let own: Vec<Knob> = winner.knobs.iter().filter(|knob| !knob.is_base()).cloned().collect();
    let shown = |fitted: &Fitted| [seen(fit, fitted), own.clone()].concat();
    let mut knobs = shown(&winner.fitted);
    let mut now =
        fit.fit(&winner.fitted.setting, &knobs, 6).unwrap_or_else(|| winner.fitted.clone());
    for pass in 0..REFITS {
        if above_floor(machine, &select.records, &now.setting)
            .is_some_and(|above| above.well_at_floor())
        {
            break;
        }
        // What is left is smaller now, and shows more.
        knobs = shown(&now);
        // A fit that has gone astray looks exactly like a missing effect: from the declared values
        // it may find its way back.
        let fresh = Setting { base: machine.start().base, ..now.setting.clone() };
        let before = now.objective;
        let mut starts = vec![now.setting.clone(), fresh.clone()];
        if (of.sizes > 1 || of.from_all_starts.is_some()) && pass == 0 {
            // Numbers that stand in for one another have many ways to go wrong.
            let others = [&fresh, &now.setting].into_iter().flat_map(|from| {
                of.starts.iter().filter_map(|start| {
                    let mut setting = from.clone();
                    setting.placed.last_mut()?.values.clone_from(&start.placed.values);
                    Some(setting)
                })
            });
            let others: Vec<Setting> = others.collect();
            starts.extend(fit.leading(&others, &knobs, 1).into_iter().map(|begun| begun.setting));
        }
        let again = starts.iter().map(|start| fit.fit(start, &knobs, 4));
        let Some(best) = again.flatten().min_by(|a, b| a.objective.total_cmp(&b.objective)) else {
            break;
        };
        now = best;
        if before - now.objective < LEAST_REFIT * now.rows() as f64 {
            break;
        }
    }
    (now, knobs)
}
