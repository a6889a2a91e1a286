//! `viscous`: proportional to speed.

use super::{FrictionLaw, Load, OperatingPoint};
use crate::parameter::parameter_set;

parameter_set! {
    /// Friction proportional to speed: `τ_f = b q̇`.
    #[derive(Copy, PartialEq)]
    pub struct Viscous {
        /// Coefficient `b`.
        coefficient: "N m s/rad (N s/m)", 0.0, 1e5, 3.5e-4, "§ 3.2.1: the motor's slope";
    }
}

impl FrictionLaw for Viscous {
    fn contribute(&mut self, load: &mut Load, _at: &OperatingPoint) {
        load.viscous_forward += self.coefficient;
        load.viscous_backward += self.coefficient;
    }
}
