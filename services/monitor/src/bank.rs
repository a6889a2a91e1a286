//! Observers side by side: the declared model, the same with each of its parameters at the edge of
//! its tolerance, and with each listed effect added.
//!
//! All are pulled toward the same measured positions. By how much the innovation of the declared
//! model exceeds that of another is the direction in which such a change of the machine shows.

use plant::effects::{self, Site};
use plant::observer::{Innovation, Observer};
use plant::transmission_kinds::Plant;
use plant::{ParameterError, effects::Effect};
use rig::{Axis, RigError, RigFile};
use thiserror::Error;

use crate::row::Row;

/// Channels of the innovation: master and slave.
pub const CHANNELS: usize = 2;
/// Rows of the model that are averaged to one row of innovations: 250 Hz.
pub const AVERAGED: usize = 2;

/// Effects that begin from nothing as the clock runs: not what departs suddenly.
const DRIFTING: [&str; 2] = ["thermal_drift", "sensor_drift"];
/// Effects whose direction depends on their size, as a gap is crossed faster the smaller it is. So
/// does that of an effect in the line, with which the whole line moves otherwise.
const NOT_PROPORTIONAL: [&str; 2] = ["backlash", "amplifier_deadzone"];
/// What is no candidate where the torque of the hand is measured: that torque is in the model.
const OF_THE_HAND: &str = "hand_impedance";
/// Sizes of those, and of the others, in default sizes.
const SEVERAL_SIZES: &[f64] = &[0.25, 1.0, 3.0];
const ONE_SIZE: &[f64] = &[1.0];

fn factors(id: &str, site: Site) -> &'static [f64] {
    let several = NOT_PROPORTIONAL.contains(&id) || site == Site::Line;
    if several { SEVERAL_SIZES } else { ONE_SIZE }
}

/// What distinguishes one observer from that of the declared model.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// A declared parameter at the edge of its tolerance.
    Parameter {
        /// Its name.
        name: String,
    },
    /// A listed effect.
    Effect {
        /// Its name.
        id: &'static str,
        /// Where it acts.
        site: Site,
        /// Its size, in its default size.
        factor: f64,
    },
}

/// Why an axis cannot be monitored.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum BankError {
    #[error(transparent)]
    Rig(#[from] RigError),
    #[error("model.parameters: {0}")]
    Parameter(#[from] ParameterError),
    /// Late readings would have to be advanced in time.
    #[error(
        "model.effects: \"{id}\" delays the readings by {delay_s} s, and the model beside the \
         machine needs them at once: declare the delay as `transport_delay@drive`, or run without \
         the monitor"
    )]
    Late { id: &'static str, delay_s: f64 },
}

/// One observer beside that of the declared model.
#[derive(Clone, Debug)]
struct Probe {
    observer: Observer,
    /// It diverged from the machine, and shows no direction any more.
    lost: bool,
    sums: [f64; CHANNELS],
}

/// A row of innovations (rad): means of [`AVERAGED`] rows of the model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Innovations {
    /// Tick of the first sample.
    pub tick: u64,
    /// Of the declared model, by channel (rad); the slave's is 0 where it is not observed.
    pub declared: [f64; CHANNELS],
    /// Innovation of the declared model less that with each change, by channel (rad), in the order
    /// of [`ObserverBank::changes`]: what the declared model's would be if the machine had the
    /// change and nothing else.
    pub directions: Vec<[f64; CHANNELS]>,
    /// Largest speed of the model's master (rad/s).
    pub speed_rad_s: f64,
}

/// The observers of one axis. Does not allocate after it is made.
#[derive(Clone, Debug)]
pub struct ObserverBank {
    declared: Observer,
    /// What distinguishes each of the probes.
    changes: Vec<Change>,
    probes: Vec<Probe>,
    begun: bool,
    averaged: usize,
    sums: [f64; CHANNELS],
    row: Innovations,
    step_s: f64,
    acceleration_rad_s2: f64,
}

