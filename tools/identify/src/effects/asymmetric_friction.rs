//! Friction that differs by direction.

use super::{Effect, InverseEffect, Term, Units};
use crate::inverse::signals::Signals;

/// Coulomb and viscous terms that differ by direction, beside a declared offset.
///
/// With `c₊, c₋` the viscous and `F₊, F₋` the Coulomb terms of the two directions, friction is
///
/// `F = (c₊+c₋)/2 · v + (c₊-c₋)/2 · |v| + (F₊+F₋)/2 · sign v + (F₊-F₋)/2 · |sign v|`.
///
/// The first and third terms are the symmetric model. The last one is 1 wherever the machine moves, as is the column of
/// the offset: the two differ only during standstill, where static friction hides the force anyway. So the
/// difference of the Coulomb terms goes into the fitted offset, cannot be told from it, and has no column here.
/// What remains is the viscous part, one parameter: `viscous_difference = (c₊-c₋)/2`, either sign,
/// positive where the positive direction is the stiffer one.
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
        "strokes both ways at several constant speeds, and the force at rest with the motor free: the slopes give \
         the viscous difference, and the force at rest parts the Coulomb difference from the offset"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for AsymmetricFriction {
    fn terms(&self, units: &Units) -> Vec<Term> {
        let bound = (f64::NEG_INFINITY, f64::INFINITY);
        vec![Term { name: "viscous_difference".into(), unit: units.damping.into(), bound }]
    }
    fn columns(&self, signals: &Signals, _: &[f64], _: &[f64]) -> Vec<Vec<f64>> {
        vec![signals.velocity.iter().map(|v| v.abs()).collect()]
    }
}
