//! The declared model with its tolerances, and what it leaves of a record.

use plant::ParameterSet;
use plant::any;
use plant::effects::{self, Effect, Site};
use plant::transmission::{Correction, Input, Transmission as _};
use rig::Model as Declared;

use super::generic::Table;
use super::record::Record;
use super::sensor::{advanced, hand_torque};
use crate::error::{IdentifyError, Result};
use crate::inverse::split::Role;

/// Name of the parameter that rounds dry friction at rest: the model's own, declared nowhere.
pub const SMOOTHING: &str = "friction_smoothing_rad_s";
/// Name of the parameter that gives that rounding its shape.
pub const SMOOTHING_SHAPE: &str = "friction_smoothing_shape";
/// Name of the parameter that shifts the slave's encoder by up to a count: where it stands when it
/// counts 0, nobody knows closer.
pub const SLAVE_ZERO: &str = "slave_encoder_zero_rad";
/// Between which it is looked for, and where a search begins (rad/s).
const SMOOTHING_RANGE: (f64, f64) = (0.003, 1.0);
/// Where a search begins.
pub const SMOOTHING_STARTS: [f64; 2] = [0.05, 0.3];
/// A model beyond this has lost the record (rad).
const LOST_RAD: f64 = 1e3;
/// Bandwidth of the observer (rad/s). Less would show slow effects with more contrast, and gives a
/// model with stick-slip two ways to go from the same place: fits then end where they began.
pub const OBSERVER_RAD_S: f64 = 150.0;
/// Damping of the observer, as a factor on its bandwidth.
const OBSERVER_DAMPING: f64 = 1.4;

/// A parameter of the declared model that a fit may move.
#[derive(Clone, Debug)]
pub struct BaseParameter {
    /// Name, as in the rig file.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Its declared value; `None` for what only the fit knows.
    pub declared: Option<f64>,
    /// Where fits begin.
    pub start: f64,
    /// Least value within the tolerance.
    pub low: f64,
    /// Greatest value within the tolerance.
    pub high: f64,
    /// Whether it is searched by its logarithm.
    pub logarithmic: bool,
}

/// What a channel of a residual is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Channel {
    /// Master position (rad).
    Master,
    /// Slave position (rad).
    Slave,
    /// Torque channel while nobody is at the handle (N·m).
    Torque,
}

impl Channel {
    /// The column that it is held against.
    pub const fn column(self) -> &'static str {
        match self {
            Self::Master => "master_rad",
            Self::Slave => "slave_rad",
            Self::Torque => "slave_torque_nm",
        }
    }

    /// Its unit.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Master | Self::Slave => "rad",
            Self::Torque => "N·m",
        }
    }
}

/// A listed effect with values for all its parameters that are not as by default.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// Its id.
    pub id: &'static str,
    /// Where.
    pub site: Site,
    /// Values by name; the first is its size.
    pub values: Vec<(&'static str, f64)>,
}

/// A model with everything set.
#[derive(Clone, Debug, Default)]
pub struct Setting {
    /// Values of [`Machine::base`], in its order.
    pub base: Vec<f64>,
    /// Effects.
    pub placed: Vec<Placed>,
    /// Torques without a name.
    pub tables: Vec<Table>,
}

/// The effects of a setting, made, by where they act.
#[derive(Default)]
pub struct Parts {
    /// In the plant, the dead time of all sensors left out.
    pub in_plant: Vec<Box<dyn Effect>>,
    /// On the torque channel alone.
    pub on_torque: Vec<Box<dyn Effect>>,
    /// Dead time of all sensors, as effects.
    pub late: Vec<Box<dyn Effect>>,
    /// All of that together (s).
    pub late_s: f64,
}

impl Setting {
    /// The same with one effect more.
    #[must_use]
    pub fn with(&self, placed: &Placed) -> Self {
        let mut with = self.clone();
        with.placed.push(placed.clone());
        with
    }

    /// Its effects; `None` where one cannot be made.
    pub fn parts(&self) -> Option<Parts> {
        let mut parts = Parts::default();
        for placed in &self.placed {
            let of = if placed.delays_all_sensors() {
                parts.late_s += placed.values.first().map_or(0.0, |(_, delay_s)| *delay_s);
                &mut parts.late
            } else if placed.acts_on_torque_alone() {
                &mut parts.on_torque
            } else {
                &mut parts.in_plant
            };
            of.push(placed.effect()?);
        }
        Some(parts)
    }
}

/// What a model leaves of a record: averaged innovations, by channel.
#[derive(Clone, Debug, Default)]
pub struct Residual {
    /// Channels in the order of [`Machine::channels`].
    pub channels: Vec<Vec<f64>>,
}

