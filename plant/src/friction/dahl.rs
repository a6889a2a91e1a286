//! `dahl`: friction that builds up over a small travel.

use super::{Bristle, FrictionLaw, Load, OperatingPoint};
use crate::parameter::parameter_set;

parameter_set! {
    /// Dahl's law: `dF/dq = σ (1 - F sgn(q̇) / F_c)`: an elastic bristle that yields toward `F_c`.
    ///
    /// From rest `F = F_c (1 - exp(-σ q / F_c))`. It does not depend on speed, has no breakaway
    /// above the kinetic level and no exact stick: a constant force below `F_c` ends at a
    /// deflection, one that also shakes creeps on (Dupont, Hayward, Armstrong, Altpeter, IEEE TAC
    /// 47, 2002). Dahl's exponent is 1 here.
    pub struct Dahl {
        /// Level `F_c`.
        level: "N m (N)", 1e-9, 1e4, 0.95, "§ 5.2.2, at the motor";
        /// Stiffness at rest `σ`.
        stiffness: "N m/rad (N/m)", 1e-6, 1e9, 50.0, "assumed: the level within 1 degree";
    }
    state {
        bristle: Bristle = Bristle::default();
    }
}

impl Dahl {
    /// The law with its bristle upright.
    pub fn new(level: f64, stiffness: f64) -> Self {
        Self { level, stiffness, ..Self::default() }
    }

    /// Deflection of the bristle, rad (m).
    pub fn deflection(&self) -> f64 {
        self.bristle.deflection()
    }
}

impl FrictionLaw for Dahl {
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint) {
        self.bristle.contribute(load, self.stiffness, 0.0, self.level, at);
    }

    fn settle(&mut self, displacement: f64, _step: f64) {
        self.bristle.settle(displacement);
    }

    fn reset(&mut self) {
        self.bristle = Bristle::default();
    }

    fn stored_j(&self) -> f64 {
        self.bristle.stored_j()
    }
}
