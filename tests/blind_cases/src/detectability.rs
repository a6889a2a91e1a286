//! Detectability of an effect: the same voltage and the same hand, with the effect and without it.
//!
//! The machine with its true constants follows the record by an observer of low bandwidth, once
//! with all effects and once without the one in question. The residual of the former is the floor.
//! The declared constants of the latter, and its smoothing speed, are then fitted within their
//! tolerances, to first order about the truth. `gain` is the excess of the remaining residual over
//! the floor, and an effect counts as detectable from [`DETECTABLE`] on. This approximates the gain
//! of a refit of the true model by one linear step on some seconds of four records.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::case_plan::{Builder, CaseError, Plan, SMOOTHING, signals};
use crate::deviation::Instruments;
use crate::effects::{Effect, Site};
use crate::machine_parameters::{DECLARED, MachineParameters};
use crate::record::{Record, SAMPLE_S};
use crate::rules::Conditions;
use crate::simulator::{Input, Simulator};

/// Natural frequency of the observer, rad/s. With a much lower one, the model sticks where the
/// record slips and vice versa: the residual of the true model is then fifty times as large.
const PULL_RAD_S: f64 = 120.0;
/// Rows left out at the start of a record, where the observer settles.
const SETTLING: usize = 500;
/// Decimation of the rows.
const STRIDE: usize = 10;
/// Rows that are used of the first four records: a free multisine, triangles, a hand, the fast end
/// of a chirp.
const ROWS: [Range<usize>; 4] = [0..5000, 0..5000, 0..5000, 15_500..20_000];
/// Least gain of a detectable effect.
pub const DETECTABLE: f64 = 0.1;

/// Constants that are fitted: those with distinct effects.
const FITTED: [&str; 15] = [
    "line_stiffness_factor",
    "fluid_viscosity_pa_s",
    "fluid_density_kg_m3",
    "master_area_ratio",
    "slave_area_ratio",
    "motor_inertia_kg_m2",
    "slave_handle_inertia_kg_m2",
    "motor_torque_per_volt_nm",
    "motor_coulomb_nm",
    "slave_static_friction_nm",
    "slave_kinetic_friction_nm",
    "slave_falling_slope_nm_s",
    "slave_rising_slope_nm_s",
    "port_damping_n_s_per_m",
    SMOOTHING,
];
/// Its largest relative change.
const SMOOTHING_REACH: f64 = 0.5;

/// Detectability of an effect. Channels are master (rad), slave (rad), and torque with a free
/// handle (N·m).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Detectability {
    /// Rms residual of the true model.
    pub floor: [f64; 3],
    /// Rms residual of the model without the effect.
    pub without: [f64; 3],
    /// The same with its constants fitted.
    pub refitted: [f64; 3],
    /// `refitted / floor - 1` on the channel where it is largest.
    pub gain: f64,
    /// That channel.
    pub channel: usize,
}

impl Detectability {
    /// Whether a good method should find it.
    pub fn detectable(&self) -> bool {
        self.gain >= DETECTABLE
    }
}

/// Residuals of a model that follows a record: master, slave, torque (empty with a hand, whose
/// torque is unknown).
type Left = [Vec<f64>; 3];

/// Compares a machine with all its effects to one without the effect in question, on the channels
/// that the records have.
///
/// # Errors
/// What building a model says.
pub fn detect(
    plans: &[Plan],
    (records, taken): (&[Record], &Conditions),
    with: &Builder,
    without: &Builder,
) -> Result<Detectability, CaseError> {
    let count = records.len().min(ROWS.len());
    let ((with, in_time), (without, as_read)) =
        (undelayed(with, records), undelayed(without, records));
    let handed: Vec<Vec<f64>> = plans[..count].iter().map(|plan| signals(plan).1).collect();
    let left = |builder: &Builder,
                change: Option<(&str, f64)>,
                knows: bool|
     -> Result<Vec<Left>, CaseError> {
        (0..count)
            .map(|index| {
                let hand = &handed[index];
                let record = if knows { &in_time[index] } else { &as_read[index] };
                let free = hand.is_empty();
                // A model that knows nothing of its instruments takes the torque as it was read.
                let torque = if free || knows { hand } else { &record.slave_torque_nm };
                Ok(residual(
                    &mut builder.model(change)?.coarse(),
                    torque,
                    free,
                    record,
                    ROWS[index].clone(),
                ))
            })
            .collect()
    };
    let jobs: Vec<Option<(&str, f64)>> = [None, None]
        .into_iter()
        .chain(FITTED.iter().map(|name| Some((*name, step(name)))))
        .collect();
    let all = jobs
        .par_iter()
        .enumerate()
        .map(
            |(job, change)| {
                if job == 0 { left(&with, None, true) } else { left(&without, *change, false) }
            },
        )
        .collect::<Result<Vec<_>, CaseError>>()?;
    Ok(judge(&all, &without.machine, taken))
}

