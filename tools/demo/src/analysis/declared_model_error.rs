//! Simulates the declared model on the volts that reached the motor.

use std::collections::BTreeMap;

use anyhow::Context as _;
use ipc_types::Sample;
use plant::transmission::{Input, Transmission as _};
use plant::transmission_kinds::Plant;
use rig::{Hand, HandKind, RigFile};

use super::recorded_messages::{by_tick, master, slave, torque};

/// Measurement and simulation of the declared model, tick by tick.
#[derive(Clone, Debug)]
pub struct Model {
    /// Seconds since the first scan.
    pub time_s: Vec<f64>,
    /// Name, unit, measured, declared.
    pub channels: Vec<Channel>,
}

/// One channel.
#[derive(Clone, Debug)]
pub struct Channel {
    /// As in `model_error`.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The recorded values.
    pub measured: Vec<f64>,
    /// The values simulated from the recorded volts.
    pub declared: Vec<f64>,
    /// Root mean square of the difference.
    pub error: f64,
    /// Root mean square of the recorded values about their mean.
    pub size: f64,
}

impl Model {
    /// Errors by channel.
    pub fn errors(&self) -> BTreeMap<&'static str, f64> {
        self.channels.iter().map(|channel| (channel.name, channel.error)).collect()
    }
}

/// Samples over which the initial positions are taken: 10 ms at 2 kHz, at rest.
const INITIAL: usize = 20;

/// Simulates the declared plant, and the hand that the rig file declares, on the recorded motor
/// volts from the first sample on (of those with the last zeros, where the rig was homed), with
/// the effects that the rig file declares and no others. The simulation runs open loop: nothing
/// corrects it towards the measurement.
///
/// Volts are held from a scan to the next; where ticks are missing, the last are held over the
/// hole. `None` where the rig file's model is none that `plant` simulates with volts as its input,
/// or no position was recorded.
///
/// # Errors
/// Where the rig file gives the model a value that it cannot have.
pub fn model(samples: &[Sample], rig: &RigFile) -> anyhow::Result<Option<Model>> {
    let mut rows = by_tick(samples);
    let zeros = rows.last().map_or(0, |row| row.homing_sequence);
    rows.retain(|row| row.homing_sequence == zeros);
    let (Some(first), 1, true) = (rows.first(), rig.axes.len(), rig.model.kind.is_transmission())
    else {
        return Ok(None);
    };
    let initial = &rows[..rows.len().min(INITIAL)];
    let (master_0, slave_0) = (median(initial, master), median(initial, slave));
    if !master_0.is_finite() {
        return Ok(None);
    }
    let hand = rig.simulation.hand;
    if hand.kind == HandKind::Moving {
        // The time at which the hand began to move is not recorded.
        return Ok(None);
    }
    let held = hand.kind == HandKind::Passive;
    let mut parameters = rig.axis_parameters(&rig.axes[0])?;
    if held {
        parameters.load_handle(hand.inertia).context("declared model")?;
    }
    let mut plant = parameters.plant(rig.axis_effects(&rig.axes[0])?).context("declared model")?;
    // Measured positions are the handle's; the plant's master turns as often as the motor.
    let gear = rig.axes[0].master.turns_per_handle_turn;
    plant.rest_at(gear * master_0, Some(slave_0).filter(|slave| slave.is_finite()));
    let period_s = 1.0 / f64::from(rig.rates.acquisition_hz);
    let (first_tick, mut tick) = (first.tick, first.tick);
    let mut volts = first.motor_v[0];
    let mut declared = [const { Vec::new() }; 3];
    let mut time_s = Vec::with_capacity(rows.len());
    for row in &rows {
        while tick < row.tick {
            let hand_torque_nm = hand_torque(&plant, &hand);
            plant.step(Input { motor_v: volts, hand_torque_nm }, period_s);
            tick += 1;
        }
        volts = row.motor_v[0];
        time_s.push((row.tick - first_tick) as f64 * period_s);
        let motion = plant.motion();
        declared[0].push(motion.master_position_rad / gear);
        declared[1].push(motion.slave_position_rad);
        declared[2].push(hand_torque(&plant, &hand));
    }
    let [declared_master, declared_slave, declared_torque] = declared;
    let measured = |value: fn(&Sample) -> f64| rows.iter().map(|row| value(row)).collect();
    let channels = [
        Channel::new("master_rad", "rad", measured(master), declared_master),
        Channel::new("slave_rad", "rad", measured(slave), declared_slave),
        Channel::new("slave_torque_nm", "N·m", measured(torque), declared_torque),
    ];
    Ok(Some(Model { time_s, channels: channels.into_iter().flatten().collect() }))
}

/// The median: a whole count of the encoder, where a mean would be off by a fraction of one.
fn median(rows: &[&Sample], value: fn(&Sample) -> f64) -> f64 {
    let mut values: Vec<f64> = rows.iter().map(|row| value(row)).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Torque of the hand on the handle, as the simulated card computes it.
fn hand_torque(plant: &Plant, hand: &Hand) -> f64 {
    let motion = plant.motion();
    hand.torque(motion.slave_position_rad, motion.slave_velocity_rad_s, 0.0)
}

impl Channel {
    /// `None` where the channel was not there throughout.
    fn new(
        name: &'static str,
        unit: &'static str,
        measured: Vec<f64>,
        declared: Vec<f64>,
    ) -> Option<Self> {
        if measured.iter().any(|value| !value.is_finite()) {
            return None;
        }
        let count = measured.len().max(1) as f64;
        let mean = measured.iter().sum::<f64>() / count;
        let rms = |squares: f64| (squares / count).sqrt();
        let error = rms(measured.iter().zip(&declared).map(|(m, d)| (m - d).powi(2)).sum());
        let size = rms(measured.iter().map(|m| (m - mean).powi(2)).sum());
        Some(Self { name, unit, measured, declared, error, size })
    }
}
