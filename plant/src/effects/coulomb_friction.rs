//! `coulomb_friction`: dry friction beyond the declared.
//!
//! `τ_f = c sgn(q̇)`, up to `c` at rest.

use super::search::MultiStart;
use super::{Effect, Moment, SideLoad, effect};
use crate::friction::{Coulomb, FrictionLaw};

effect! {
    "coulomb_friction": "constant friction beyond the declared";
    at Master = 0.3 "N m", Slave = 0.3 "N m";
    /// Constant friction.
    pub struct CoulombFriction {
        /// Friction.
        level: "N m (N)", 0.0, 1e4, 0.3, "assumed";
    }
    search {
        space: |of| of
            .sizes(of.up_to("level", 10.0), &[0.3, 1.0, 3.0])
            .multi_start(MultiStart::WhenLocalised),
    }
}

impl Effect for CoulombFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        Coulomb { level: self.level }.contribute(&mut load.load, &at);
    }
}
