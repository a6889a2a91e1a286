//! `asymmetric_friction`: friction that differs by direction.
//!
//! Forward `+(a + a t |q̇|)`, backward `-(a + a t |q̇|)`, on top of the declared friction; the
//! total never falls below zero. Beside a declared offset only the viscous part is seen. The rig
//! has 0.9 N·m forward and 1.0 N·m backward (§ 5.2.2).

use super::search::{SearchRange, pairs};
use super::{Effect, Moment, SideLoad, effect};
use crate::friction::{Asymmetric, FrictionLaw};

effect! {
    "asymmetric_friction": "friction that differs by direction";
    at Master = 0.2 "N m", Slave = 0.2 "N m";
    /// Friction that differs by direction.
    pub struct AsymmetricFriction {
        /// Half the difference of the dry parts, positive for more forward.
        difference: "N m (N)", -1e4, 1e4, 0.2, "§ 5.2.2 has -0.05 at the motor";
        /// Viscous part per dry part `t`.
        viscous_time: "s/rad (s/m)", 0.0, 10.0, 0.1, "assumed";
    }
    search {
        space: |of| of
            .space(
                [of.either("difference", 6.0), SearchRange::linear("viscous_time", 0.0, 2.0)],
                pairs(("difference", &[0.5 * of.size]), ("viscous_time", &[0.0, 0.1, 0.5])),
            )
            .signed(),
    }
}

impl Effect for AsymmetricFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        let mut law = Asymmetric {
            level: 0.0,
            difference: self.difference,
            viscous: 0.0,
            viscous_difference: self.difference * self.viscous_time,
        };
        law.contribute(&mut load.load, &at);
    }
}
