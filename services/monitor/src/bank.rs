//! Observers side by side: the declared model, the same with its parameters as they were
//! calibrated, that with each of them changed, and with each listed effect added.
//!
//! All are pulled toward the same measured positions. By how much the innovation of the calibrated
//! model exceeds that of one with a change is the direction in which such a change of the machine
//! shows.

use plant::ParameterError;
use plant::effects::monitoring::Monitoring;
use plant::effects::{self, Effect, Place, Site};
use plant::observer::{Innovation, Observer};
use plant::transmission_kinds::Parameters;
use rig::{Axis, Parameter, RigError, RigFile};
use thiserror::Error;

use crate::row::Row;

/// Channels of the innovation: master and slave.
pub const CHANNELS: usize = 2;
/// Rows of the model that are averaged to one row of innovations: 250 Hz.
pub const AVERAGED: usize = 2;

/// Rows of innovations after a beginning in which the observers settle.
const SETTLING_ROWS: u32 = 125;
/// By how much a parameter is changed where the model is linearised at calibrated values, in
/// tolerances: a small change shows the direction there more truly than one across the tolerance.
const NEAR: f64 = 0.3;
/// Sizes of effects that are not proportional, as a gap is crossed faster the smaller it is, and of
/// those in the line, with which the whole line moves otherwise; and of the others (default sizes).
const SEVERAL_SIZES: &[f64] = &[0.25, 1.0, 3.0];
const ONE_SIZE: &[f64] = &[1.0];

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
    /// The model is not possible with it.
    missing: bool,
    sums: [f64; CHANNELS],
    effect: Option<Box<dyn Effect>>,
}

impl Probe {
    fn new(observer: Observer, effect: Option<Box<dyn Effect>>) -> Self {
        Self { observer, lost: false, missing: false, sums: [0.0; CHANNELS], effect }
    }
}

/// A declared parameter that is calibrated.
#[derive(Clone, Debug)]
struct Calibrated {
    name: String,
    declared: f64,
    /// Its tolerance; negative where it can only be smaller.
    spread: f64,
    /// Where the model is linearised, in tolerances.
    base: f64,
    /// By how much its probe differs from there, in tolerances.
    step: f64,
}

impl Calibrated {
    fn value(&self, share: f64) -> f64 {
        self.declared + share * self.spread
    }
}

/// A row of innovations (rad): means of [`AVERAGED`] rows of the model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Innovations {
    /// Tick of the first sample.
    pub tick: u64,
    /// Of the declared model, by channel (rad); the slave's is 0 where it is not observed.
    pub declared: [f64; CHANNELS],
    /// The same as the model has it that was linearised at calibrated parameters, by channel (rad):
    /// its innovation, and the directions of the parameters by as much as each is off its declared
    /// value.
    pub linear: [f64; CHANNELS],
    /// Of the model with the parameters at which it is linearised, by channel (rad).
    pub calibrated: [f64; CHANNELS],
    /// By channel (rad), in the order of [`ObserverBank::changes`]: what a change adds to the
    /// innovation if the machine has it and nothing else.
    pub directions: Vec<[f64; CHANNELS]>,
    /// Largest speed of the model's master (rad/s).
    pub speed_rad_s: f64,
    /// Whether the observers have settled since they began anew.
    pub settled: bool,
}

/// Constants and effects from which the models of the observers are made.
#[derive(Clone, Debug)]
struct Recipe {
    parameters: Parameters,
    effects: Vec<Box<dyn Effect>>,
    step_s: f64,
}

impl Recipe {
    fn observer(
        &self,
        parameters: &Parameters,
        effect: Option<&dyn Effect>,
    ) -> Result<Observer, ParameterError> {
        let more = effect.map(|effect| effect.boxed_clone());
        let effects = self.effects.iter().cloned().chain(more).collect();
        let plant = parameters.clone().plant(effects)?;
        let plant = plant.with_longest_step(self.step_s).without_energy_balance();
        Ok(Observer::new(plant, self.step_s))
    }