/// The declared model and the records that it is held against.
#[derive(Clone, Debug)]
pub struct Machine {
    /// Declared constants.
    pub declared: any::Parameters,
    /// What of them a fit may move.
    pub base: Vec<BaseParameter>,
    /// The records.
    pub records: Vec<Record>,
    /// Steps of the simulation in one row of a record, where the plant's own do not ask for more
    /// (1).
    pub steps: u32,
}

impl Machine {
    /// The model of a rig file (`file`, for messages) with its records; `slave_count_rad` is a
    /// count of the slave's encoder (rad).
    ///
    /// # Errors
    /// Where the declaration is no transmission, or holds what a transmission cannot be.
    pub fn new(
        file: &str,
        declared: &Declared,
        records: Vec<Record>,
        slave_count_rad: Option<f64>,
    ) -> Result<Self> {
        let constants =
            declared.transmission(file).map_err(|error| IdentifyError::Read(error.to_string()))?;
        let mut base = Vec::new();
        for parameter in &declared.parameters {
            let Some(info) = constants.infos().iter().find(|info| info.name == parameter.name)
            else {
                continue;
            };
            let spread = parameter.spread();
            let (low, high) = (
                (parameter.value - spread).max(info.minimum),
                (parameter.value + spread).min(info.maximum),
            );
            if spread <= 0.0
                || low >= high
                || [SMOOTHING, SMOOTHING_SHAPE].contains(&parameter.name.as_str())
            {
                continue;
            }
            base.push(BaseParameter {
                name: parameter.name.clone(),
                unit: info.unit,
                declared: Some(parameter.value),
                start: parameter.value.clamp(low, high),
                low,
                high,
                logarithmic: false,
            });
        }
        if let Some(info) = constants.infos().iter().find(|info| info.name == SMOOTHING) {
            let (low, high) = SMOOTHING_RANGE;
            base.push(BaseParameter {
                name: SMOOTHING.to_owned(),
                unit: info.unit,
                declared: None,
                start: SMOOTHING_STARTS[0],
                low,
                high,
                logarithmic: true,
            });
        }
        if let Some(info) = constants.infos().iter().find(|info| info.name == SMOOTHING_SHAPE) {
            base.push(BaseParameter {
                name: SMOOTHING_SHAPE.to_owned(),
                unit: info.unit,
                declared: None,
                start: 0.0,
                low: info.minimum,
                high: info.maximum,
                logarithmic: false,
            });
        }
        if let Some(count) =
            slave_count_rad.filter(|_| records.iter().all(|record| record.slave.is_some()))
        {
            base.push(BaseParameter {
                name: SLAVE_ZERO.to_owned(),
                unit: "rad",
                declared: None,
                start: 0.0,
                low: -count,
                high: count,
                logarithmic: false,
            });
        }
        Ok(Self { declared: constants, base, records, steps: 1 })
    }

    /// The setting from which fits begin.
    pub fn start(&self) -> Setting {
        Setting {
            base: self.base.iter().map(|parameter| parameter.start).collect(),
            ..Setting::default()
        }
    }

    /// The model as it is declared, without effects; what no file declares as the model has it by
    /// itself.
    pub fn as_declared(&self) -> Setting {
        let of = |parameter: &BaseParameter| {
            parameter.declared.or_else(|| self.declared.get(&parameter.name))
        };
        let base = self.base.iter().map(|parameter| of(parameter).unwrap_or(parameter.start));
        Setting { base: base.collect(), ..Setting::default() }
    }

    /// Records of a role.
    pub fn of_role(&self, role: Role) -> Vec<usize> {
        (0..self.records.len()).filter(|index| self.records[*index].role == role).collect()
    }

    /// What a record's residual consists of.
    pub fn channels(&self, record: usize) -> Vec<Channel> {
        let record = &self.records[record];
        let mut channels = vec![Channel::Master];
        if record.slave.is_some() {
            channels.push(Channel::Slave);
        }
        if record.idle && record.torque.is_some() {
            channels.push(Channel::Torque);
        }
        channels
    }