/// Late readings would make the observer unstable: a model that knows of the dead time of its
/// instruments takes the records as they would be without it.
fn undelayed(builder: &Builder, records: &[Record]) -> (Builder, Vec<Record>) {
    let late = |effect: &Effect| effect.id == "transport_delay" && effect.site == Site::Sensor;
    let delay_s: f64 = builder
        .effects
        .iter()
        .filter(|effect| late(effect))
        .map(|effect| effect.parameters.get("delay_s"))
        .sum();
    let mut builder = builder.clone();
    builder.effects.retain(|effect| !late(effect));
    let earlier = |values: &[f64]| -> Vec<f64> {
        let (whole, part) = ((delay_s / SAMPLE_S).floor(), (delay_s / SAMPLE_S).fract());
        let at = |index: usize| values[(index + whole as usize).min(values.len() - 1)];
        (0..values.len()).map(|index| at(index) + part * (at(index + 1) - at(index))).collect()
    };
    let records = records
        .iter()
        .take(ROWS.len())
        .map(|record| Record {
            start_s: record.start_s,
            motor_v: record.motor_v.clone(),
            master_rad: earlier(&record.master_rad),
            slave_rad: earlier(&record.slave_rad),
            slave_torque_nm: earlier(&record.slave_torque_nm),
        })
        .collect();
    (builder, records)
}

/// Relative change with which a derivative is taken.
fn step(name: &str) -> f64 {
    0.2 * reach(name)
}

fn reach(name: &str) -> f64 {
    DECLARED.iter().find(|row| row.0 == name).map_or(SMOOTHING_REACH, |row| row.2)
}

