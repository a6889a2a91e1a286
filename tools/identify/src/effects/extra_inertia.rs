//! Mass or inertia beyond the declared tolerance.

use super::{Declared, Effect, InverseEffect, Term, Units};
use crate::inverse::signals::Signals;

/// The declared mass lies outside of its tolerance: missing physics that acts like a changed parameter.
/// Inside the tolerance the same change is calibration, and no effect.
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
        "quick reversals with and without a known mass clamped on: the known mass gives the scale of force"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for ExtraInertia {
    fn lifts(&self) -> Option<Declared> {
        Some(Declared::Mass)
    }
    fn terms(&self, units: &Units) -> Vec<Term> {
        let bound = (f64::NEG_INFINITY, f64::INFINITY);
        vec![Term { name: "mass_beyond_declared".into(), unit: units.mass.into(), bound }]
    }
    fn columns(&self, _: &Signals, _: &[f64], _: &[f64]) -> Vec<Vec<f64>> {
        Vec::new()
    }
}
