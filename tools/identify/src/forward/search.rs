//! From records to what the model lacks, round by round: fit, screen, refit the best, judge them on records that took no part.

use nalgebra::DMatrix;
use plant::effects::Site;
use rayon::prelude::*;

use super::catalogue::{Candidate, candidates};
use super::fit::{Fitted, Knob, View, knobs_of};
use super::generic::{NODES, PLACES, Table, Variable};
use super::machine::{Channel, Machine, Placed, Residual, SMOOTHING, SMOOTHING_STARTS, Setting};
use super::record::{repeats, rms};
use super::screen::{Projection, Scored, scale};
use crate::inverse::split::Role;

/// Least gain on the selecting records: fall of the logarithm of the error, summed over channels.
pub const LEAST_GAIN: f64 = 0.10;
/// Least gain over its standard error, by blocks.
pub const LEAST_T: f64 = 3.0;
/// A rival is one whose gain is at least this share of the winner's.
const RIVAL: f64 = 0.93;
/// Most effects that are added.
const MOST_EFFECTS: usize = 3;
/// Candidates that are fitted after the screening, and those of them that are fitted to the end.
const REFITTED: usize = 12;
const FINISHED: usize = 3;
/// Those of them that are fitted afresh as well, in the first round.
const AFRESH: usize = 2;
/// Steps of a candidate before it is finished or dropped.
const QUICK_STEPS: usize = 2;
/// Rows of a block (half a second).
const BLOCK: usize = 125;
/// Bandwidths of the observer: to find the base, and to see effects (rad/s).
const HOLDING_RAD_S: f64 = 150.0;
/// See there.
pub const SEEING_RAD_S: f64 = 80.0;
/// A declared parameter that changes the residual by less than this share over its whole tolerance is not seen.
const SEEN: f64 = 0.02;
/// Most declared parameters that a fit moves.
const MOST_PARAMETERS: usize = 22;
/// An error on the selecting records within this factor of what repeats differ by leaves nothing to be explained.
const AT_FLOOR: f64 = 1.2;
/// Effects that go by the clock: repeats differ by them too, and a floor does not speak against them.
const BY_TIME: [&str; 4] = ["periodic_disturbance", "mains_hum", "thermal_drift", "sensor_drift"];
/// A generic function must beat the best listed effect by this factor to overrule it.
const OVERRULES: f64 = 1.3;

/// How a candidate did on the selecting records.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Its id, or the variable of a function without a name.
    pub id: &'static str,
    /// Where.
    pub site: Site,
    /// Fall of the logarithm of the error, summed over channels, mean of all blocks.
    pub gain: f64,
    /// The same over its standard error.
    pub t: f64,
    /// Records that get better and worse by more than 1 %.
    pub better: usize,
    /// See `better`.
    pub worse: usize,
    /// Whether it passes.
    pub accepted: bool,
}

impl Judged {
    /// The gain in percent of the error.
    pub fn gain_percent(&self) -> f64 {
        -100.0 * (-self.gain).exp_m1()
    }
}