    /// A channel of what is left of a record; `None` where it has none.
    pub fn channel_of<'a>(
        &self,
        record: usize,
        residual: &'a Residual,
        channel: Channel,
    ) -> Option<&'a Vec<f64>> {
        let at = self.channels(record).iter().position(|own| *own == channel)?;
        residual.channels.get(at)
    }

    /// Where the slave stands when its encoder counts 0 (rad).
    pub fn slave_zero_rad(&self, setting: &Setting) -> f64 {
        self.base
            .iter()
            .position(|parameter| parameter.name == SLAVE_ZERO)
            .map_or(0.0, |index| setting.base[index])
    }

    /// Constants with a setting's values.
    pub fn constants(&self, setting: &Setting) -> Option<any::Parameters> {
        let mut constants = self.declared.clone();
        for (parameter, value) in self
            .base
            .iter()
            .zip(&setting.base)
            .filter(|(parameter, _)| parameter.name != SLAVE_ZERO)
        {
            constants.set(&parameter.name, *value).ok()?;
        }
        Some(constants)
    }

    /// What a setting leaves of a record; `None` where the plant cannot be so, or has no such
    /// effect.
    pub fn residual(&self, setting: &Setting, record: usize) -> Option<Residual> {
        self.residual_beside(setting, record, Vec::new())
    }

    /// The same with effects of the plant beside those of the setting.
    pub fn residual_beside(
        &self,
        setting: &Setting,
        record: usize,
        beside: Vec<Box<dyn Effect>>,
    ) -> Option<Residual> {
        let record = &self.records[record];
        let Parts { mut in_plant, mut on_torque, late_s, .. } = setting.parts()?;
        let tables = setting.tables.iter().filter(|table| table.site != Site::Sensor);
        in_plant.extend(tables.map(|table| Box::new(table.clone()) as Box<dyn Effect>));
        in_plant.extend(beside);
        let mut plant = self
            .constants(setting)?
            .plant(in_plant)
            .ok()?
            .with_longest_step(record.step_s / f64::from(self.steps));
        // What is shown late is known earlier: an observer that waited for it would swing.
        let late = late_s / record.step_s;
        let known = record.volts.len().saturating_sub(late.ceil() as usize);
        let master = advanced(&record.master, late);
        let slave = record.slave.as_deref().map(|slave| advanced(slave, late));
        let slave = slave.as_deref();
        let zero = self.slave_zero_rad(setting);
        plant.rest_at(master[0], slave.map(|slave| slave[0] - zero));
        plant.set_time(record.start_s);

        let (hand, torque) = hand_torque(record, &mut on_torque, &setting.tables);
        let hand = advanced(&hand, late);
        let dt = record.step_s;
        let (on_position, on_speed) =
            (OBSERVER_DAMPING * OBSERVER_RAD_S * dt, OBSERVER_RAD_S * OBSERVER_RAD_S * dt);
        let (width, settling, rows) =
            (record.decimation(), record.settling_rows(), record.residual_rows());
        let mut master_rows = Vec::with_capacity(rows);
        let mut slave_rows = Vec::with_capacity(if slave.is_some() { rows } else { 0 });
        let (mut sums, share) = ([0.0; 2], 1.0 / width as f64);
        for block in 0..rows + settling {
            for row in block * width..(block + 1) * width {
                let reading = plant.reading();
                let mut master_off = master[row] - reading.master_rad;
                let mut slave_off =
                    slave.map_or(0.0, |slave| slave[row] - zero - reading.slave_rad);
                // Shown only after the record's end.
                if row >= known {
                    (master_off, slave_off) = (0.0, 0.0);
                }
                // Also what is no number has lost it.
                if !(master_off.abs() < LOST_RAD && slave_off.abs() < LOST_RAD) {
                    return None;
                }
                sums[0] += master_off;
                sums[1] += slave_off;
                plant.correct(Correction {
                    master_position_rad: on_position * master_off,
                    master_velocity_rad_s: on_speed * master_off,
                    slave_position_rad: on_position * slave_off,
                    slave_velocity_rad_s: on_speed * slave_off,
                });
                plant.step(Input { motor_v: record.volts[row], hand_torque_nm: hand[row] }, dt);
            }
            if block >= settling {
                master_rows.push(share * sums[0]);
                if slave.is_some() {
                    slave_rows.push(share * sums[1]);
                }
            }
            sums = [0.0; 2];
        }
        let mut channels = vec![master_rows];
        if slave.is_some() {
            channels.push(slave_rows);
        }
        channels.extend(torque.map(|torque| record.averaged(&torque)));
        Some(Residual { channels })
    }
}

impl Placed {
    /// The effect, made.
    pub fn effect(&self) -> Option<Box<dyn Effect>> {
        let (_, size) = self.values.first()?;
        let mut effect = effects::make(self.id, self.site, *size).ok()?;
        for (name, value) in &self.values {
            effect.set(name, *value).ok()?;
        }
        Some(effect)
    }

    /// Whether it changes the torque channel and nothing else.
    pub fn acts_on_torque_alone(&self) -> bool {
        const ON_TORQUE: [&str; 6] = [
            "sensor_offset",
            "sensor_gain",
            "sensor_drift",
            "sensor_crosstalk",
            "mains_hum",
            "rectified_sensor",
        ];
        ON_TORQUE.contains(&self.id)
    }

    /// Whether it shows positions and torque late, and changes nothing else.
    pub fn delays_all_sensors(&self) -> bool {
        self.id == "transport_delay" && self.site == Site::Sensor
    }

    /// A value by name.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.values.iter().find(|(own, _)| *own == name).map(|(_, value)| *value)
    }
}