    /// A parameter at the edge of its tolerance, beyond its range on one side at the other; `None`
    /// where it has no tolerance.
    fn parameter(&self, parameter: &Parameter) -> Option<(Calibrated, Probe)> {
        let spread = parameter.spread();
        [spread, -spread].into_iter().filter(|spread| *spread != 0.0).find_map(|spread| {
            let mut changed = self.parameters.clone();
            changed.set(&parameter.name, parameter.value + spread).ok()?;
            let observer = self.observer(&changed, None).ok()?;
            let (name, declared) = (parameter.name.clone(), parameter.value);
            let calibrated = Calibrated { name, declared, spread, base: 0.0, step: 1.0 };
            Some((calibrated, Probe::new(observer, None)))
        })
    }

    /// The listed effects that are candidates, in their sizes.
    fn effects(&self, torque_measured: bool) -> Vec<(Change, Probe)> {
        let mut found = Vec::new();
        for entry in effects::LIST {
            let Monitoring { sudden, proportional, of_the_hand } = entry.monitoring;
            if !sudden || (of_the_hand && torque_measured) {
                continue;
            }
            for place in entry.sites {
                let several = !proportional || place.site == Site::Line;
                for factor in if several { SEVERAL_SIZES } else { ONE_SIZE } {
                    found.extend(self.effect(entry.id, place, *factor));
                }
            }
        }
        found
    }

    /// An effect of a size, in default sizes; `None` where it is no candidate for this kind of
    /// transmission.
    fn effect(&self, id: &'static str, place: &Place, factor: f64) -> Option<(Change, Probe)> {
        let effect = effects::make(id, place.site, factor * place.size).ok()?;
        let late = effect.delay_of_all_readings_s().is_some();
        let of_one_axis = effect.handle_coupling_kg_m2().iter().all(|own| *own == 0.0);
        if late || !of_one_axis {
            return None;
        }
        let observer = self.observer(&self.parameters, Some(effect.as_ref())).ok()?;
        let change = Change::Effect { id, site: place.site, factor };
        Some((change, Probe::new(observer, Some(effect))))
    }
}

/// The observers of one axis. Does not allocate after it is made, except where it is linearised
/// anew.
#[derive(Clone, Debug)]
pub struct ObserverBank {
    recipe: Recipe,
    calibrated: Vec<Calibrated>,
    declared: Observer,
    /// That of the model with the parameters at which it is linearised.
    reference: Observer,
    /// What distinguishes each of the probes from the reference, parameters first.
    changes: Vec<Change>,
    probes: Vec<Probe>,
    begun: bool,
    /// Whether all but the declared model have begun.
    linear_begun: bool,
    settling: u32,
    averaged: usize,
    sums: [f64; CHANNELS],
    reference_sums: [f64; CHANNELS],
    row: Innovations,
    acceleration_rad_s2: f64,
}

impl ObserverBank {
    /// The observers of an axis for rows each `step_s` (s), linearised at the declared parameters.
    ///
    /// # Errors
    /// [`BankError`] where the declared model cannot be simulated.
    pub fn new(rig: &RigFile, axis: &Axis, step_s: f64) -> Result<Self, BankError> {
        let effects = rig.axis_effects(axis)?;
        for effect in &effects {
            if let Some(delay_s) = effect.delay_of_all_readings_s() {
                return Err(BankError::Late { id: effect.id(), delay_s });
            }
        }
        let recipe = Recipe { parameters: rig.axis_parameters(axis)?, effects, step_s };
        let declared = recipe.observer(&recipe.parameters, None)?;
        let parameters = rig.axis_model(axis).parameters;
        let (calibrated, mut probes): (Vec<_>, Vec<_>) =
            parameters.iter().filter_map(|parameter| recipe.parameter(parameter)).unzip();
        let of_parameter = |own: &Calibrated| Change::Parameter { name: own.name.clone() };
        let mut changes: Vec<_> = calibrated.iter().map(of_parameter).collect();
        for (change, probe) in recipe.effects(axis.torque.is_some()) {
            changes.push(change);
            probes.push(probe);
        }
        let directions = vec![[0.0; CHANNELS]; probes.len()];
        Ok(Self {
            recipe,
            calibrated,
            reference: declared.clone(),
            declared,
            changes,
            probes,
            begun: false,
            linear_begun: false,
            settling: 0,
            averaged: 0,
            sums: [0.0; CHANNELS],
            reference_sums: [0.0; CHANNELS],
            row: Innovations { directions, ..Innovations::default() },
            acceleration_rad_s2: 0.0,
        })
    }