/// First the true model's rest, then that of the one without the effect, then the latter's with
/// each constant changed.
fn judge(all: &[Vec<Left>], machine: &MachineParameters, taken: &Conditions) -> Detectability {
    let join = |left: &[Left], channel: usize| -> Vec<f64> {
        left.iter().flat_map(|record| record[channel].iter().copied()).collect()
    };
    let rms = |values: &[f64]| {
        (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
    };
    // A channel on which even the true model runs away says nothing.
    let floors: [f64; 3] = std::array::from_fn(|channel| {
        let floor = rms(&join(&all[0], channel));
        if floor.is_finite() { floor.max(1e-6) } else { f64::MAX }
    });
    let stacked = |left: &[Left]| {
        DVector::from_iterator(
            (0..3).map(|channel| join(left, channel).len()).sum(),
            (0..3).flat_map(|channel| {
                let floor = floors[channel];
                join(left, channel)
                    .into_iter()
                    .map(move |value| if value.is_finite() { value / floor } else { 0.0 })
            }),
        )
    };
    let rest = stacked(&all[1]);
    // Columns in units of the relative change.
    let columns: Vec<DVector<f64>> = FITTED
        .iter()
        .zip(&all[2..])
        .map(|(name, left)| (stacked(left) - &rest) / step(name))
        .collect();
    let jacobian = DMatrix::from_columns(&columns);
    let named = machine.named();
    let bounds: Vec<[f64; 2]> = FITTED
        .iter()
        .map(|name| {
            let reach = reach(name);
            let off =
                DECLARED.iter().find(|row| row.0 == *name).map_or(1.0, |row| named[*name] / row.1);
            // Relative to the value of the machine; at least a little to either side.
            [((1.0 - reach) / off - 1.0).min(-1e-3), ((1.0 + reach) / off - 1.0).max(1e-3)]
        })
        .collect();
    let fitted = &rest + &jacobian * bounded_least_squares(&jacobian, &rest, &bounds);
    let mut seen = Detectability {
        floor: floors,
        without: [0.0; 3],
        refitted: [0.0; 3],
        gain: -1.0,
        channel: 0,
    };
    let mut from = 0;
    for (channel, floor) in floors.into_iter().enumerate() {
        let count = join(&all[0], channel).len();
        let part = |values: &DVector<f64>| floor * rms(&values.as_slice()[from..from + count]);
        (seen.without[channel], seen.refitted[channel]) = (part(&rest), part(&fitted));
        let gain = seen.refitted[channel] / floor - 1.0;
        if count > 0 && taken.shows(channel) && gain > seen.gain {
            (seen.gain, seen.channel) = (gain, channel);
        }
        from += count;
    }
    seen
}

/// The change within bounds that minimises `|rest + jacobian change|`: coordinate descent on the
/// normal equations.
pub(crate) fn bounded_least_squares(
    jacobian: &DMatrix<f64>,
    rest: &DVector<f64>,
    bounds: &[[f64; 2]],
) -> DVector<f64> {
    let normal = jacobian.tr_mul(jacobian);
    let gradient = jacobian.tr_mul(rest);
    let mut change = DVector::zeros(bounds.len());
    for _ in 0..2000 {
        for index in 0..bounds.len() {
            let curvature = normal[(index, index)];
            if curvature > 0.0 {
                let slope = gradient[index] + normal.row(index).transpose().dot(&change);
                let [low, high] = bounds[index];
                change[index] = (change[index] - slope / curvature).clamp(low, high);
            }
        }
    }
    change
}

/// Residuals of a model that follows a record by its observer.
fn residual(
    model: &mut Simulator,
    torque_nm: &[f64],
    free: bool,
    record: &Record,
    rows: Range<usize>,
) -> Left {
    let mut left = Left::default();
    let last = record.motor_v.len().min(rows.end);
    let torque = |index: usize| torque_nm.get(index.min(last - 1)).copied().unwrap_or(0.0);
    let mut state = model.settled(record.master_rad[rows.start], record.slave_rad[rows.start]);
    let settled = rows.start + SETTLING;
    for index in rows.start..last {
        let local = index as f64 * SAMPLE_S;
        let time = record.start_s + local;
        let mut seen = Instruments {
            time_s: time,
            motor_v: record.motor_v[index],
            position: [state.0[0], state.0[2]],
            slave_velocity_rad_s: state.0[3],
            torque_nm: if free { 0.0 } else { torque(index) },
            ..Instruments::default()
        };
        for deviation in model.deviations_mut() {
            deviation.sense_angles(&mut seen);
        }
        let lag = [
            record.master_rad[index] - seen.position[0],
            record.slave_rad[index] - seen.position[1],
        ];
        let (speed, rate) = (1.4 * PULL_RAD_S, PULL_RAD_S * PULL_RAD_S);
        let input = Input {
            volts: &record.motor_v[..=index],
            hand_nm: [torque(index), torque(index + 1)],
            pull: [speed * lag[0], rate * lag[0], speed * lag[1], rate * lag[1]],
            ..Input::default()
        };
        let rates = model.advance(&mut state, time, local, &input);
        seen.slave_acceleration_rad_s2 = rates[3];
        for deviation in model.deviations_mut() {
            deviation.sense_torque(&mut seen);
        }
        if index >= settled && index % STRIDE == 0 {
            left[0].push(lag[0]);
            left[1].push(lag[1]);
            if free {
                left[2].push(record.slave_torque_nm[index] - seen.torque_nm);
            }
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_squares_respects_bounds() {
        let jacobian = DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        let rest = DVector::from_vec(vec![-1.0, -5.0, -6.0]);
        let free = bounded_least_squares(&jacobian, &rest, &[[-9.0, 9.0]; 2]);
        assert!((free[0] - 1.0).abs() < 1e-9 && (free[1] - 5.0).abs() < 1e-9, "{free}");
        // With the second held at 2: d/dx of (x - 1)² + (x - 4)² is zero at 2.5.
        let held = bounded_least_squares(&jacobian, &rest, &[[-9.0, 9.0], [-2.0, 2.0]]);
        assert!((held[0] - 2.5).abs() < 1e-9 && held[1] == 2.0, "{held}");
    }
}
