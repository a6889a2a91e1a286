//! How far an effect shows: the same volts and the same hand, with the effect and without it.
//!
//! The machine itself, with its true constants, is pulled toward the record by a light observer and predicts it once with all
//! effects and once without the one in question. What the former leaves is noise; `gain` is by how much larger the rest
//! of the latter is. A model whose declared constants are fitted again may hide a part of that: `gain` is an upper bound of
//! what a refit of the true model gains. An effect counts as detectable from [`DETECTABLE`] on.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::case::{CaseError, Plan, signals};
use crate::deviation::Instruments;
use crate::model::{Input, Model, State};
use crate::record::{Record, SAMPLE_S};

/// The observer's natural frequency, rad/s.
const PULL_RAD_S: f64 = 15.0;
/// Rows left out at the begin of a record, where the observer settles.
const SETTLING: usize = 1000;
/// Least gain of an effect that counts as detectable.
pub const DETECTABLE: f64 = 0.1;

/// How far an effect shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Detectability {
    /// Root mean square of what the true model leaves, of the channel on which the effect shows most: rad, or N·m.
    pub floor: f64,
    /// Of what the model without the effect leaves there.
    pub without: f64,
    /// `without / floor - 1`.
    pub gain: f64,
    /// That channel: 0 master, 1 slave, 2 torque with a free handle.
    pub channel: usize,
}

impl Detectability {
    /// Whether a good method should see it.
    pub fn detectable(&self) -> bool {
        self.gain >= DETECTABLE
    }
}

/// Compares a model with all effects to one without the effect in question, on a record of each kind.
///
/// # Errors
/// What building a model says.
pub fn detect(
    plans: &[Plan],
    records: &[Record],
    with: &(dyn Fn() -> Result<Model, CaseError> + Sync),
    without: &(dyn Fn() -> Result<Model, CaseError> + Sync),
) -> Result<Detectability, CaseError> {
    // A free multisine, triangles, a hand, a chirp.
    let chosen: Vec<usize> = (0..records.len().min(4)).collect();
    let errors = chosen
        .par_iter()
        .map(|&index| {
            let (plan, record) = (&plans[index], &records[index]);
            let (_, hand) = signals(plan);
            // A model that knows nothing of its instruments takes the torque as it was read.
            let (mut whole, mut lacking) = (with()?, without()?);
            let free = hand.is_empty();
            let as_read = if free { &hand } else { &record.slave_torque_nm };
            Ok([errors(&mut whole, &hand, free, record), errors(&mut lacking, as_read, free, record)])
        })
        .collect::<Result<Vec<_>, CaseError>>()?;
    let rms = |which: usize, channel: usize| {
        let counted = errors.iter().filter_map(|record| record[which][channel]);
        let (sum, count) = counted.fold((0.0, 0), |(sum, count), square| (sum + square, count + 1));
        (sum / f64::from(count.max(1))).sqrt()
    };
    let mut best = Detectability { floor: 0.0, without: 0.0, gain: 0.0, channel: 0 };
    for channel in 0..3 {
        let (floor, without) = (rms(0, channel), rms(1, channel));
        let gain = without / floor.max(1e-9) - 1.0;
        if gain > best.gain {
            best = Detectability { floor, without, gain, channel };
        }
    }
    Ok(best)
}

/// Mean square of what a pulled model leaves: of master, slave, and, where the handle is free, torque.
fn errors(model: &mut Model, hand: &[f64], free: bool, record: &Record) -> [Option<f64>; 3] {
    let mut state = State::default();
    let mut sums = [0.0; 3];
    let rows = record.motor_v.len();
    for index in 0..rows {
        let local = index as f64 * SAMPLE_S;
        let time = record.start_s + local;
        let torque = |index: usize| hand.get(index.min(rows - 1)).copied().unwrap_or(0.0);
        let mut seen = Instruments {
            time_s: time,
            motor_v: record.motor_v[index],
            position: [state.0[0], state.0[2]],
            slave_velocity_rad_s: state.0[3],
            torque_nm: torque(index),
            ..Instruments::default()
        };
        for deviation in model.deviations_mut() {
            deviation.sense_angles(&mut seen);
        }
        let lag = [record.master_rad[index] - seen.position[0], record.slave_rad[index] - seen.position[1]];
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
        if index >= SETTLING {
            for (sum, error) in sums.iter_mut().zip([lag[0], lag[1], record.slave_torque_nm[index] - seen.torque_nm]) {
                *sum += error * error;
            }
        }
    }
    let count = rows.saturating_sub(SETTLING).max(1) as f64;
    // What the cell reads is known in a free handle only: elsewhere the hand's torque is what it reads.
    [Some(sums[0] / count), Some(sums[1] / count), free.then_some(sums[2] / count)]
}
