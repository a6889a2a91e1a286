//! Effects by the site at which they act.

use super::Parameters;
use crate::ParameterError;
use crate::effects::{Effect, LineConstants, Site};

/// Effects by site.
#[derive(Clone, Debug, Default)]
pub(super) struct Sited {
    pub(super) drive: Vec<Box<dyn Effect>>,
    pub(super) master: Vec<Box<dyn Effect>>,
    pub(super) line: Vec<Box<dyn Effect>>,
    pub(super) slave: Vec<Box<dyn Effect>>,
    pub(super) sensor: Vec<Box<dyn Effect>>,
    /// Inertia that they add to master and slave, kg·m².
    pub(super) extra_inertia: [f64; 2],
    /// By how much the cables may grow stiffer.
    pub(super) stiffness_factor: f64,
    /// Fastest rate that they bring along, rad/s.
    pub(super) rate_rad_s: f64,
}

impl Sited {
    /// Lets all effects change the constants, then prepares and sorts them.
    pub(super) fn install(effects: Vec<Box<dyn Effect>>, parameters: &mut Parameters) -> Result<Self, ParameterError> {
        // All changes of constants first, so that no effect prepares from half-changed ones.
        for effect in &effects {
            effect.check()?;
            if !effect.applies(parameters) {
                let (id, site) = (effect.id(), effect.site().name());
                return Err(ParameterError::EffectNotApplicable { id, site, model: parameters.model() });
            }
            effect.modify(parameters);
        }
        let mut sited = Self { stiffness_factor: 1.0, ..Self::default() };
        for mut effect in effects {
            effect.prepare(parameters);
            let demand = effect.demand();
            sited.stiffness_factor *= demand.stiffness_factor.max(1.0);
            sited.rate_rad_s = sited.rate_rad_s.max(demand.rate_rad_s);
            match effect.site() {
                Site::Drive => sited.drive.push(effect),
                Site::Master => {
                    sited.extra_inertia[0] += effect.extra_inertia();
                    sited.master.push(effect);
                }
                Site::Line => sited.line.push(effect),
                Site::Slave => {
                    sited.extra_inertia[1] += effect.extra_inertia();
                    sited.slave.push(effect);
                }
                Site::Sensor => sited.sensor.push(effect),
            }
        }
        Ok(sited)
    }
}
