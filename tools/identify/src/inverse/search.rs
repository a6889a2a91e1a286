//! Which effects the records demand, one after the other, judged on rows that took no part in the fit.

use super::model::{Fitted, Machine, Structure};
use super::spline::{Spline, Variable};
use super::split::{Block, Role};
use crate::effects::{ALL, Declared, Effect, InverseEffect};

/// An effect is accepted when the root-mean-square residual on the selecting rows falls by this share at least. On
/// filtered rows at 200 Hz any test of significance alone would fire on clean data; size is what protects.
pub const LEAST_GAIN: f64 = 0.10;

/// And when the mean fall of the blocks' squared residual is this many of its standard errors above 0.
pub const LEAST_T: f64 = 2.5;

/// A rival is as good as the winner when its gain (in log error) is at least this share of the winner's.
const RIVAL: f64 = 0.9;

/// Most effects that are added: more than three are a fit, not an explanation.
const MOST_EFFECTS: usize = 3;

/// How a candidate did.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Id of the effect, or name of the spline's variable.
    pub id: &'static str,
    /// Fall of the root-mean-square residual on the selecting rows, in percent.
    pub gain_percent: f64,
    /// Block t of the fall.
    pub t: f64,
    /// Blocks on which the residual fell and rose by more than 1 %.
    pub better: usize,
    /// See `better`.
    pub worse: usize,
    /// Whether it passes.
    pub accepted: bool,
}

/// One step of the search: the candidates as they did, ranked, and the model after it.
pub struct Step {
    /// All candidates, best first.
    pub ranking: Vec<Candidate>,
    /// The effect that was added.
    pub added: &'static dyn Effect,
    /// Those that did as well and that the winner makes superfluous.
    pub rivals: Vec<&'static dyn Effect>,
    /// The model with it.
    pub fitted: Fitted,
}

/// What is left that no listed effect explains.
#[derive(Clone, Debug)]
pub struct Unlisted {
    /// What it depends on.
    pub variable: Variable,
    /// Abscissa, force, standard deviation.
    pub table: Vec<[f64; 3]>,
}

/// What the search found.
pub struct Found {
    /// The declared model, fitted within its tolerances.
    pub base: Fitted,
    /// Effects in the order in which they were added.
    pub steps: Vec<Step>,
    /// How the listed candidates did in the last round, in which none passed.
    pub last_ranking: Vec<Candidate>,
    /// How generic functions of one variable did after that.
    pub splines: Vec<Candidate>,
    /// The best of them, where it passes.
    pub unlisted: Option<Unlisted>,
}

impl Found {
    /// The model with all effects that were added.
    pub fn last(&self) -> &Fitted {
        self.steps.last().map_or(&self.base, |s| &s.fitted)
    }

    /// Its structure.
    pub fn structure(&self) -> Structure<'static> {
        Structure { effects: self.steps.iter().filter_map(|s| s.added.inverse()).collect() }
    }
}

/// Blocks of one role.
pub fn of(blocks: &[Block], role: Role) -> Vec<Block> {
    blocks.iter().filter(|b| b.role == role).cloned().collect()
}

/// Mean squared residual of each block.
pub fn mean_squares(machine: &Machine, fitted: &Fitted, blocks: &[Block]) -> Vec<f64> {
    let square = |e: &f64| e * e;
    blocks
        .iter()
        .map(|b| machine.residual(fitted, b).iter().map(square).sum::<f64>() / b.rows.len().max(1) as f64)
        .collect()
}

