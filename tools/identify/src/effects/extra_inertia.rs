//! Mass or inertia beyond the declared tolerance.
//!
//! `F = m a` with `m` outside of what is declared: missing physics that acts like a changed
//! parameter. Inside the tolerance the same change is calibration, and no effect. A part tested by
//! itself for which no mass is declared has none.
//!
//! Parameter: `mass_beyond_declared` (kg or kg·m²), fitted less declared; either sign, the sum at
//! least 0.
//!
//! In a residual: a straight line over the acceleration. Confused with: a wrong scale of the force,
//! dead time beside a spring.

use super::{Axis, Declared, Effect, InverseEffect, Term, View};

pub(super) struct ExtraInertia;

impl Effect for ExtraInertia {
    fn id(&self) -> &'static str {
        "extra_inertia"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["master", "slave"]
    }
    fn words(&self) -> &'static str {
        "mass beyond the declared tolerance"
    }
    fn experiment(&self) -> &'static str {
        "quick reversals with and without a known mass clamped on: the known mass gives the scale \
         of force"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for ExtraInertia {
    fn lifts(&self) -> Option<Declared> {
        Some(Declared::Mass)
    }
    fn linear(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::positive("mass_beyond_declared", axis.units.mass)]
    }
    fn columns(&self, view: &View<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![view.signals.acceleration.clone()]
    }
}
