//! Parametric bootstrap of the whole selection: how often records simulated without an effect yield
//! as large a gain.
//!
//! The null distribution of the gain depends on the movement, the repeatability and the number of
//! candidates, so that no fixed threshold serves. Each replicate of the null model follows the
//! measured movement in closed loop, disturbed by torques resampled from the differences of
//! repeated records and scaled so that the innovations have the measured size, and is read by the
//! same encoders. The whole selection is then run on it.

use nalgebra::{Matrix2, Vector2};
use plant::observer::BANDWIDTH_RAD_S;
use plant::transmission::{Input, Transmission as _};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::backward_elimination::equivalent_site;
use super::dataset::Dataset;
use super::noise_floor::repeat_differences;
use super::null_gains::NullGains;
use super::record::{Record, repeats, rms};
use super::search::search;
use super::search_result::SearchResult;
use super::sensor_correction::{advanced, hand_torque, reading_of};
use super::transmission_model::{Channel, EffectGroups, PlacedEffect, Setting, TransmissionModel};
use super::validation::Validation;
use crate::deadline::Deadline;

/// Gains of the position servo along a measured movement.
#[derive(Clone, Copy, Debug)]
pub struct ServoGains {
    /// Voltage per radian of the model master's position error (V/rad).
    pub position_gain: f64,
    /// Voltage per speed error (V·s/rad).
    pub velocity_gain: f64,
    /// Voltage limit (V).
    pub volts_max: f64,
}

/// Result of the bootstrap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BootstrapResult {
    /// Replicates in which something absent was found, listed or not.
    pub alarms: usize,
    /// Largest gain of a falsely found effect per replicate, 0 if there was none. Replicates that
    /// could not be simulated are omitted.
    pub gains: NullGains,
    /// Replicates that the deadline left unsearched.
    pub unsearched: usize,
}

/// Disturbance per radian of the resampled difference: at the motor (V/rad) and at the slave
/// (N·m/rad).
type DisturbanceGains = [f64; 2];
/// Differences of repeated records, by channel.
type DisturbanceRecords = Vec<(Channel, Vec<Vec<f64>>)>;

/// The null model: the final model without its last effect.
struct NullModel<'a> {
    model: &'a TransmissionModel,
    setting: Setting,
    servo: ServoGains,
    disturbances: DisturbanceRecords,
    /// Whether positions are quantised: where quantisation alone exceeds the repeatability, the
    /// measured rows were averaged.
    rounded: [bool; 2],
}

/// Corner of the servo's speed filter (Hz), against quantisation noise.
const SPEED_FILTER_HZ: f64 = 40.0;
/// Largest correction factor of a disturbance gain, either way.
const CORRECTION: f64 = 3.0;
/// Largest disturbance gain in units of the first trial.
const HARDEST: f64 = 10.0;

/// Runs the selection on `replicates` simulated machines that have all effects found but the last.
/// `None` if the disturbances cannot be scaled. Replicates whose search the deadline cut short are
/// not counted.
pub fn parametric_bootstrap(
    model: &TransmissionModel,
    found: &SearchResult,
    servo: ServoGains,
    replicates: usize,
    seed: u64,
    deadline: &Deadline,
) -> Option<BootstrapResult> {
    let mut null = NullModel::new(model, found, servo)?;
    let sizes = null.sizes()?;
    let there = |added: &Validation| {
        let is = |placed: &PlacedEffect| {
            placed.id == added.id
                && (placed.site == added.site
                    || equivalent_site((placed.id, placed.site)) == Some(added.site))
        };
        null.setting.placed.iter().any(is)
    };
    let mut bootstrap = BootstrapResult::default();
    for turn in 0..replicates {
        let other = null.simulate(sizes, seed.wrapping_add(turn as u64 + 1));
        let found = other.and_then(|mut other| search(&mut other, deadline));
        if deadline.has_passed() {
            bootstrap.unsearched = replicates - turn;
            break;
        }
        let Some(found) = found else { continue };
        let wrong = found.steps.iter().map(|step| &step.added).filter(|added| !there(added));
        let gain = wrong.map(|added| added.gain).fold(0.0, f64::max);
        bootstrap.alarms +=
            usize::from(gain > 0.0 || found.unlisted_function.is_some() || found.inadequate);
        bootstrap.gains.0.push(gain);
    }
    Some(bootstrap)
}

/// Simulates one replicate; returns it with its true setting. `None` if it cannot be simulated.
pub fn simulated_null(
    model: &TransmissionModel,
    found: &SearchResult,
    servo: ServoGains,
    seed: u64,
) -> Option<(TransmissionModel, Setting)> {
    let mut null = NullModel::new(model, found, servo)?;
    let sizes = null.sizes()?;
    let simulate = null.simulate(sizes, seed)?;
    Some((simulate, null.setting))
}

