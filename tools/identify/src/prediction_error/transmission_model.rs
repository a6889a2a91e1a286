//! The declared transmission model with its tolerances, and its innovations along a record.

use plant::coupled_axes::AXES;
use plant::effects::{self, Effect, Moment, Site};
use plant::observer::{Innovation, Observer};
use plant::transmission::{Input, Reading};
use plant::transmission_kinds;
use rig::Model as Declared;

use super::nonparametric::PiecewiseLinear;
use super::other_axes::{OtherAxis, is_handle_coupling};
use super::record::Record;
use super::sensor_correction::{advanced, hand_torque};
use crate::equation_error::block_roles::Role;
use crate::error::{IdentifyError, Result};

/// Name of the parameter that smooths dry friction near zero speed; estimated, not declared.
pub const SMOOTHING: &str = "friction_smoothing_rad_s";
/// Name of the parameter for the shape of that smoothing.
pub const SMOOTHING_SHAPE: &str = "friction_smoothing_shape";
/// Name of the slave encoder's unknown zero against the master's.
pub const SLAVE_ZERO: &str = "slave_encoder_zero_rad";
/// Bounds of the smoothing speed (rad/s).
const SMOOTHING_RANGE: (f64, f64) = (0.003, 1.0);
/// Starting points of the smoothing speed (rad/s).
pub const SMOOTHING_STARTS: [f64; 2] = [0.05, 0.3];

/// A parameter of the declared model that a fit may vary.
#[derive(Clone, Debug)]
pub struct BaseParameter {
    /// Name in the rig file.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Declared value; `None` for parameters that are only estimated.
    pub declared: Option<f64>,
    /// Starting value.
    pub start: f64,
    /// Lower end of the tolerance.
    pub low: f64,
    /// Upper end of the tolerance.
    pub high: f64,
    /// Whether it is searched on a logarithmic scale.
    pub logarithmic: bool,
}

impl BaseParameter {
    /// A declared parameter, within its tolerance.
    pub(super) fn declared(
        name: &str,
        unit: &'static str,
        value: f64,
        (low, high): (f64, f64),
    ) -> Self {
        Self {
            declared: Some(value),
            start: value.clamp(low, high),
            ..Self::estimated(name, unit, (low, high))
        }
    }

    /// A parameter that is only estimated, from 0 on, within a range.
    fn estimated(name: &str, unit: &'static str, (low, high): (f64, f64)) -> Self {
        let name = name.to_owned();
        Self { name, unit, declared: None, start: 0.0, low, high, logarithmic: false }
    }
}

/// A channel of the residual.
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
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Master, Self::Slave, Self::Torque];

    /// The column with which it is compared.
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

/// A listed effect with the values of its parameters that differ from the defaults.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedEffect {
    /// Its id.
    pub id: &'static str,
    /// Where.
    pub site: Site,
    /// Values by name, its size first.
    pub values: Vec<(&'static str, f64)>,
}

/// Values for everything in the model.
#[derive(Clone, Debug, Default)]
pub struct Setting {
    /// Values of [`TransmissionModel::base`], in its order.
    pub base: Vec<f64>,
    /// Effects.
    pub placed: Vec<PlacedEffect>,
    /// Nonparametric torques.
    pub tables: Vec<PiecewiseLinear>,
}

/// The effects of a setting, instantiated and grouped by where they act.
#[derive(Default)]
pub struct EffectGroups {
    /// In the plant, without the dead time of all sensors.
    pub in_plant: Vec<Box<dyn Effect>>,
    /// On the torque channel only.
    pub on_torque: Vec<Box<dyn Effect>>,
    /// Dead time of all sensors.
    pub late: Vec<Box<dyn Effect>>,
    /// Sum of those dead times (s).
    pub late_s: f64,
    /// Products of inertia with the other axes at the handle, by axis (kg·m²).
    pub handle_coupling_kg_m2: [f64; AXES],
}

impl Setting {
    /// Adds an effect.
    #[must_use]
    pub fn with(&self, placed: &PlacedEffect) -> Self {
        let mut with = self.clone();
        with.placed.push(placed.clone());
        with
    }

    /// Instantiates its effects; `None` if one has invalid parameters.
    pub fn parts(&self) -> Option<EffectGroups> {
        let mut parts = EffectGroups::default();
        for placed in &self.placed {
            let effect = placed.effect()?;
            let products = parts.handle_coupling_kg_m2.iter_mut();
            products.zip(effect.handle_coupling_kg_m2()).for_each(|(sum, own)| *sum += own);
            let of = if let Some(delay_s) = effect.delay_of_all_readings_s() {
                parts.late_s += delay_s;
                &mut parts.late
            } else if acts_on_torque_alone(effect.as_ref()) {
                &mut parts.on_torque
            } else {
                &mut parts.in_plant
            };
            of.push(effect);
        }
        Some(parts)
    }
}

