//! `load_dependent_friction`: friction that grows with the transmitted torque.
//!
//! `τ_f += μ |τ_line| sgn(q̇)`: seals pressed by the fluid, bearings by the belt; the law of
//! [`crate::friction::LoadDependent`] without its saturation.

use super::search::SearchRange;
use super::{Effect, Moment, SideLoad, effect};
use crate::friction::{FrictionLaw, LoadDependent};

effect! {
    "load_dependent_friction": "friction that grows with the transmitted torque";
    at Master = 0.1 "1", Slave = 0.1 "1";
    /// Friction that grows with load.
    pub struct LoadDependentFriction {
        /// Friction per transmitted torque `μ`.
        coefficient: "1", 0.0, 0.9, 0.1, "assumed";
    }
    search {
        space: |of| {
            of.sizes(SearchRange::linear("coefficient", 0.0, 0.9), &[0.3, 1.0, 2.0])
        },
    }
}

impl Effect for LoadDependentFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        let mut law = LoadDependent { coefficient: self.coefficient, saturation: f64::INFINITY };
        law.contribute(&mut load.load, &at);
    }
}
