//! `viscous_friction`: friction proportional to speed.
//!
//! `τ_f = b q̇`.

use super::{Effect, Moment, SideLoad, Site, effect};

effect! {
    /// Friction proportional to speed.
    pub struct ViscousFriction {
        /// Coefficient `b`.
        coefficient: "N m s/rad (N s/m)", 0.0, 1e5, 0.05, "assumed";
    }
}

impl Effect for ViscousFriction {
    fn id(&self) -> &'static str {
        "viscous_friction"
    }

    fn site(&self) -> Site {
        self.site
    }

    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        load.load.viscous_forward += self.coefficient;
        load.load.viscous_backward += self.coefficient;
    }
}
