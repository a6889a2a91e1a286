//! `coulomb`: the same at any speed.

use super::{FrictionLaw, Load, OperatingPoint};
use crate::parameter::parameter_set;

parameter_set! {
    /// Dry friction that does not depend on speed: `τ_f = c sgn(q̇)`, up to `c` at rest.
    #[derive(Copy, PartialEq)]
    pub struct Coulomb {
        /// Magnitude `c`.
        level: "N m (N)", 0.0, 1e4, 0.767, "§ 3.2.1: the motor's constant part";
    }
}

impl FrictionLaw for Coulomb {
    fn contribute(&mut self, load: &mut Load, _at: &OperatingPoint) {
        load.dry.add(self.level, self.level);
    }
}