/// Averaged innovations of one record, by channel.
#[derive(Clone, Debug, Default)]
pub struct Residual {
    /// Channels in the order of [`TransmissionModel::channels`].
    pub channels: Vec<Vec<f64>>,
    /// Whether the record has the slave's position.
    pub slave_observed: bool,
}

/// The declared model and the records with which it is compared.
#[derive(Clone, Debug)]
pub struct TransmissionModel {
    /// Declared constants.
    pub declared: transmission_kinds::Parameters,
    /// Those that a fit may vary.
    pub base: Vec<BaseParameter>,
    /// The records.
    pub records: Vec<Record>,
    /// The other axes at the handle whose motion every record has.
    pub others: Vec<OtherAxis>,
}

impl TransmissionModel {
    /// Builds the model of a rig file (`file`, for messages) with its records; `slave_zero_rad` is
    /// the largest error of the slave encoder's zero against the master's (rad).
    ///
    /// # Errors
    /// If the declaration is not a transmission, or has invalid values.
    pub fn new(
        file: &str,
        declared: &Declared,
        records: Vec<Record>,
        slave_zero_rad: Option<f64>,
    ) -> Result<Self> {
        let constants = declared
            .transmission(file)
            .map_err(|error| IdentifyError::Unusable(error.to_string()))?;
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
            base.push(BaseParameter::declared(
                &parameter.name,
                info.unit,
                parameter.value,
                (low, high),
            ));
        }
        let info_of = |name: &str| constants.infos().iter().find(|info| info.name == name);
        if let Some(info) = info_of(SMOOTHING) {
            base.push(BaseParameter {
                start: SMOOTHING_STARTS[0],
                logarithmic: true,
                ..BaseParameter::estimated(SMOOTHING, info.unit, SMOOTHING_RANGE)
            });
        }
        if let Some(info) = info_of(SMOOTHING_SHAPE) {
            let range = (info.minimum, info.maximum);
            base.push(BaseParameter::estimated(SMOOTHING_SHAPE, info.unit, range));
        }
        if let Some(error) =
            slave_zero_rad.filter(|_| records.iter().all(|record| record.slave.is_some()))
        {
            base.push(BaseParameter::estimated(SLAVE_ZERO, "rad", (-error, error)));
        }
        Ok(Self { declared: constants, base, records, others: Vec::new() })
    }

    /// Returns the starting point of fits.
    pub fn start(&self) -> Setting {
        Setting {
            base: self.base.iter().map(|parameter| parameter.start).collect(),
            ..Setting::default()
        }
    }

    /// Returns the declared values, with those of a setting for what is only estimated.
    pub fn declared_with_estimated(&self, setting: &Setting) -> Vec<f64> {
        let of = |(parameter, now): (&BaseParameter, &f64)| match parameter.declared {
            Some(_) => parameter.start,
            None => *now,
        };
        self.base.iter().zip(&setting.base).map(of).collect()
    }

    /// Whether no record has the slave's position.
    pub fn slave_unobserved(&self) -> bool {
        self.records.iter().all(|record| record.slave.is_none())
    }

    /// Returns the model as declared, without effects, with defaults for what is not declared.
    pub fn as_declared(&self) -> Setting {
        let of = |parameter: &BaseParameter| {
            parameter.declared.or_else(|| self.declared.get(&parameter.name))
        };
        let base = self.base.iter().map(|parameter| of(parameter).unwrap_or(parameter.start));
        Setting { base: base.collect(), ..Setting::default() }
    }

    /// Returns the indices of the records of one role.
    pub fn of_role(&self, role: Role) -> Vec<usize> {
        (0..self.records.len()).filter(|index| self.records[*index].role == role).collect()
    }

    /// Returns the channels of a record's residual.
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

    /// Returns one channel of a record's residual, if it has that channel.
    pub fn channel_of<'a>(
        &self,
        record: usize,
        residual: &'a Residual,
        channel: Channel,
    ) -> Option<&'a Vec<f64>> {
        let at = self.channels(record).iter().position(|own| *own == channel)?;
        residual.channels.get(at)
    }

    /// Slave position at encoder count 0 (rad).
    pub fn slave_zero_rad(&self, setting: &Setting) -> f64 {
        self.base_value(setting, SLAVE_ZERO).unwrap_or(0.0)
    }

    /// Value of a parameter of [`Self::base`] in a setting, by name.
    pub(super) fn base_value(&self, setting: &Setting, name: &str) -> Option<f64> {
        let at = self.base.iter().position(|parameter| parameter.name == name)?;
        setting.base.get(at).copied()
    }

    /// Returns the plant's constants with the values of a setting.
    pub fn constants(&self, setting: &Setting) -> Option<transmission_kinds::Parameters> {
        let mut constants = self.declared.clone();
        for (parameter, value) in self
            .base
            .iter()
            .zip(&setting.base)
            .filter(|(own, _)| own.name != SLAVE_ZERO && !is_handle_coupling(&own.name))
        {
            constants.set(&parameter.name, *value).ok()?;
        }
        Some(constants)
    }

    /// Simulates the observer along a record and returns its averaged innovations; `None` if the
    /// setting is invalid or the simulation diverges.
    pub fn residual(&self, setting: &Setting, record: usize) -> Option<Residual> {
        self.residual_beside(setting, record, Vec::new())
    }

    /// As [`Self::residual`], with further effects of the plant.
    pub fn residual_beside(
        &self,
        setting: &Setting,
        record: usize,
        beside: Vec<Box<dyn Effect>>,
    ) -> Option<Residual> {
        let record = &self.records[record];
        let EffectGroups { mut in_plant, mut on_torque, late_s, handle_coupling_kg_m2, .. } =
            setting.parts()?;
        let tables = setting.tables.iter().filter(|table| table.site != Site::Sensor);
        in_plant.extend(tables.map(|table| Box::new(table.clone()) as Box<dyn Effect>));
        in_plant.extend(beside);
        let plant = self
            .constants(setting)?
            .plant(in_plant)
            .ok()?
            .with_longest_step(record.longest_step_s())
            .without_energy_balance();
        // Late readings are advanced in time: an observer with delayed feedback would oscillate.
        let late = late_s / record.step_s;
        let known = record.volts.len().saturating_sub(late.ceil() as usize);
        let master = advanced(&record.master, late);
        let slave = record.slave.as_deref().map(|slave| advanced(slave, late));
        let slave = slave.as_deref();
        let zero = self.slave_zero_rad(setting);
        let mut observer = Observer::new(plant, record.step_s);
        observer.rest_at(master[0], slave.map(|slave| slave[0] - zero));
        observer.set_time(record.start_s);

        let (mut hand, torque) = hand_torque(record, &mut on_torque, &setting.tables);
        self.add_coupling(setting, &handle_coupling_kg_m2, &record.others, &mut hand);
        let hand = advanced(&hand, late);
        let (width, settling, rows) =
            (record.decimation(), record.settling_rows(), record.residual_rows());
        let mut master_rows = Vec::with_capacity(rows);
        let mut slave_rows = Vec::with_capacity(if slave.is_some() { rows } else { 0 });
        let (mut sums, share) = ([0.0; 2], 1.0 / width as f64);
        for block in 0..rows + settling {
            for row in block * width..(block + 1) * width {
                let slave_rad = slave.map(|slave| slave[row] - zero);
                let mut innovation = observer.innovation(master[row], slave_rad);
                // These readings would come after the record's end.
                if row >= known {
                    innovation = Innovation::none(slave.is_some());
                }
                if !innovation.is_bounded() {
                    return None;
                }
                sums[0] += innovation.master_rad;
                sums[1] += innovation.slave_rad.unwrap_or(0.0);
                let (motor_v, hand_torque_nm) = (record.volts[row], hand[row]);
                observer.advance(innovation, Input { motor_v, hand_torque_nm });
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
        Some(Residual { channels, slave_observed: slave.is_some() })
    }
}

/// Whether an effect acts on the torque channel only: at the sensors, it leaves the positions of a
/// moving machine as they are.
pub fn acts_on_torque_alone(effect: &dyn Effect) -> bool {
    let moving = Reading { motor_v: 1.0, master_rad: 0.7, slave_rad: 0.6, slave_torque_nm: 1.0 };
    let moment = Moment {
        time_s: 1.0,
        step_s: 0.0,
        master_position_rad: moving.master_rad,
        master_velocity_rad_s: 1.0,
        slave_position_rad: moving.slave_rad,
        slave_velocity_rad_s: 1.0,
    };
    let mut reading = moving;
    effect.boxed_clone().sense(&mut reading, &moment);
    let positions = |of: Reading| (of.master_rad, of.slave_rad);
    effect.site() == Site::Sensor && positions(reading) == positions(moving)
}

impl PlacedEffect {
    /// Instantiates the effect.
    pub fn effect(&self) -> Option<Box<dyn Effect>> {
        let (name, size) = self.values.first()?;
        // An effect of several alike parameters, as a coupling with several axes, may be without
        // the first.
        let is_size = effects::entry(self.id)?.parameters.first()?.name == *name;
        let size = if is_size { *size } else { 0.0 };
        let mut effect = effects::make(self.id, self.site, size).ok()?;
        for (name, value) in &self.values {
            effect.set(name, *value).ok()?;
        }
        Some(effect)
    }

    /// Returns a value by name.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.values.iter().find(|(own, _)| *own == name).map(|(_, value)| *value)
    }
}
