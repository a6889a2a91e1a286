//! Viscous friction beyond the declared tolerance.

use super::{Declared, Effect, InverseEffect, Term, Units};
use crate::inverse::signals::Signals;

/// The declared viscous friction lies outside of its tolerance: missing physics that acts like a changed parameter.
/// Inside the tolerance the same change is calibration, and no effect.
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
        "strokes at several constant speeds, both ways: the slope of force over speed is the viscous friction"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for ViscousFriction {
    fn lifts(&self) -> Option<Declared> {
        Some(Declared::Viscous)
    }
    fn terms(&self, units: &Units) -> Vec<Term> {
        let bound = (f64::NEG_INFINITY, f64::INFINITY);
        vec![Term { name: "viscous_beyond_declared".into(), unit: units.damping.into(), bound }]
    }
    fn columns(&self, _: &Signals, _: &[f64], _: &[f64]) -> Vec<Vec<f64>> {
        Vec::new()
    }
}
