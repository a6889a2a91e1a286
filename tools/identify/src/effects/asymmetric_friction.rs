//! Friction that differs by direction.
//!
//! With `c₊, c₋` the viscous and `F₊, F₋` the Coulomb terms of the two directions, friction is
//!
//! `F = (c₊+c₋)/2 · v + (c₊-c₋)/2 · |v| + (F₊+F₋)/2 · sign v + (F₊-F₋)/2 · |sign v|`.
//!
//! The first and third terms are the symmetric model. The last one is 1 wherever the machine moves,
//! as is the column of the offset: the two differ only during standstill, where static friction
//! hides the force anyway. So the difference of the Coulomb terms goes into the fitted offset,
//! cannot be told from it, and has no column here. What remains is the viscous part. Source: Janot,
//! Gautier, Brunot 2019 (EMPS), direction-dependent friction.
//!
//! Parameter: `viscous_difference = (c₊-c₋)/2` (N·s/m or N·m·s/rad), either sign, positive where
//! the positive direction is the stiffer one; up to the viscous friction itself.
//!
//! In a residual: a V over the velocity. Confused with: an offset, where the speed is the same in
//! both directions; quadratic drag that acts in one direction only.

use super::{Axis, Effect, Instant, InverseEffect, Law, Term};

pub(super) struct AsymmetricFriction;

impl Effect for AsymmetricFriction {
    fn id(&self) -> &'static str {
        "asymmetric_friction"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["master", "slave"]
    }
    fn words(&self) -> &'static str {
        "friction that differs by direction"
    }
    fn experiment(&self) -> &'static str {
        "strokes both ways at several constant speeds, and the force at rest with the motor free: \
         the slopes give \
         the viscous difference, and the force at rest parts the Coulomb difference from the offset"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for AsymmetricFriction {
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::free("viscous_difference", axis.units.damping)]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for AsymmetricFriction {
    fn force(&self, now: &Instant, _: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = now.velocity.abs();
    }
}
