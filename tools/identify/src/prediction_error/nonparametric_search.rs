//! Search of nonparametric functions of one variable: where they are tried, and how each validates.

use plant::effects::Site;
use rayon::prelude::*;

use super::dataset::{Dataset, Fitted};
use super::free_parameter::{FreeParameter, NODE_BOUND};
use super::localisation::localise;
use super::location::Localisation;
use super::nonparametric::{NODES, PLACES, PiecewiseLinear, Variable};
use super::residual_regression::regress;
use super::screening::Projection;
use super::sensor_correction::variable_at;
use super::transmission_model::{Setting, TransmissionModel};
use super::validation::{Validation, validate};

/// Least gain of a function on the selecting records: higher than for listed effects, since it has
/// many degrees of freedom.
const LEAST_GAIN: f64 = 0.25;

/// Least gain where listed effects are known to be inadequate or to leave more than noise.
pub(super) const LEAST_HINT: f64 = 0.15;
/// The same, where they are inadequate, as a share of the gain of the best listed effect, if that
/// passed before it was found inadequate: what explains much less tells no place. A line whose
/// column separates was taken for an error of the drive by a function with 0.46 of it.
const LEAST_HINT_SHARE: f64 = 0.6;

/// Fit rounds of a function beside the declared parameters.
const ROUNDS: usize = 3;

/// A nonparametric function, fitted.
#[derive(Clone, Debug)]
pub struct UnlistedFunction {
    /// Its validation.
    pub validation: Validation,
    /// The function.
    pub table: PiecewiseLinear,
    /// The model with it.
    pub fitted: Fitted,
}

/// Result of the nonparametric search.
#[derive(Clone, Debug, Default)]
pub struct NonparametricResult {
    /// Functions tried, best first.
    pub tried: Vec<Validation>,
    /// The best one, if it passes; a smaller gain suffices where the listed effects are inadequate.
    pub best: Option<UnlistedFunction>,
    /// Localisation, if listed effects are known to be inadequate.
    pub localisation: Option<Localisation>,
}

/// Least gain of a function where all listed effects are inadequate, from the first round of their
/// selection.
pub(super) fn least_hint(first_round: Option<&Vec<Validation>>) -> f64 {
    let passed = first_round.into_iter().flatten().filter(|listed| listed.accepted);
    passed.fold(LEAST_HINT, |least, listed| least.max(LEAST_HINT_SHARE * listed.gain))
}

/// Returns the 0.5 % and 99.5 % quantiles.
fn ends(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        values.get(((values.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0)
    };
    (at(0.005), at(0.995))
}

/// Range of a variable in the fitting records.
fn range(
    model: &TransmissionModel,
    records: &[usize],
    (site, variable): (Site, Variable),
) -> (f64, f64) {
    let mut values: Vec<f64> = Vec::new();
    if site == Site::Sensor {
        for record in records.iter().map(|index| &model.records[*index]) {
            values.extend(
                (0..record.volts.len()).step_by(4).map(|row| variable_at(record, variable, row)),
            );
        }
        return ends(values);
    }
    for record in records.iter().map(|index| &model.records[*index]) {
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
            // The line's torque is taken as proportional to the voltage.
            _ => values.extend(record.averaged(&record.volts)),
        }
    }
    let (low, high) = ends(values);
    let declared = &model.declared;
    let per_volt = declared.motor_torque_per_volt_nm();
    let (displacement, stiffness) =
        (declared.master_displacement_m_per_rad(), declared.line_stiffness_n_per_m());
    // The lines carry at most the motor's torque, half of it each, and deflect by that over their
    // stiffness.
    let factor = match (site, variable) {
        (Site::Line, Variable::Velocity) => displacement,
        (_, Variable::Torque) => 0.7 * per_volt,
        (_, Variable::Force) => 0.7 * per_volt / (2.0 * displacement),
        (_, Variable::Deflection) => 0.7 * per_volt / (2.0 * displacement * 2.0 * stiffness),
        _ => 1.0,
    };
    (factor * low, factor * high)
}

/// Trial value of a node.
fn unit((site, variable): (Site, Variable)) -> f64 {
    match (site, variable) {
        (_, Variable::Force) => 2e-3,
        (Site::Line, _) => 1.0,
        _ => 0.05,
    }
}

