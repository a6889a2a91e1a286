//! Effects approximated by changed constants, for control laws that are computed from constants
//! alone.

use crate::ParameterError;
use crate::effects::{Effect, Site};
use crate::transmission_kinds::Parameters;

impl Parameters {
    /// Changes the parameters as an effect changes the line's compliance and damping, the
    /// inertia, and dry and viscous friction. Whatever else the effect does is left out.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`] where a sum is beyond what the model allows.
    pub fn absorb(&mut self, effect: &dyn Effect) -> Result<(), ParameterError> {
        let inertia = effect.extra_inertia();
        let (dry, viscous) = effect.extra_friction();
        let parts = match effect.site() {
            Site::Master => vec![
                ("motor_inertia_kg_m2", inertia),
                ("motor_coulomb_nm", dry),
                ("motor_viscous_nm_s", viscous),
            ],
            Site::Slave => {
                let mut parts = self.slave_friction_parameters(dry, viscous);
                parts.push((self.handle_inertia(), inertia));
                parts
            }
            _ => Vec::new(),
        };
        self.modify(effect);
        for (name, part) in parts.into_iter().filter(|(_, part)| *part != 0.0) {
            self.add(name, part)?;
        }
        Ok(())
    }
}