fn judge(id: &'static str, before: &[f64], after: &[f64]) -> Candidate {
    let n = before.len() as f64;
    let (sum_before, sum_after) = (before.iter().sum::<f64>(), after.iter().sum::<f64>());
    let gain = 1.0 - (sum_after / sum_before.max(f64::MIN_POSITIVE)).sqrt();
    let fall: Vec<f64> = before.iter().zip(after).map(|(b, a)| b - a).collect();
    let mean = fall.iter().sum::<f64>() / n;
    let variance = fall.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    let t = mean / (variance / n).sqrt().max(f64::MIN_POSITIVE);
    let better = before.iter().zip(after).filter(|(b, a)| a.sqrt() < 0.99 * b.sqrt()).count();
    let worse = before.iter().zip(after).filter(|(b, a)| a.sqrt() > 1.01 * b.sqrt()).count();
    let accepted = gain >= LEAST_GAIN && t >= LEAST_T && better > worse;
    Candidate { id, gain_percent: 100.0 * gain, t, better, worse, accepted }
}

/// Candidates that make sense beside the effects that are in the model already.
fn candidates(machine: &Machine, site: &str, added: &[&'static dyn Effect], now: &Fitted) -> Vec<&'static dyn Effect> {
    let has = |id: &str| added.iter().any(|e| e.id() == id);
    // A declared parameter does what its effect would do.
    let declares = |id: &str| {
        id == "coulomb_friction" && machine.parameters.iter().any(|p| p.column == super::model::Column::Sign)
    };
    let at_edge = |which| {
        let column = match which {
            Declared::Mass => super::model::Column::Acceleration,
            Declared::Viscous => super::model::Column::Velocity,
        };
        machine.parameters.iter().zip(&now.fit.at_bound).any(|(p, edge)| p.column == column && *edge)
    };
    ALL.iter()
        .copied()
        .filter(|e| e.sites().contains(&site) && !has(e.id()) && !declares(e.id()))
        .filter(|e| {
            e.inverse().is_some_and(|i| {
                i.needs().iter().all(|need| has(need) || declares(need)) && i.lifts().is_none_or(at_edge)
            })
        })
        .collect()
}

/// Fits every candidate on the fitting blocks and judges it on the selecting ones; `jobs` at a time.
fn try_all(
    machine: &Machine,
    structure: &Structure<'static>,
    candidates: &[&'static dyn Effect],
    before: &[f64],
    (fit, select): (&[Block], &[Block]),
    jobs: usize,
) -> Vec<(&'static dyn Effect, Candidate, Fitted)> {
    let attempt = |effect: &'static dyn Effect| {
        let mut wider = structure.clone();
        wider.effects.push(effect.inverse()?);
        let fitted = machine.fit(&wider, fit, None)?;
        let verdict = judge(effect.id(), before, &mean_squares(machine, &fitted, select));
        Some((effect, verdict, fitted))
    };
    let share = candidates.len().div_ceil(jobs.max(1)).max(1);
    let mut tried: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = candidates
            .chunks(share)
            .map(|part| scope.spawn(|| part.iter().filter_map(|e| attempt(*e)).collect::<Vec<_>>()))
            .collect();
        threads.into_iter().flat_map(|t| t.join().unwrap_or_default()).collect()
    });
    tried.sort_by(|a, b| b.1.gain_percent.total_cmp(&a.1.gain_percent));
    tried
}

