//! `viscous_friction`: friction proportional to speed.
//!
//! `τ_f = b q̇`.

use super::{Effect, Moment, SideLoad, effect};
use crate::friction::{FrictionLaw, Viscous};

effect! {
    "viscous_friction": "friction proportional to speed";
    at Master = 0.05 "N m s/rad", Slave = 0.05 "N m s/rad";
    /// Friction proportional to speed.
    pub struct ViscousFriction {
        /// Coefficient `b`.
        coefficient: "N m s/rad (N s/m)", 0.0, 1e5, 0.05, "assumed";
    }
    search {
        space: |of| of.sizes(of.up_to("coefficient", 20.0), &[0.3, 1.0]),
    }
}

impl Effect for ViscousFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        Viscous { coefficient: self.coefficient }.contribute(&mut load.load, &at);
    }
}