    /// Linearises at parameters that are off their declared values by `shares` (tolerances), as an
    /// iterated extended Kalman filter does, and begins those observers anew with the next row;
    /// that of the declared model goes on. A parameter that cannot have that value stays where it
    /// was. Allocates.
    pub fn linearise<'a>(&mut self, shares: impl IntoIterator<Item = &'a f64>) {
        let mut base = self.recipe.parameters.clone();
        for (own, share) in self.calibrated.iter_mut().zip(shares) {
            if base.set(&own.name, own.value(*share)).is_ok() {
                own.base = *share;
            } else if base.set(&own.name, own.value(own.base)).is_err() {
                own.base = 0.0;
            }
        }
        let Ok(reference) = self.recipe.observer(&base, None) else { return };
        self.reference = reference;
        for (at, probe) in self.probes.iter_mut().enumerate() {
            let observer = match self.calibrated.get_mut(at) {
                Some(own) => [NEAR, -NEAR].into_iter().find_map(|step| {
                    let mut changed = base.clone();
                    changed.set(&own.name, own.value(own.base + step)).ok()?;
                    let observer = self.recipe.observer(&changed, None).ok()?;
                    own.step = step;
                    Some(observer)
                }),
                None => self.recipe.observer(&base, probe.effect.as_deref()).ok(),
            };
            // One that cannot be made shows no direction.
            probe.missing = observer.is_none();
            probe.observer = observer.unwrap_or_else(|| self.reference.clone());
        }
        self.linear_begun = false;
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
    /// diverged from the machine: all then begin anew with the next row. Those of the calibrated
    /// model begin anew alone where it diverged. Whichever begins, the rows are not settled then.
    pub fn take(&mut self, row: &Row) -> Option<&Innovations> {
        let fresh = !self.begun;
        if fresh {
            self.begun = true;
            self.linear_begun = false;
            self.declared.rest_at(row.master_rad, row.slave_rad);
        }
        let innovation = self.declared.innovation(row.master_rad, row.slave_rad);
        if !innovation.is_bounded() {
            self.restart();
            return None;
        }
        let diverged = !self.reference.innovation(row.master_rad, row.slave_rad).is_bounded();
        if !self.linear_begun || diverged {
            self.begin(row, fresh);
        }
        let of_reference = self.reference.innovation(row.master_rad, row.slave_rad);
        if self.averaged == 0 {
            self.row.tick = row.tick;
            self.row.speed_rad_s = 0.0;
            self.sums = [0.0; CHANNELS];
            self.reference_sums = [0.0; CHANNELS];
        }
        let speed = self.declared.plant().state().master_velocity_rad_s.abs();
        self.row.speed_rad_s = self.row.speed_rad_s.max(speed);
        add_to(&mut self.sums, innovation);
        add_to(&mut self.reference_sums, of_reference);
        let before = self.declared.plant().state().slave_velocity_rad_s;
        self.declared.advance(innovation, row.input);
        self.reference.advance(of_reference, row.input);
        let after = self.declared.plant().state().slave_velocity_rad_s;
        self.acceleration_rad_s2 = (after - before) / self.recipe.step_s;
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
        self.finish();
        Some(&self.row)
    }

    /// The row of innovations from the sums.
    fn finish(&mut self) {
        let mean = |sums: [f64; CHANNELS]| sums.map(|sum| sum / AVERAGED as f64);
        let reference = mean(self.reference_sums);
        self.row.declared = mean(self.sums);
        self.row.calibrated = reference;
        self.row.linear = reference;
        for (at, (probe, direction)) in self.probes.iter().zip(&mut self.row.directions).enumerate()
        {
            let own = mean(probe.sums);
            let calibrated = self.calibrated.get(at);
            for channel in 0..CHANNELS {
                let less = (reference[channel] - own[channel]) / calibrated.map_or(1.0, |c| c.step);
                direction[channel] = if probe.lost || probe.missing { 0.0 } else { less };
                self.row.linear[channel] += calibrated.map_or(0.0, |c| c.base) * direction[channel];
            }
        }
        self.settling = self.settling.saturating_sub(1);
        self.row.settled = self.settling == 0;
    }

    /// Begins all but the declared model: at rest with it where that is `fresh`, else from its
    /// state, since a line with dry friction does not forget where it began.
    fn begin(&mut self, row: &Row, fresh: bool) {
        self.linear_begun = true;
        self.settling = SETTLING_ROWS + 1;
        let declared = &self.declared;
        let begin = |observer: &mut Observer| {
            observer.rest_at(row.master_rad, row.slave_rad);
            if !fresh {
                observer.follow(declared);
            }
        };
        begin(&mut self.reference);
        for probe in &mut self.probes {
            begin(&mut probe.observer);
            probe.lost = false;
        }
    }
}