/// Differences of repeated records over √2; if none is repeated, the residuals.
fn disturbances(model: &TransmissionModel, setting: &Setting) -> Option<DisturbanceRecords> {
    let residuals = Dataset::whole(model).residuals(setting)?;
    let pairs = repeats(&model.records);
    let disturbances = Channel::ALL.map(|channel| {
        let mut of = repeat_differences(model, &pairs, &residuals, channel);
        if of.is_empty() {
            let own = |(index, residual)| model.channel_of(index, residual, channel).cloned();
            of = residuals.iter().enumerate().filter_map(own).collect();
        }
        of.retain(|disturbance| disturbance.len() > 1);
        (channel, of)
    });
    Some(disturbances.into_iter().filter(|(_, of)| !of.is_empty()).collect())
}

impl<'a> NullModel<'a> {
    fn new(model: &'a TransmissionModel, found: &SearchResult, servo: ServoGains) -> Option<Self> {
        let mut setting = found.last().setting.clone();
        setting.tables.clear();
        setting.placed.pop();
        let disturbances = disturbances(model, &found.last().setting)?;
        Some(Self { model, setting, servo, disturbances, rounded: [true; 2] })
    }
}

impl NullModel<'_> {
    /// Rms of the differences of repeated records.
    fn target(&self, channel: Channel) -> Option<f64> {
        let (_, disturbances) = self.disturbances.iter().find(|(own, _)| *own == channel)?;
        Some(rms(disturbances.iter().flatten().copied()))
    }

    /// Finds the disturbance gains for which the replicates' innovations match the repeatability. A
    /// disturbance at either side affects both channels: three replicates are simulated, one
    /// undisturbed and one disturbed at each side.
    fn sizes(&mut self) -> Option<DisturbanceGains> {
        // The observer's stiffness: a torque of this size shows about unit innovation per radian.
        let pull_nm = self.model.declared.slave_inertia_kg_m2() * BANDWIDTH_RAD_S * BANDWIDTH_RAD_S;
        let probe: DisturbanceGains =
            [pull_nm / self.model.declared.motor_torque_per_volt_nm(), pull_nm];
        let mut alone = self.left([0.0; 2])?;
        let targets = [Channel::Master, Channel::Slave]
            .map(|channel| self.target(channel).unwrap_or(0.0).powi(2));
        for side in 0..2 {
            self.rounded[side] = alone[side] < targets[side];
        }
        if self.rounded.contains(&false) {
            alone = self.left([0.0; 2])?;
        }
        let pushed = [self.left([probe[0], 0.0])?, self.left([0.0, probe[1]])?];
        let response =
            Matrix2::from_fn(|channel, side| (pushed[side][channel] - alone[channel]).max(0.0));
        let lacking = Vector2::from_fn(|channel, _| (targets[channel] - alone[channel]).max(0.0));
        let squares = solve_non_negative(response, lacking);
        let first = [0, 1].map(|side| probe[side] * squares[side].sqrt().min(HARDEST));
        // Friction makes the response nonlinear: one correction, each side by its own channel.
        let now = self.left(first)?;
        Some([0, 1].map(|side| {
            let answered = now[side] - alone[side];
            let factor = if answered > 0.0 { (lacking[side] / answered).sqrt() } else { 1.0 };
            first[side] * factor.clamp(1.0 / CORRECTION, CORRECTION)
        }))
    }

    /// Mean squared innovation of a replicate under the null model, master and slave.
    fn left(&self, sizes: DisturbanceGains) -> Option<[f64; 2]> {
        let simulate = self.simulate(sizes, 0)?;
        let residuals = Dataset::whole(&simulate).residuals(&self.setting)?;
        let of = |channel: Channel| {
            let own = |(index, residual)| simulate.channel_of(index, residual, channel);
            let rows = residuals.iter().enumerate().filter_map(own);
            rms(rows.flatten().copied()).powi(2)
        };
        Some([of(Channel::Master), of(Channel::Slave)])
    }

    /// Simulates all records of a replicate.
    fn simulate(&self, sizes: DisturbanceGains, seed: u64) -> Option<TransmissionModel> {
        let mut generator = Pcg64Mcg::seed_from_u64(seed ^ 0x6368_616e_6365);
        let mut simulate = self.model.clone();
        for record in &mut simulate.records {
            let noises =
                Channel::ALL.map(|channel| self.disturbance(channel, record, &mut generator));
            *record = self.record(record, sizes, &noises)?;
        }
        Some(simulate)
    }

    /// Resamples a disturbance for all rows of a record: a random difference with random start and
    /// sign, zeros if there is none. Torques are interpolated between its values; sensor noise is
    /// held, since interpolation would reduce its variance.
    fn disturbance(&self, channel: Channel, record: &Record, generator: &mut Pcg64Mcg) -> Vec<f64> {
        let rows = record.volts.len();
        let Some((_, disturbances)) = self.disturbances.iter().find(|(own, _)| *own == channel)
        else {
            return vec![0.0; rows];
        };
        let disturbance = &disturbances[generator.random_range(0..disturbances.len())];
        let from = generator.random_range(0..disturbance.len());
        let sign = if generator.random::<bool>() { 1.0 } else { -1.0 };
        let width = record.decimation();
        let at = |block: usize| sign * disturbance[(from + block) % disturbance.len()];
        (0..rows)
            .map(|row| {
                let (block, part) = (row / width, (row % width) as f64 / width as f64);
                if channel == Channel::Torque {
                    at(block)
                } else {
                    at(block) * (1.0 - part) + at(block + 1) * part
                }
            })
            .collect()
    }

    fn record(
        &self,
        measured: &Record,
        sizes: DisturbanceGains,
        noises: &[Vec<f64>; 3],
    ) -> Option<Record> {
        let EffectGroups { mut in_plant, mut on_torque, late, late_s, handle_coupling_kg_m2 } =
            self.setting.parts()?;
        in_plant.extend(late);
        let mut plant = self
            .model
            .constants(&self.setting)?
            .plant(in_plant)
            .ok()?
            .with_longest_step(measured.longest_step_s());
        let zero = self.model.slave_zero_rad(&self.setting);
        let dt = measured.step_s;
        plant.rest_at(measured.master[0], measured.slave.as_ref().map(|slave| slave[0] - zero));
        plant.set_time(measured.start_s);
        let (late_hand, _) = hand_torque(measured, &mut on_torque, &[]);
        let late = late_s / dt;
        let mut on_slave = late_hand.clone();
        let products = &handle_coupling_kg_m2;
        self.model.add_coupling(&self.setting, products, &measured.others, &mut on_slave);
        let on_slave = advanced(&on_slave, late);
        let counted = |position: f64, side: usize| {
            let count = measured.count_rad[side];
            if self.rounded[side] && count > 0.0 {
                (position / count).round() * count
            } else {
                position
            }
        };
        let mut new = Record { sign_flipped: Vec::new(), ..measured.clone() };
        let (mut behind, mut speed) = (0.0, 0.0);
        let share = dt / (dt + 1.0 / (std::f64::consts::TAU * SPEED_FILTER_HZ));
        for row in 0..measured.volts.len() {
            let reading = plant.reading();
            let mut off = 0.0;
            // Before that, delayed sensors have no reading yet; measured values stay.
            if row as f64 >= late {
                new.master[row] = counted(reading.master_rad, 0);
                if let Some(slave) = &mut new.slave {
                    slave[row] = counted(reading.slave_rad + zero, 1);
                }
                off = measured.master[row] - reading.master_rad;
            }
            speed += share * ((off - behind) / dt - speed);
            behind = off;
            let volts = measured.volts[row]
                + self.servo.position_gain * off
                + self.servo.velocity_gain * speed;
            new.volts[row] = volts.clamp(-self.servo.volts_max, self.servo.volts_max);
            plant.step(
                Input {
                    motor_v: new.volts[row] + sizes[0] * noises[0][row],
                    hand_torque_nm: on_slave[row] + sizes[1] * noises[1][row],
                },
                dt,
            );
            if !plant.reading().master_rad.is_finite() {
                return None;
            }
            if measured.torque.is_some() {
                // The sensor shows the hand's torque, not the disturbance.
                let cell_nm =
                    reading_of(&new, &mut on_torque, row, late_hand[row]) + noises[2][row];
                if let Some(torque) = &mut new.torque {
                    torque[row] = cell_nm;
                }
            }
        }
        Some(new)
    }
}

