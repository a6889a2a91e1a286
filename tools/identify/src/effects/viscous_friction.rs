//! Viscous friction beyond the declared tolerance.
//!
//! `F = c v` with `c` outside of what is declared: missing physics that acts like a changed
//! parameter. Inside the tolerance the same change is calibration, and no effect.
//!
//! Parameter: `viscous_beyond_declared` (N·s/m or N·m·s/rad), fitted less declared; either sign,
//! the sum at least 0.
//!
//! In a residual: a straight line over the velocity. Confused with: quadratic drag, a hand's
//! damper, damping in the line.

use super::{Axis, Declared, Effect, InverseEffect, Term, View};

pub(super) struct ViscousFriction;

impl Effect for ViscousFriction {
    fn id(&self) -> &'static str {
        "viscous_friction"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["master", "slave"]
    }
    fn words(&self) -> &'static str {
        "viscous friction beyond the declared tolerance"
    }
    fn experiment(&self) -> &'static str {
        "strokes at several constant speeds, both ways: the slope of force over speed is the \
         viscous friction"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for ViscousFriction {
    fn lifts(&self) -> Option<Declared> {
        Some(Declared::Viscous)
    }
    fn linear(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::positive("viscous_beyond_declared", axis.units.damping)]
    }
    fn columns(&self, view: &View<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![view.signals.velocity.clone()]
    }
}
