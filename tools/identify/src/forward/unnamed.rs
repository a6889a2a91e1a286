//! Functions of one variable that stand for what has no name: where they are tried, and how each
//! does.

use plant::effects::Site;
use rayon::prelude::*;

use super::fit::{Fitted, View};
use super::generic::{NODES, PLACES, Table, Variable};
use super::judge::{Judged, judge};
use super::knob::{Knob, MOST_UNITS};
use super::machine::{Machine, Setting};
use super::origin::{Origin, origin};
use super::screen::Projection;
use super::sensor::beside;

/// Least gain on the selecting records of a function that bends wherever it likes.
const LEAST_UNNAMED: f64 = 0.25;

/// The same where something is known to be missing, and this says where.
const LEAST_HINT: f64 = 0.15;

/// Rounds in which a function is fitted beside the declared parameters.
const ROUNDS: usize = 3;

/// Something without a name.
#[derive(Clone, Debug)]
pub struct Nameless {
    /// How it did.
    pub judged: Judged,
    /// What it looks like.
    pub table: Table,
    /// The model with it.
    pub fitted: Fitted,
    /// What its fit moved, its own nodes last.
    pub knobs: Vec<Knob>,
}

/// What has no name.
#[derive(Clone, Debug, Default)]
pub struct Unnamed {
    /// Functions that were tried, best first.
    pub tried: Vec<Judged>,
    /// The best one, where it passes.
    pub best: Option<Nameless>,
    /// Where it enters, whatever it depends on; told only where something is known to be missing.
    pub origin: Option<Origin>,
}

/// Between which all but a hundredth of some values lie.
fn ends(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        values.get(((values.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0)
    };
    (at(0.005), at(0.995))
}

/// Values between which a variable runs in the fitting records.
fn range(machine: &Machine, records: &[usize], (site, variable): (Site, Variable)) -> (f64, f64) {
    let mut values: Vec<f64> = Vec::new();
    if site == Site::Sensor {
        for record in records.iter().map(|index| &machine.records[*index]) {
            values.extend(
                (0..record.volts.len()).step_by(4).map(|row| beside(record, variable, row)),
            );
        }
        return ends(values);
    }
    for record in records.iter().map(|index| &machine.records[*index]) {
        let position = match (site, &record.slave) {
            (Site::Slave, Some(slave)) => slave,
            _ => &record.master,
        };
        let width = record.decimation();
        let pace = width as f64 * record.step_s;
        let positions = record.averaged(position);
        match variable {
            Variable::Position => values.extend(&positions),
            Variable::Velocity => {
                values.extend(positions.windows(5).map(|rows| (rows[4] - rows[0]) / (4.0 * pace)))
            }
            Variable::Time => values.extend(record.residual_times()),
            Variable::VoltageMean => {
                values.extend(record.averaged(&record.volts).into_iter().map(f64::abs))
            }
            Variable::Acceleration => return (0.0, 0.0),
            // The line carries what the volts give.
            _ => values.extend(record.averaged(&record.volts)),
        }
    }
    let (low, high) = ends(values);
    let declared = &machine.declared;
    let per_volt = declared.motor_torque_per_volt_nm();
    let (displacement, stiffness) =
        (declared.master_displacement_m_per_rad(), declared.line_stiffness_n_per_m());
    // The line carries at most what the motor gives, and half of it a line; its ends stand off by
    // that over their stiffness.
    let factor = match (site, variable) {
        (Site::Line, Variable::Velocity) => displacement,
        (_, Variable::Torque) => 0.7 * per_volt,
        (_, Variable::Force) => 0.7 * per_volt / (2.0 * displacement),
        (_, Variable::Deflection) => 0.7 * per_volt / (2.0 * displacement * 2.0 * stiffness),
        _ => 1.0,
    };
    (factor * low, factor * high)
}

/// Size of a node's value for a first try.
fn unit((site, variable): (Site, Variable)) -> f64 {
    match (site, variable) {
        (_, Variable::Force) => 2e-3,
        (Site::Line, _) => 1.0,
        _ => 0.05,
    }
}

/// A setting with a node of its last function moved by so many units.
fn by(mut setting: Setting, node: usize, units: f64) -> Setting {
    if let Some(table) = setting.tables.last_mut() {
        table.values[node] += units * unit((table.site, table.variable));
    }
    setting
}

/// The same of a node and half of its neighbours: a function with half as many nodes.
fn wide(setting: Setting, node: usize, units: f64) -> Setting {
    let sides = [node.checked_sub(1), Some(node + 1).filter(|next| *next < NODES)];
    sides
        .into_iter()
        .flatten()
        .fold(by(setting, node, units), |setting, side| by(setting, side, 0.5 * units))
}

/// Functions of one variable beside what there is: how each does on the selecting records, and the
/// best that passes. With `must_be` something is known to be missing: then only those are tried
/// that act where it enters, and that is told too.
pub fn functions(
    (fit, select): (&View<'_>, &View<'_>),
    (now, knobs): (&Fitted, &[Knob]),
    must_be: bool,
) -> Unnamed {
    let machine = fit.machine;
    let projection = Projection::new(fit, now, knobs);
    let Some(before) = select.residuals(&now.setting) else { return Unnamed::default() };
    let origin = if must_be { origin((fit, select), &now.setting) } else { None };
    let has_slave = machine.records.iter().all(|record| record.slave.is_some());
    let has_torque = machine.records.iter().any(|record| record.torque.is_some() && !record.idle);
    let mut scored: Vec<(f64, Setting)> = PLACES
        .iter()
        .filter(|(site, _)| has_slave || *site != Site::Slave)
        .filter(|(site, _)| has_torque || *site != Site::Sensor)
        .filter(|place| origin.as_ref().is_none_or(|origin| origin.allows(**place)))
        .filter_map(|place| {
            let (low, high) = range(machine, &fit.records, *place);
            let table = Table::new(*place, low, high);
            let mut start = now.setting.clone();
            start.tables.push(table);
            let coarse: Vec<Setting> =
                (0..NODES).step_by(2).map(|node| wide(start.clone(), node, 1.0)).collect();
            let (factors, share) = projection.explain(fit, &coarse)?;
            for (node, factor) in (0..NODES).step_by(2).zip(factors) {
                start = wide(start, node, factor);
            }
            Some((share, start))
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut tried: Vec<Nameless> = scored
        .into_par_iter()
        .take(5)
        .filter_map(|(_, start)| {
            let table = start.tables.last()?;
            let most = MOST_UNITS * unit((table.site, table.variable));
            let nodes = (0..NODES).map(|node| Knob::Node { node, most });
            let free: Vec<Knob> = knobs.iter().cloned().chain(nodes).collect();
            let fitted = fit.fit(&start, &free, ROUNDS)?;
            let table = fitted.setting.tables.last()?.clone();
            let mut judged = judge(
                (table.variable.name(), table.site),
                &before,
                &select.residuals(&fitted.setting)?,
            );
            judged.accepted &= judged.gain >= LEAST_UNNAMED;
            Some(Nameless { judged, table, fitted, knobs: free })
        })
        .collect();
    tried.sort_by(|a, b| b.judged.gain.total_cmp(&a.judged.gain));
    let judged = tried.iter().map(|tried| tried.judged.clone()).collect();
    // Where nothing else is left to say, what explains a part of it is said though it does not
    // pass.
    let enough = |tried: &Nameless| match must_be {
        true => tried.judged.gain >= LEAST_HINT,
        false => tried.judged.accepted,
    };
    Unnamed { tried: judged, best: tried.into_iter().find(enough), origin }
}
