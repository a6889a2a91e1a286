//! What is simulated: the hydrostatic line with its constants, what was put into it, and how it is
//! moved.

use anyhow::Result;
use plant::effects::{self, Effect, Site};
use plant::hydrostatic::{Parameters, Plant};

use crate::simulated_response::Rig;

/// Amplitude of the master's sine where nothing else is said, degrees. The thesis prints none.
pub const NOMINAL_AMPLITUDE_DEG: f64 = 30.0;

/// Mean of the static friction measured at the motor in both directions, N·m (§ 5.2.2: 0.9 and
/// 1.0).
pub const MEASURED_FRICTION_NM: f64 = 0.95;

/// An effect by name, with its size and any further parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Added {
    /// Its name.
    pub id: &'static str,
    /// Where it acts.
    pub site: Site,
    /// Its size, in the unit of its first parameter.
    pub size: f64,
    /// Further parameters.
    pub more: Vec<(&'static str, f64)>,
}

impl Added {
    /// An effect whose further parameters are its defaults.
    pub const fn new(id: &'static str, site: Site, size: f64) -> Self {
        Self { id, site, size, more: Vec::new() }
    }
}

/// The hydrostatic line, ready to be moved.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Constants.
    pub parameters: Parameters,
    /// What was put in.
    pub effects: Vec<Added>,
    /// Amplitude of the master's sine, degrees.
    pub amplitude_deg: f64,
}

impl Line {
    /// As printed, moved at the nominal amplitude.
    pub fn printed() -> Self {
        Self {
            parameters: Parameters::printed(),
            effects: Vec::new(),
            amplitude_deg: NOMINAL_AMPLITUDE_DEG,
        }
    }

    /// The same with a line of `factor` times the stiffness (effect `line_compliance` of size
    /// `1/factor - 1`).
    #[must_use]
    pub fn softened(mut self, factor: f64) -> Self {
        self.parameters.line_stiffness_factor *= factor;
        self
    }

    /// The same with another bulk modulus: `factor` times the printed one.
    #[must_use]
    pub fn with_bulk_modulus(mut self, factor: f64) -> Self {
        self.parameters.bulk_modulus_pa *= factor;
        self
    }

    /// The same with an effect.
    #[must_use]
    pub fn with(mut self, effect: Added) -> Self {
        self.effects.push(effect);
        self
    }

    /// The same with all dry and viscous friction of motor, piston and slave times `factor`; the
    /// fluid's stays.
    #[must_use]
    pub fn with_friction(mut self, factor: f64) -> Self {
        let p = &mut self.parameters;
        for value in [
            &mut p.motor_coulomb_nm,
            &mut p.motor_viscous_nm_s,
            &mut p.master_piston_static_friction_n,
            &mut p.master_piston_falling_slope_n_s_per_m,
            &mut p.master_piston_kinetic_friction_n,
            &mut p.master_piston_rising_slope_n_s_per_m,
            &mut p.slave_static_friction_nm,
            &mut p.slave_falling_slope_nm_s,
            &mut p.slave_kinetic_friction_nm,
            &mut p.slave_rising_slope_nm_s,
        ] {
            *value *= factor;
        }
        self
    }

    /// The same, moved at another amplitude, degrees.
    #[must_use]
    pub fn at_amplitude(mut self, amplitude_deg: f64) -> Self {
        self.amplitude_deg = amplitude_deg;
        self
    }

    /// The same with another hose bore, m.
    #[must_use]
    pub fn with_diameter(mut self, diameter_m: f64) -> Self {
        self.parameters = self.parameters.with_hose_diameter(diameter_m);
        self
    }

    /// The same with another hose length, m. A dead time in the line is a travel time, and grows
    /// with it.
    #[must_use]
    pub fn with_length(mut self, length_m: f64) -> Self {
        let ratio = length_m / self.parameters.hose_length_m;
        for effect in &mut self.effects {
            if effect.id == "transport_delay" && effect.site == Site::Line {
                effect.size *= ratio;
            }
        }
        self.parameters = self.parameters.with_hose_length(length_m);
        self
    }
}

impl Rig for Line {
    type Plant = Plant;

    fn plant(&self) -> Result<Plant> {
        let mut made: Vec<Box<dyn Effect>> = Vec::new();
        for added in &self.effects {
            let mut effect = effects::make(added.id, added.site, added.size)?;
            for (name, value) in &added.more {
                effect.set(name, *value)?;
            }
            made.push(effect);
        }
        Ok(Plant::new(self.parameters.clone(), made)?)
    }

    fn amplitude_rad(&self) -> f64 {
        self.amplitude_deg.to_radians()
    }
}