/// Greedy search: the best accepted candidate is added and all is fitted again, until none passes. `None` where not even
/// the declared model can be fitted.
pub fn search(machine: &Machine, site: &str, blocks: &[Block], jobs: usize) -> Option<Found> {
    let (fit, select) = (of(blocks, Role::Fit), of(blocks, Role::Select));
    let mut structure = Structure { effects: Vec::new() };
    let base = machine.fit(&structure, &fit, None)?;
    let mut now = base.clone();
    let mut steps: Vec<Step> = Vec::new();
    let mut last_ranking;
    loop {
        let added: Vec<_> = steps.iter().map(|s| s.added).collect();
        let before = mean_squares(machine, &now, &select);
        let candidates = candidates(machine, site, &added, &now);
        let tried = try_all(machine, &structure, &candidates, &before, (&fit, &select), jobs);
        last_ranking = tried.iter().map(|t| t.1.clone()).collect::<Vec<_>>();
        let Some(best) = tried.iter().position(|t| t.1.accepted).filter(|_| steps.len() < MOST_EFFECTS) else { break };
        let (effect, verdict, fitted) = &tried[best];
        structure.effects.extend(effect.inverse());
        // A rival did as well, and has nothing to add to the winner.
        let after = mean_squares(machine, fitted, &select);
        let log_gain = |percent: f64| -(1.0 - percent / 100.0).max(1e-12).ln();
        let near: Vec<_> = tried
            .iter()
            .filter(|t| t.0.id() != effect.id() && t.1.accepted)
            .filter(|t| log_gain(t.1.gain_percent) >= RIVAL * log_gain(verdict.gain_percent))
            .map(|t| t.0)
            .collect();
        let beside = try_all(machine, &structure, &near, &after, (&fit, &select), jobs);
        let rivals = near.into_iter().filter(|e| beside.iter().all(|b| b.0.id() != e.id() || !b.1.accepted)).take(2);
        now = fitted.clone();
        steps.push(Step {
            ranking: last_ranking.clone(),
            added: *effect,
            rivals: rivals.collect(),
            fitted: now.clone(),
        });
    }
    let (splines, unlisted) = adequacy(machine, &structure, &now, (&fit, &select));
    Some(Found { base, steps, last_ranking, splines, unlisted })
}

/// Holds generic functions of one variable against what is left.
fn adequacy(
    machine: &Machine,
    structure: &Structure<'static>,
    now: &Fitted,
    (fit, select): (&[Block], &[Block]),
) -> (Vec<Candidate>, Option<Unlisted>) {
    let before = mean_squares(machine, now, select);
    let mut tried: Vec<(Candidate, Variable, Unlisted)> = Vec::new();
    for variable in Variable::ALL {
        let Some(spline) = Spline::over(variable, machine.balances.iter().map(|b| &b.signals)) else { continue };
        let effects = structure.effects.iter().copied().chain([&spline as &dyn InverseEffect]).collect();
        // Shapes stay where they are: a spline must not pay for a worse smoothing.
        let Some(fitted) = machine.fit(&Structure { effects }, fit, Some(&now.shapes)) else { continue };
        let verdict = judge(variable.name(), &before, &mean_squares(machine, &fitted, select));
        let from = fitted.fit.coefficients.len() - spline.knots.len();
        let at = |i: usize| [spline.knots[i], fitted.fit.coefficients[from + i], fitted.std[from + i]];
        let table = (0..spline.knots.len()).map(at).collect();
        tried.push((verdict, variable, Unlisted { variable, table }));
    }
    tried.sort_by(|a, b| b.0.gain_percent.total_cmp(&a.0.gain_percent));
    let unlisted = tried.iter().find(|t| t.0.accepted).map(|t| t.2.clone());
    (tried.into_iter().map(|t| t.0).collect(), unlisted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_on_one_block_alone_is_not_accepted() {
        let before = [1.0; 10];
        let mut after = [1.0; 10];
        after[3] = 0.0;
        assert!(!judge("x", &before, &after).accepted, "5 % only");
        let before = [1.0, 1.0, 1.0, 1.0, 9.0];
        let after = [1.0, 1.0, 1.0, 1.0, 1.0];
        let verdict = judge("x", &before, &after);
        assert!(verdict.gain_percent > 30.0 && !verdict.accepted, "{verdict:?}");
    }

    #[test]
    fn an_even_gain_is_accepted_and_a_loss_is_not() {
        let before: Vec<f64> = (0..10).map(|i| 1.0 + 0.1 * f64::from(i % 3)).collect();
        let after: Vec<f64> = before.iter().map(|b| 0.7 * b).collect();
        assert!(judge("x", &before, &after).accepted);
        assert!(!judge("x", &after, &before).accepted);
    }
}