/// Solves a 2×2 system with non-negative unknowns: if one would be negative it is set to 0 and the
/// other solved by least squares.
fn solve_non_negative(matrix: Matrix2<f64>, right: Vector2<f64>) -> Vector2<f64> {
    if let Some(whole) =
        matrix.lu().solve(&right).filter(|whole| whole.iter().all(|value| *value >= 0.0))
    {
        return whole;
    }
    let single = |side: usize| {
        let column = matrix.column(side);
        let mut only = Vector2::zeros();
        only[side] = (column.dot(&right) / column.norm_squared().max(f64::MIN_POSITIVE)).max(0.0);
        only
    };
    let misses = |solution: &Vector2<f64>| (matrix * solution - right).norm();
    let (first, second) = (single(0), single(1));
    if misses(&first) <= misses(&second) { first } else { second }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_equations_are_solved_with_non_negative_unknowns() {
        let matrix = Matrix2::new(2.0, 1.0, 1.0, 3.0);
        let solution = solve_non_negative(matrix, Vector2::new(5.0, 10.0));
        assert!((solution - Vector2::new(1.0, 3.0)).norm() < 1e-9);
        // A side without response is not disturbed.
        let blind = Matrix2::new(0.0, 1.0, 0.0, 2.0);
        assert!(
            (solve_non_negative(blind, Vector2::new(2.0, 4.0)) - Vector2::new(0.0, 2.0)).norm()
                < 1e-9
        );
        // The first alone would have to be negative.
        let solution = solve_non_negative(matrix, Vector2::new(0.0, 10.0));
        assert_eq!(solution[0], 0.0);
        assert!((solution[1] - 3.0).abs() < 1e-9, "{solution}");
    }
}