impl ObserverBank {
    /// The observers of an axis for rows each `step_s` (s).
    ///
    /// # Errors
    /// [`BankError`] where the declared model cannot be simulated.
    pub fn new(rig: &RigFile, axis: &Axis, step_s: f64) -> Result<Self, BankError> {
        let model = rig.axis_model(axis);
        let plant = |change: Option<&(String, f64)>,
                     effect: Option<Box<dyn Effect>>|
         -> Result<Plant, BankError> {
            let mut parameters = rig.axis_parameters(axis)?;
            if let Some((name, value)) = change {
                parameters.set(name, *value)?;
            }
            let mut effects = rig.axis_effects(axis)?;
            effects.extend(effect);
            Ok(parameters.plant(effects)?.with_longest_step(step_s).without_energy_balance())
        };
        for effect in rig.axis_effects(axis)? {
            if let Some(delay_s) = effect.delay_of_all_readings_s() {
                return Err(BankError::Late { id: effect.id(), delay_s });
            }
        }
        let declared = Observer::new(plant(None, None)?, step_s);
        let (mut changes, mut probes) = (Vec::new(), Vec::new());
        let mut add = |change: Change, plant: Plant| {
            let observer = Observer::new(plant, step_s);
            changes.push(change);
            probes.push(Probe { observer, lost: false, sums: [0.0; CHANNELS] });
        };
        for parameter in &model.parameters {
            let spread = parameter.spread();
            // Beyond its range on one side, a parameter is changed to the other.
            let ends = [parameter.value + spread, parameter.value - spread];
            let moved = ends
                .into_iter()
                .find_map(|value| plant(Some(&(parameter.name.clone(), value)), None).ok());
            if spread > 0.0
                && let Some(plant) = moved
            {
                add(Change::Parameter { name: parameter.name.clone() }, plant);
            }
        }
        let sudden = effects::LIST.iter().filter(|entry| {
            let of_the_hand = entry.id == OF_THE_HAND && axis.torque.is_some();
            !DRIFTING.contains(&entry.id) && !of_the_hand
        });
        for (entry, place) in sudden.flat_map(|entry| entry.sites.iter().map(move |at| (entry, at)))
        {
            for factor in factors(entry.id, place.site) {
                let size = factor * place.size;
                let Ok(effect) = effects::make(entry.id, place.site, size) else { continue };
                let late = effect.delay_of_all_readings_s().is_some();
                let of_one_axis = effect.handle_coupling_kg_m2().iter().all(|own| *own == 0.0);
                // One that does not act on this kind of transmission is no candidate.
                if !late
                    && of_one_axis
                    && let Ok(plant) = plant(None, Some(effect))
                {
                    add(Change::Effect { id: entry.id, site: place.site, factor: *factor }, plant);
                }
            }
        }
        let directions = vec![[0.0; CHANNELS]; probes.len()];
        Ok(Self {
            declared,
            changes,
            probes,
            begun: false,
            averaged: 0,
            sums: [0.0; CHANNELS],
            row: Innovations { directions, ..Innovations::default() },
            step_s,
            acceleration_rad_s2: 0.0,
        })
    }

    /// What distinguishes the observers from that of the declared model.
    pub fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// Begins anew with the next row: rows are missing, or positions count from another zero.
    pub fn restart(&mut self) {
        self.begun = false;
        self.averaged = 0;
    }

    /// The newest row of innovations.
    pub const fn newest(&self) -> &Innovations {
        &self.row
    }

    /// Acceleration of the modelled slave over the newest row (rad/s²).
    pub const fn slave_acceleration_rad_s2(&self) -> f64 {
        self.acceleration_rad_s2
    }

    /// Takes a row; innovations each [`AVERAGED`] rows. `None` also where the declared model
    /// diverged from the machine: it then begins anew with the next row.
    pub fn take(&mut self, row: &Row) -> Option<&Innovations> {
        if !self.begun {
            self.begin(row);
        }
        let innovation = self.declared.innovation(row.master_rad, row.slave_rad);
        if !innovation.is_bounded() {
            self.restart();
            return None;
        }
        if self.averaged == 0 {
            self.row.tick = row.tick;
            self.row.speed_rad_s = 0.0;
            self.sums = [0.0; CHANNELS];
        }
        let speed = self.declared.plant().state().master_velocity_rad_s.abs();
        self.row.speed_rad_s = self.row.speed_rad_s.max(speed);
        add_to(&mut self.sums, innovation);
        let before = self.declared.plant().state().slave_velocity_rad_s;
        self.declared.advance(innovation, row.input);
        let after = self.declared.plant().state().slave_velocity_rad_s;
        self.acceleration_rad_s2 = (after - before) / self.step_s;
        for probe in &mut self.probes {
            if self.averaged == 0 {
                probe.sums = [0.0; CHANNELS];
            }
            let own = probe.observer.innovation(row.master_rad, row.slave_rad);
            probe.lost |= !own.is_bounded();
            if !probe.lost {
                add_to(&mut probe.sums, own);
                probe.observer.advance(own, row.input);
            }
        }
        self.averaged += 1;
        if self.averaged < AVERAGED {
            return None;
        }
        self.averaged = 0;
        let share = 1.0 / AVERAGED as f64;
        self.row.declared = self.sums.map(|sum| share * sum);
        for (probe, direction) in self.probes.iter().zip(&mut self.row.directions) {
            for (channel, value) in direction.iter_mut().enumerate() {
                let own = share * (self.sums[channel] - probe.sums[channel]);
                *value = if probe.lost { 0.0 } else { own };
            }
        }
        Some(&self.row)
    }

    fn begin(&mut self, row: &Row) {
        self.begun = true;
        self.declared.rest_at(row.master_rad, row.slave_rad);
        for probe in &mut self.probes {
            probe.observer.rest_at(row.master_rad, row.slave_rad);
            probe.lost = false;
        }
    }
}

fn add_to(sums: &mut [f64; CHANNELS], innovation: Innovation) {
    sums[0] += innovation.master_rad;
    sums[1] += innovation.slave_rad.unwrap_or(0.0);
}
