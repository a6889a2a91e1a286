//! `load_dependent_friction`: friction that grows with the transmitted torque.
//!
//! `τ_f += μ |τ_line| sgn(q̇)`: seals pressed by the fluid, bearings by the belt.

use super::{Effect, Moment, SideLoad, Site, effect};

effect! {
    /// Friction that grows with load.
    pub struct LoadDependentFriction {
        /// Friction per transmitted torque `μ`.
        coefficient: "1", 0.0, 0.9, 0.1, "assumed";
    }
}

impl Effect for LoadDependentFriction {
    fn id(&self) -> &'static str {
        "load_dependent_friction"
    }

    fn site(&self) -> Site {
        self.site
    }

    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        let level = self.coefficient * load.transmitted_nm.abs();
        load.load.dry.add(level, level);
    }
}