fn add_to(sums: &mut [f64; CHANNELS], innovation: Innovation) {
    sums[0] += innovation.master_rad;
    sums[1] += innovation.slave_rad.unwrap_or(0.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant::transmission::{Input, Transmission as _};
    use rig::RIGS;

    const STEP_S: f64 = 2e-3;

    fn rig() -> RigFile {
        let shipped = RIGS.iter().find(|shipped| shipped.name == "hydrostatic").unwrap();
        RigFile::parse(shipped.text, "hydrostatic").unwrap()
    }

    /// Rows of a machine whose motor has a Coulomb friction off by `share` of its tolerance.
    fn rows(rig: &RigFile, share: f64, count: usize) -> Vec<Row> {
        let axis = &rig.axes[0];
        let mut parameters = rig.axis_parameters(axis).unwrap();
        let model = rig.axis_model(axis);
        let own = model.parameters.iter().find(|own| own.name == "motor_coulomb_nm").unwrap();
        parameters.set(&own.name, own.value + share * own.spread()).unwrap();
        let mut plant = parameters.plant(Vec::new()).unwrap().with_longest_step(STEP_S);
        let row = |at: usize| {
            let reading = plant.reading();
            let motor_v = 4.0 * (6.0 * at as f64 * STEP_S).sin();
            let input = Input { motor_v, hand_torque_nm: 0.0 };
            plant.step(input, STEP_S);
            Row {
                tick: 4 * at as u64,
                master_rad: reading.master_rad,
                slave_rad: Some(reading.slave_rad),
                input,
            }
        };
        (0..count).map(row).collect()
    }

    /// Mean square of the calibrated model's innovation of the master.
    fn mean_square(bank: &mut ObserverBank, rows: &[Row]) -> f64 {
        let own = |row: &Row| {
            bank.take(row).filter(|own| own.settled).map(|own| own.calibrated[0].powi(2))
        };
        let squares: Vec<f64> = rows.iter().filter_map(own).collect();
        squares.iter().sum::<f64>() / squares.len() as f64
    }

    #[test]
    fn linearised_where_the_machine_is_no_innovation_is_left() {
        let rig = rig();
        let rows = rows(&rig, 0.7, 1500);
        let mut bank = ObserverBank::new(&rig, &rig.axes[0], STEP_S).unwrap();
        let before = mean_square(&mut bank, &rows);
        let share = |own: &Calibrated| if own.name == "motor_coulomb_nm" { 0.7 } else { 0.0 };
        let shares: Vec<f64> = bank.calibrated.iter().map(share).collect();
        let declared = bank.newest().declared;
        bank.linearise(&shares);
        bank.restart();
        let after = mean_square(&mut bank, &rows);
        assert!(after < 1e-6 * before, "{after} of {before}");
        // The declared model's own innovation is as before.
        assert_eq!(bank.newest().declared, declared);
    }

    #[test]
    fn whatever_begins_anew_settles_again() {
        let rig = rig();
        let rows = rows(&rig, 0.0, 600);
        let mut bank = ObserverBank::new(&rig, &rig.axes[0], STEP_S).unwrap();
        let settled = |bank: &mut ObserverBank, rows: &[Row]| {
            for row in rows {
                bank.take(row);
            }
            bank.newest().settled
        };
        let enough = AVERAGED * SETTLING_ROWS as usize + 10;
        assert!(!settled(&mut bank, &rows[..enough - 20]));
        assert!(settled(&mut bank, &rows[enough - 20..enough]));
        // A position beyond reason: the model has diverged from it.
        let far = Row { master_rad: 1e4, ..rows[enough] };
        assert_eq!(bank.take(&far), None);
        assert!(!settled(&mut bank, &rows[enough..enough + 20]));
        assert!(settled(&mut bank, &rows[..enough]));
        bank.linearise(&[]);
        assert!(!settled(&mut bank, &rows[..20]));
    }
}
