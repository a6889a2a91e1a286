//! The declared model on what really reached the motor.

use std::collections::BTreeMap;

use plant::any::Plant;
use plant::transmission::{Input, Transmission as _};
use rig::{Hand, HandKind, RigFile};

use super::trace::{SampleRow, by_tick};

/// The declared model cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The rig file.
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    /// A value that the model cannot have.
    #[error("declared model: {0}")]
    Parameter(#[from] plant::ParameterError),
}

/// Measured and declared side by side, tick by tick.
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
    /// What was recorded.
    pub measured: Vec<f64>,
    /// What the model makes of the recorded volts.
    pub declared: Vec<f64>,
    /// Root mean square of the difference.
    pub error: f64,
    /// Root mean square of what was recorded, about its mean.
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
/// volts from the first sample on. No effect is put in but those that the rig file declares.
/// Nothing pulls it back to the measurement, so that an error once made stays.
///
/// Volts are held from a scan to the next; where ticks are missing, the last are held over the
/// hole. `None` where the rig file's model is none that `plant` simulates with volts as its input,
/// or no position was recorded.
///
/// # Errors
/// [`ModelError`].
pub fn model(samples: &[SampleRow], rig: &RigFile) -> Result<Option<Model>, ModelError> {
    let rows = by_tick(samples);
    let (Some(first), 1, true) = (rows.first(), rig.axes.len(), rig.model.kind.is_transmission())
    else {
        return Ok(None);
    };
    let initial = &rows[..rows.len().min(INITIAL)];
    let (master_0, slave_0) = (median(initial, |row| row.master), median(initial, |row| row.slave));
    if !master_0.is_finite() {
        return Ok(None);
    }
    let hand = rig.simulation.hand;
    if hand.kind == HandKind::Moving {
        // Nobody knows when it set off.
        return Ok(None);
    }
    let held = hand.kind == HandKind::Passive;
    let mut parameters = rig.axis_parameters(&rig.axes[0])?;
    if held {
        parameters.load_handle(hand.inertia)?;
    }
    let mut plant = parameters.plant(rig.model_effects()?)?;
    // Measured positions are the handle's; the plant's master turns as often as the motor.
    let gear = rig.axes[0].master.turns_per_handle_turn;
    plant.rest_at(gear * master_0, Some(slave_0).filter(|slave| slave.is_finite()));
    let period_s = 1.0 / f64::from(rig.rates.acquisition_hz);
    let (first_tick, mut tick) = (first.tick, first.tick);
    let mut volts = first.motor_v;
    let mut declared = [const { Vec::new() }; 3];
    let mut time_s = Vec::with_capacity(rows.len());
    for row in &rows {
        while tick < row.tick {
            let hand_torque_nm = hand_torque(&plant, &hand);
            plant.step(Input { motor_v: volts, hand_torque_nm }, period_s);
            tick += 1;
        }
        volts = row.motor_v;
        time_s.push((row.tick - first_tick) as f64 * period_s);
        let motion = plant.motion();
        declared[0].push(motion.master_position_rad / gear);
        declared[1].push(motion.slave_position_rad);
        declared[2].push(hand_torque(&plant, &hand));
    }
    let [master, slave, torque] = declared;
    let measured = |value: fn(&SampleRow) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    let channels = [
        Channel::new("master_rad", "rad", measured(|row| row.master), master),
        Channel::new("slave_rad", "rad", measured(|row| row.slave), slave),
        Channel::new("slave_torque_nm", "N·m", measured(|row| row.torque), torque),
    ];
    Ok(Some(Model { time_s, channels: channels.into_iter().flatten().collect() }))
}

/// The reading in the middle: an encoder's count, where a mean would be a fraction of one beside
/// what the machine stands at.
fn median(rows: &[SampleRow], value: fn(&SampleRow) -> f64) -> f64 {
    let mut values: Vec<f64> = rows.iter().map(value).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// What the hand does to the handle, as in the simulated card.
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