/// Adds to one node of the last function, in units of the trial value.
fn add_to_node(mut setting: Setting, node: usize, units: f64) -> Setting {
    if let Some(table) = setting.tables.last_mut() {
        table.values[node] += units * unit((table.site, table.variable));
    }
    setting
}

/// Adds to a node and half as much to its neighbours: a basis with half as many nodes.
fn add_hat(setting: Setting, node: usize, units: f64) -> Setting {
    let sides = [node.checked_sub(1), Some(node + 1).filter(|next| *next < NODES)];
    sides.into_iter().flatten().fold(add_to_node(setting, node, units), |setting, side| {
        add_to_node(setting, side, 0.5 * units)
    })
}

/// Fits functions of one variable beside the current model and validates them on the selecting
/// records. With a `hint`, what the current model leaves is known to need more than a listed
/// effect: functions are limited to the localised site, that gain suffices, and the localisation is
/// returned. No function is returned if the deadline left any out.
pub fn search_nonparametric(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    now: &Fitted,
    hint: Option<f64>,
) -> NonparametricResult {
    let model = fit.model;
    let localisation = hint.and_then(|_| localise((fit, select), &now.setting));
    if fit.deadline.has_passed() {
        return NonparametricResult { localisation, ..NonparametricResult::default() };
    }
    let projection = Projection::new(fit, now);
    let Some(before) = select.residuals(&now.setting) else {
        return NonparametricResult::default();
    };
    let has_slave = model.records.iter().all(|record| record.slave.is_some());
    let has_torque = model.records.iter().any(|record| record.torque.is_some() && !record.idle);
    let mut scored: Vec<(f64, Setting)> = PLACES
        .iter()
        .filter(|(site, _)| has_slave || *site != Site::Slave)
        .filter(|(site, _)| has_torque || *site != Site::Sensor)
        .flat_map(|(site, variables)| variables.iter().map(|variable| (*site, *variable)))
        .filter(|place| {
            localisation.as_ref().is_none_or(|localisation| localisation.allows(*place))
        })
        .filter_map(|place| {
            let (low, high) = range(model, &fit.records, place);
            let table = PiecewiseLinear::new(place, low, high);
            let mut start = now.setting.clone();
            start.tables.push(table);
            let coarse: Vec<Setting> =
                (0..NODES).step_by(2).map(|node| add_hat(start.clone(), node, 1.0)).collect();
            let (factors, share) = projection.explain(fit, &coarse)?;
            for (node, factor) in (0..NODES).step_by(2).zip(factors) {
                start = add_hat(start, node, factor);
            }
            Some((share, start))
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut tried: Vec<UnlistedFunction> = scored
        .into_par_iter()
        .take(5)
        .filter_map(|(_, start)| {
            let table = start.tables.last().filter(|_| !fit.deadline.has_passed())?;
            let most = NODE_BOUND * unit((table.site, table.variable));
            let nodes = (0..NODES).map(|node| FreeParameter::Node { node, most });
            let free: Vec<FreeParameter> = now.parameters.iter().cloned().chain(nodes).collect();
            let fitted = fit.fit(&start, &free, ROUNDS)?;
            let table = fitted.setting.tables.last()?.clone();
            let mut validation = validate(
                (table.variable.name(), table.site),
                &before,
                &select.residuals(&fitted.setting)?,
            );
            validation.accepted &= validation.gain >= LEAST_GAIN;
            Some(UnlistedFunction { validation, table, fitted })
        })
        .collect();
    tried.sort_by(|a, b| b.validation.gain.total_cmp(&a.validation.gain));
    let validation = tried.iter().map(|tried| tried.validation.clone()).collect();
    // Without an adequate listed effect, a partial explanation is reported though it does not pass.
    let enough = |tried: &UnlistedFunction| {
        let hints = hint.is_some_and(|least| tried.validation.gain >= least);
        !fit.deadline.left_work_out() && (hints || tried.validation.accepted)
    };
    let best = tried.into_iter().find(enough);
    let localisation = localisation.map(|localisation| {
        let regressed = best.is_none() && !fit.deadline.has_passed();
        let site = localisation.site();
        let dependence = regressed.then(|| regress((fit, select), now, site)).flatten();
        Localisation { dependence, ..localisation }
    });
    NonparametricResult { tried: validation, best, localisation }
}