/// An effect that was added.
#[derive(Clone, Debug)]
pub struct Step {
    /// All that were fitted, best first.
    pub ranking: Vec<Judged>,
    /// The one that was added.
    pub added: Judged,
    /// What the records cannot tell from it.
    pub rivals: Vec<(&'static str, Site)>,
    /// The model with it.
    pub fitted: Fitted,
}

/// Something without a name.
#[derive(Clone, Debug)]
pub struct Nameless {
    /// How it did.
    pub judged: Judged,
    /// What it looks like.
    pub table: Table,
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
    /// The last round, in which none passed.
    pub last_ranking: Vec<Judged>,
    /// Functions without a name after that.
    pub generic: Vec<Judged>,
    /// The best of them, where it passes.
    pub nameless: Option<Nameless>,
    /// Knobs of the effects that were added.
    pub effect_knobs: Vec<Knob>,
}

impl Found {
    /// The model with all effects.
    pub fn last(&self) -> &Fitted {
        self.steps.last().map_or(&self.base, |step| &step.fitted)
    }
}

/// Records of a role.
pub fn of_role(machine: &Machine, role: Role) -> Vec<usize> {
    (0..machine.records.len()).filter(|index| machine.records[*index].role == role).collect()
}

fn view(machine: &Machine, role: Role, observer_rad_s: f64) -> View<'_> {
    View { machine, records: of_role(machine, role), observer_rad_s }
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

/// The declared model, fitted within its tolerances on the fitting records; and what of it they show.
fn fit_base(machine: &Machine) -> Option<(Fitted, Vec<Knob>)> {
    let holding = view(machine, Role::Fit, HOLDING_RAD_S);
    let smoothing = machine.base.iter().position(|parameter| parameter.name == SMOOTHING);
    let starts = SMOOTHING_STARTS.iter().filter_map(|speed| {
        let mut start = machine.start();
        if let Some(index) = smoothing {
            start.base[index] = *speed;
        }
        let fitted = holding.evaluate(start)?;
        let knobs = seen(&holding, &fitted)?;
        holding.fit(&fitted.setting, &knobs, 2, 3)
    });
    let held = starts.min_by(|a, b| a.objective.total_cmp(&b.objective))?;
    let seeing = view(machine, Role::Fit, SEEING_RAD_S);
    let first = seeing.evaluate(held.setting)?;
    let knobs = seen(&seeing, &first)?;
    let fitted = seeing.fit(&first.setting, &knobs, 2, 4)?;
    // What is left is smaller now, and shows more.
    let knobs = seen(&seeing, &fitted)?;
    let fitted = seeing.fit(&fitted.setting, &knobs, 3, 4)?;
    Some((fitted, knobs))
}

/// Logarithm of the fall of the error, by record, channel and block.
fn falls(before: &[Residual], after: &[Residual]) -> Vec<Vec<Vec<f64>>> {
    let blocks = |before: &Vec<f64>, after: &Vec<f64>| -> Vec<f64> {
        let pairs = before.chunks_exact(BLOCK).zip(after.chunks_exact(BLOCK));
        let size = |rows: &[f64]| rms(rows.iter().copied()).max(1e-9);
        pairs.map(|(before, after)| (size(before) / size(after)).ln()).collect()
    };
    before
        .iter()
        .zip(after)
        .map(|(before, after)| before.channels.iter().zip(&after.channels).map(|(b, a)| blocks(b, a)).collect())
        .collect()
}

/// Judges what a fit does on records that it has not seen, beside what was there before.
fn judge((id, site): (&'static str, Site), before: &[Residual], after: &[Residual]) -> Judged {
    let falls = falls(before, after);
    let mut blocks = Vec::new();
    for record in &falls {
        let count = record.iter().map(Vec::len).min().unwrap_or(0);
        blocks.extend((0..count).map(|block| record.iter().map(|channel| channel[block]).sum::<f64>()));
    }
    let count = blocks.len().max(1) as f64;
    let gain = blocks.iter().sum::<f64>() / count;
    let variance = blocks.iter().map(|block| (block - gain).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    let t = gain / (variance / count).sqrt().max(1e-12);
    // By whole records and channels.
    let whole = |before: &Vec<f64>, after: &Vec<f64>| {
        rms(before.iter().copied()).max(1e-9).ln() - rms(after.iter().copied()).max(1e-9).ln()
    };
    let by_record: Vec<Vec<f64>> = before
        .iter()
        .zip(after)
        .map(|(before, after)| before.channels.iter().zip(&after.channels).map(|(b, a)| whole(b, a)).collect())
        .collect();
    let sums: Vec<f64> = by_record.iter().map(|channels: &Vec<f64>| channels.iter().sum()).collect();
    let better = sums.iter().filter(|sum| **sum > 0.01).count();
    let worse = sums.iter().filter(|sum| **sum < -0.01).count();
    let channels = by_record.iter().map(Vec::len).max().unwrap_or(0);
    let harmed = (0..channels).any(|channel| {
        let of: Vec<f64> = by_record.iter().filter_map(|channels| channels.get(channel).copied()).collect();
        of.iter().sum::<f64>() / (of.len().max(1) as f64) < -0.03
    });
    let total = sums.iter().sum::<f64>() / sums.len().max(1) as f64;
    let accepted = gain.min(total) >= LEAST_GAIN && t >= LEAST_T && better > worse && !harmed;
    Judged { id, site, gain: gain.min(total), t, better, worse, accepted }
}

/// One candidate, fitted.
struct Tried {
    candidate: usize,
    knobs: Vec<Knob>,
    fitted: Fitted,
    selected: Vec<Residual>,
    judged: Judged,
}

/// One round: the best candidates of the screening, fitted beside what there is, best first.
fn round(
    (fit, select): (&View<'_>, &View<'_>),
    now: &Fitted,
    (knobs, before): (&[Knob], &[Residual]),
    candidates: &[Candidate],
) -> Option<Vec<Tried>> {
    let projection = Projection::new(fit, now, knobs)?;
    let scored = projection.rank(fit, now, candidates);
    let machine = fit.machine;
    let holding = View { observer_rad_s: HOLDING_RAD_S, ..fit.clone() };
    let finish = |candidate: usize, own: Vec<Knob>, fitted: Fitted| -> Option<Tried> {
        let selected = select.residuals(&fitted.setting)?;
        let of = &candidates[candidate];
        let judged = judge((of.id, of.site), before, &selected);
        Some(Tried { candidate, knobs: own, fitted, selected, judged })
    };
    // First a step or two with the slopes that are known already.
    let quick = |scored: &Scored| -> Option<Tried> {
        let mut start = now.setting.clone();
        start.placed.push(scored.placed.clone());
        let of_effect = knobs_of(&candidates[scored.candidate], start.placed.len() - 1);
        let mut own = knobs.to_vec();
        own.extend(of_effect.iter().cloned());
        let mut fitted = fit.evaluate(start)?;
        for _ in 0..QUICK_STEPS {
            let of_effect = fit.slopes(&fitted, &of_effect, &projection.weights)?;
            let mut slopes = projection.slopes.clone().resize_horizontally(own.len(), 0.0);
            slopes.columns_mut(knobs.len(), of_effect.ncols()).copy_from(&of_effect);
            match fit.step(&fitted, &own, &slopes, &projection.weights) {
                Some(better) => fitted = better,
                None => break,
            }
        }
        finish(scored.candidate, own, fitted)
    };
    let mut tried: Vec<Tried> = scored.iter().take(REFITTED).filter_map(quick).collect();
    // Those that fit best and those that hold best go on to the end: from where they are, and afresh from the declared values, since a fit
    // without the effect may have gone astray.
    let mut order: Vec<usize> = (0..tried.len()).collect();
    order.sort_by(|a, b| tried[*a].fitted.objective.total_cmp(&tried[*b].fitted.objective));
    let mut chosen: Vec<usize> = order.iter().copied().take(FINISHED).collect();
    order.sort_by(|a, b| tried[*b].judged.gain.total_cmp(&tried[*a].judged.gain));
    let holders: Vec<usize> = order.into_iter().take(2).filter(|index| !chosen.contains(index)).collect();
    chosen.extend(holders);
    for (place, index) in chosen.into_iter().enumerate() {
        let first = &tried[index];
        let fresh = Setting { base: machine.start().base, ..first.fitted.setting.clone() };
        let afresh =
            || holding.fit(&fresh, &first.knobs, 1, 3).and_then(|held| fit.fit(&held.setting, &first.knobs, 1, 3));
        let starts = [
            fit.fit(&first.fitted.setting, &first.knobs, 1, 3),
            if now.setting.placed.is_empty() && place < AFRESH { afresh() } else { None },
        ];
        let better = starts.into_iter().flatten().min_by(|a, b| a.objective.total_cmp(&b.objective));
        let better = better.and_then(|better| fit.fit(&better.setting, &first.knobs, 2, 3));
        if let Some(better) = better.and_then(|better| finish(first.candidate, first.knobs.clone(), better)) {
            tried[index] = better;
        }
    }
    tried.sort_by(|a, b| b.judged.gain.total_cmp(&a.judged.gain));
    Some(tried)
}

/// The whole search. `None` where not even the declared model can be simulated along the records.
pub fn search(machine: &Machine) -> Option<Found> {
    let (fit, select) = (view(machine, Role::Fit, SEEING_RAD_S), view(machine, Role::Select, SEEING_RAD_S));
    let (base, base_knobs) = fit_base(machine)?;
    let mut base_count = base_knobs.len();
    let (mut now, mut knobs) = (base.clone(), base_knobs);
    let (mut steps, mut last_ranking) = (Vec::<Step>::new(), Vec::new());
    while steps.len() < MOST_EFFECTS {
        let explained = at_floor(machine, &select.records, &now.setting)?;
        let before = select.residuals(&now.setting)?;
        let listed: Vec<Candidate> = candidates(&scale(&fit, &now))
            .into_iter()
            .filter(|candidate| !explained || BY_TIME.contains(&candidate.id))
            .filter(|candidate| {
                now.setting.placed.iter().all(|placed| (placed.id, placed.site) != (candidate.id, candidate.site))
            })
            .collect();
        let tried = round((&fit, &select), &now, (&knobs, &before), &listed)?;
        last_ranking = tried.iter().map(|tried| tried.judged.clone()).collect();
        let Some(best) =
            tried.iter().filter(|tried| tried.judged.accepted).max_by(|a, b| a.judged.gain.total_cmp(&b.judged.gain))
        else {
            break;
        };
        // Of those that do as well, the one with the fewest parameters.
        let near = |tried: &&Tried| tried.judged.accepted && tried.judged.gain >= RIVAL * best.judged.gain;
        let winner = tried
            .iter()
            .filter(|tried| near(tried) && tried.judged.gain >= 0.97 * best.judged.gain)
            .min_by_key(|tried| tried.knobs.len())
            .unwrap_or(best);
        let rivals = tried
            .iter()
            .filter(near)
            .filter(|rival| rival.candidate != winner.candidate)
            .filter(|rival| {
                judge((rival.judged.id, rival.judged.site), &winner.selected, &rival.selected).t.abs() < 4.0
            })
            .map(|rival| (rival.judged.id, rival.judged.site))
            .take(2)
            .collect();
        steps.push(Step {
            ranking: last_ranking.clone(),
            added: winner.judged.clone(),
            rivals,
            fitted: winner.fitted.clone(),
        });
        // What is left is smaller now, and the records show more of the declared model in it.
        let of_effects: Vec<Knob> =
            winner.knobs.iter().filter(|knob| !matches!(knob, Knob::Base(_))).cloned().collect();
        knobs = seen(&fit, &winner.fitted)?;
        base_count = knobs.len();
        knobs.extend(of_effects);
        now = fit.fit(&winner.fitted.setting, &knobs, 3, 4)?;
        if let Some(step) = steps.last_mut() {
            step.fitted = now.clone();
        }
    }
    let (generic, nameless) = match at_floor(machine, &select.records, &now.setting)? {
        true => (Vec::new(), None),
        false => functions((&fit, &select), &now, &knobs)?,
    };
    let effect_knobs = knobs.split_off(base_count);
    Some(Found { base, knobs, steps, last_ranking, generic, nameless, effect_knobs })
}

/// Values between which a variable runs in the fitting records.
fn range(machine: &Machine, records: &[usize], (site, variable): (Site, Variable)) -> (f64, f64) {
    let mut values: Vec<f64> = Vec::new();
    for record in records.iter().map(|index| &machine.records[*index]) {
        let position = match (site, &record.slave) {
            (Site::Slave | Site::Sensor, Some(slave)) => slave,
            _ => &record.master,
        };
        let width = record.decimation();
        let pace = width as f64 * record.step_s;
        let positions = record.averaged(position);
        match variable {
            Variable::Position => values.extend(&positions),
            Variable::Velocity => values.extend(positions.windows(5).map(|rows| (rows[4] - rows[0]) / (4.0 * pace))),
            Variable::Time => values.extend(record.residual_times()),
            Variable::Voltage => values.extend(record.averaged(&record.volts)),
            Variable::Torque | Variable::Deflection => values.extend(record.averaged(&record.volts)),
        }
    }
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get(((values.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0);
    let (low, high) = (at(0.005), at(0.995));
    let constants = match &machine.declared {
        plant::any::Parameters::Hydrostatic(own) => {
            (own.motor_torque_per_volt_nm, own.master_displacement_m_per_rad(), own.line_stiffness_n_per_m())
        }
        plant::any::Parameters::Cable(own) => {
            (own.motor_torque_per_volt_nm, own.master_pulley_radius_m, own.line_stiffness_n_per_m())
        }
    };
    let (per_volt, displacement, stiffness) = constants;
    // The line carries at most what the motor gives, and half of it a line; its ends stand off by that over their stiffness.
    let factor = match (site, variable) {
        (Site::Line, Variable::Velocity) => displacement,
        (_, Variable::Torque) => 0.7 * per_volt,
        (_, Variable::Deflection) => 0.7 * per_volt / (2.0 * displacement * 2.0 * stiffness),
        _ => 1.0,
    };
    (factor * low, factor * high)
}

/// Size of a node's value for a first try.
fn unit((site, variable): (Site, Variable)) -> f64 {
    match (site, variable) {
        (Site::Drive, Variable::Velocity) => 0.05,
        (Site::Line, _) => 1.0,
        (Site::Sensor, _) => 0.005,
        _ => 0.05,
    }
}

/// Functions of one variable beside what there is: how each does on the selecting records, and the best that passes.
fn functions(
    (fit, select): (&View<'_>, &View<'_>),
    now: &Fitted,
    knobs: &[Knob],
) -> Option<(Vec<Judged>, Option<Nameless>)> {
    let machine = fit.machine;
    let projection = Projection::new(fit, now, knobs)?;
    let before = select.residuals(&now.setting)?;
    let has_slave = machine.records.iter().all(|record| record.slave.is_some());
    let mut scored: Vec<(f64, Table)> = PLACES
        .iter()
        .filter(|(site, _)| has_slave || *site != Site::Slave)
        .filter_map(|place| {
            let (low, high) = range(machine, &fit.records, *place);
            let table = Table::new(*place, low, high);
            let settings: Vec<Setting> = (0..NODES)
                .map(|node| {
                    let mut setting = now.setting.clone();
                    let mut table = table.clone();
                    table.values[node] = unit(*place);
                    setting.tables.push(table);
                    setting
                })
                .collect();
            let (factors, share) = projection.explain(fit, &settings)?;
            let mut table = table;
            for (value, factor) in table.values.iter_mut().zip(factors) {
                *value = unit(*place) * factor;
            }
            Some((share, table))
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut tried: Vec<Nameless> = scored
        .into_par_iter()
        .take(5)
        .filter_map(|(_, table)| {
            let mut start = now.setting.clone();
            start.tables.push(table.clone());
            let fitted = fit.fit(&start, knobs, 1, 2)?;
            let judged = judge((table.variable.name(), table.site), &before, &select.residuals(&fitted.setting)?);
            Some(Nameless { judged, table })
        })
        .collect();
    tried.sort_by(|a, b| b.judged.gain.total_cmp(&a.judged.gain));
    let judged = tried.iter().map(|tried| tried.judged.clone()).collect();
    Some((judged, tried.into_iter().find(|tried| tried.judged.accepted)))
}

/// Root mean square of a setting's residual over records, by channel; and that of the difference of records that repeat one another,
/// over √2: what no model can explain.
pub fn errors(machine: &Machine, records: &[usize], setting: &Setting) -> Option<Vec<(Channel, f64, Option<f64>)>> {
    let view = View { machine, records: (0..machine.records.len()).collect(), observer_rad_s: SEEING_RAD_S };
    let residuals = view.residuals(setting)?;
    let pairs = repeats(&machine.records);
    let mut out = Vec::new();
    for channel in [Channel::Master, Channel::Slave, Channel::Torque] {
        let of = |record: usize| {
            let at = machine.channels(record).iter().position(|own| *own == channel)?;
            Some(&residuals[record].channels[at])
        };
        let rows: Vec<f64> = records.iter().filter_map(|record| of(*record)).flatten().copied().collect();
        if rows.is_empty() {
            continue;
        }
        let mut floors: Vec<f64> = pairs
            .iter()
            .filter_map(|(a, b)| {
                let (a, b) = (of(*a)?, of(*b)?);
                Some(rms(a.iter().zip(b).map(|(a, b)| a - b)) / std::f64::consts::SQRT_2)
            })
            .collect();
        floors.sort_by(f64::total_cmp);
        let floor = floors.get(floors.len() / 2).copied();
        out.push((channel, rms(rows.into_iter()), floor));
    }
    Some(out)
}

/// Whether records are explained as closely as repeats of a movement repeat; false where none is repeated.
fn at_floor(machine: &Machine, records: &[usize], setting: &Setting) -> Option<bool> {
    let errors = errors(machine, records, setting)?;
    Some(errors.iter().all(|(_, error, floor)| floor.is_some_and(|floor| *error <= AT_FLOOR * floor)))
}

/// Whether a function without a name explains so much more than a listed effect that the name is wrong.
pub fn overrules(nameless: &Judged, listed: &Judged) -> bool {
    nameless.accepted && nameless.gain > OVERRULES * listed.gain
}

/// What an effect's setting says, by name.
pub fn values(placed: &Placed) -> impl Iterator<Item = (&'static str, f64)> {
    placed.values.iter().copied()
}
