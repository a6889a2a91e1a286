//! `asymmetric_friction`: friction that differs by direction.
//!
//! Forward `+(a + a t |q̇|)`, backward `-(a + a t |q̇|)`, on top of the declared friction; the
//! total never falls below zero. Beside a declared offset only the viscous part is seen. The rig
//! has 0.9 N·m forward and 1.0 N·m backward (§ 5.2.2).
//!
//! # In a model of one channel
//!
//! Friction that differs by direction.
//!
//! With `c₊, c₋` the viscous and `F₊, F₋` the Coulomb terms of the two directions, friction is
//!
//! `F = (c₊+c₋)/2 · v + (c₊-c₋)/2 · |v| + (F₊+F₋)/2 · sign v + (F₊-F₋)/2 · |sign v|`.
//!
//! The first and third terms are the symmetric model. The last one is 1 wherever the machine moves,
//! as is the column of the offset: the two differ only at standstill, where the force is hidden by
//! static friction. The difference of the Coulomb terms can therefore not be distinguished from the
//! offset, is absorbed by it, and has no column here. What remains is the viscous part. Source:
//! Janot, Gautier, Brunot 2019 (EMPS), direction-dependent friction.
//!
//! Parameter: `viscous_difference = (c₊-c₋)/2` (N·s/m or N·m·s/rad), any sign, positive where
//! friction is higher in the positive direction; at most the viscous friction itself.
//!
//! In a residual: plotted over the velocity, a V. Confused with: an offset, where the speed is the
//! same in both directions; quadratic drag that acts in one direction only.

use super::one_channel::Term;
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
    one_channel {
        rank: 20,
        words: "friction that differs by direction",
        experiment: "strokes both ways at several constant speeds, and the force at rest with the \
                     motor free: the slopes give the viscous difference, and the force at rest \
                     parts the Coulomb difference from the offset",
        terms: |axis| vec![Term::free("viscous_difference", axis.units.damping)],
        force: Some(|now, _, _, out| out[0] = now.velocity.abs()),
        // The plant's viscous difference comes with a dry one, which the fit cannot distinguish
        // from the offset.
        of_plant: |_| None,
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
