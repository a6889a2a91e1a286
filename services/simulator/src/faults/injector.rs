//! Makes what the card needs to begin a fault, beside the loop: it allocates.

use plant::coupled_axes::Plant;
use plant::effects::{Effect, Entry, Site, breakdowns};
use rig::RigFile;

use super::active::Injection;
use super::fault::Fault;
use crate::machine::{CardError, plant_with};

/// A breakdown of the machine, which stays in it: what it has left behind outlasts its end.
#[derive(Clone, Copy, Debug)]
struct MachineFault {
    number: u64,
    axis: usize,
    entry: &'static Entry,
    site: Site,
    size: f64,
}

/// Knows the machine of a card: rig file, effects, and what has broken in it so far.
#[derive(Clone, Debug)]
pub struct FaultInjector {
    rig: RigFile,
    effects: Vec<String>,
    broken: Vec<MachineFault>,
    numbers: u64,
}

impl FaultInjector {
    /// For a card with the machine of a rig file with effects (`ID[@SITE][=SIZE]`).
    pub fn new(rig: &RigFile, effects: &[String]) -> Self {
        Self { rig: rig.clone(), effects: effects.to_vec(), broken: Vec::new(), numbers: 0 }
    }

    /// The rig file.
    pub const fn rig(&self) -> &RigFile {
        &self.rig
    }

    /// Effects of the machine, beside those of the rig file.
    pub fn effects(&self) -> &[String] {
        &self.effects
    }

    /// The machine with other effects, for [`crate::Card::replace_plant`].
    ///
    /// # Errors
    /// As [`crate::Card::new`]; the effects are as before then.
    pub fn change_effects(&mut self, effects: Vec<String>) -> Result<Plant, CardError> {
        let plant = self.plant(&effects)?;
        self.effects = effects;
        Ok(plant)
    }

    /// A fault for [`crate::Card::begin_fault`], with the machine that has it where it is one of
    /// the machine.
    ///
    /// # Errors
    /// As [`crate::Card::new`].
    pub fn prepare(&mut self, fault: &Fault) -> Result<(Injection, Option<Plant>), CardError> {
        let number = self.numbers + 1;
        let plant = match fault.kind.action.breakdown() {
            None => None,
            Some(entry) => {
                let (site, size) = (fault.at.site(), fault.size);
                self.broken.push(MachineFault { number, axis: fault.axis, entry, site, size });
                let plant = self.plant(&self.effects);
                if plant.is_err() {
                    self.broken.pop();
                }
                Some(plant?)
            }
        };
        self.numbers = number;
        let Fault { axis, at, size, ticks, .. } = *fault;
        Ok((Injection { number, action: fault.kind.action, axis, at, size, ticks }, plant))
    }

    /// Forgets a fault that the card did not get.
    pub fn forget(&mut self, number: u64) {
        self.broken.retain(|broken| broken.number != number);
    }

    fn plant(&self, effects: &[String]) -> Result<Plant, CardError> {
        plant_with(&self.rig, effects, |axis| {
            let own = self.broken.iter().filter(|broken| broken.axis == axis);
            own.map(|it| breakdowns::make(it.entry, it.site, it.size, it.number))
                .collect::<Result<Vec<Box<dyn Effect>>, _>>()
        })
    }
}
