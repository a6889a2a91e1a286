//! Effects approximated by changed constants, for control laws that are computed from constants
//! alone.

use crate::any::Parameters;
use crate::effects::{Effect, Site};
use crate::{ParameterError, ParameterSet};

impl Parameters {
    /// Adds to the constants what an effect changes of the line's compliance and damping, of
    /// inertia, and of dry and viscous friction. Whatever else the effect does is left out.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`] where a sum is beyond what the model allows.
    pub fn absorb(&mut self, effect: &dyn Effect) -> Result<(), ParameterError> {
        let size = |id: &str, name: &str| {
            if effect.id() == id { effect.get(name).unwrap_or_default() } else { 0.0 }
        };
        let inertia = effect.extra_inertia();
        let (dry, viscous) =
            (size("coulomb_friction", "level"), size("viscous_friction", "coefficient"));
        let parts: Vec<(&str, f64)> = match (effect.site(), &*self) {
            (Site::Master, _) => vec![
                ("motor_inertia_kg_m2", inertia),
                ("motor_coulomb_nm", dry),
                ("motor_viscous_nm_s", viscous),
            ],
            // The rising slope counts from the corner speed.
            (Site::Slave, Self::Hydrostatic(own)) => vec![
                ("slave_handle_inertia_kg_m2", inertia),
                ("slave_static_friction_nm", dry),
                ("slave_kinetic_friction_nm", dry + viscous * own.slave_corner_speed_rad_s),
                ("slave_falling_slope_nm_s", -viscous),
                ("slave_rising_slope_nm_s", viscous),
            ],
            (Site::Slave, Self::Cable(_)) => {
                vec![("slave_inertia_kg_m2", inertia), ("slave_bearing_nm", dry)]
            }
            _ => Vec::new(),
        };
        match self {
            Self::Hydrostatic(own) => effect.modify(own),
            Self::Cable(own) => effect.modify(own),
        }
        for (name, part) in parts.into_iter().filter(|(_, part)| *part != 0.0) {
            self.set(name, self.get(name).unwrap_or_default() + part)?;
        }
        Ok(())
    }
}
