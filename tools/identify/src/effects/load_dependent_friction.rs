//! Friction that grows with the force that passes.
//!
//! `F = coefficient · |f| · sign(v)`, `f` the force that the rest of the model asks for: bearings
//! pressed by the belt, seals pressed by the fluid. `f` comes from the motion, not from the
//! measured force, whose noise would explain itself.
//!
//! Parameter: `coefficient` (1), 0 to 0.9; 0.01 in ball bearings, 0.1 to 0.3 at dry seals.
//!
//! In a residual: over the force, a V in one direction and its mirror image in the other; nothing
//! where no load passes. Confused with: Coulomb friction (constant load), a wrong scale of the
//! force.

use super::{Axis, Effect, InverseEffect, Term, View};

pub(super) struct LoadDependentFriction;

impl Effect for LoadDependentFriction {
    fn id(&self) -> &'static str {
        "load_dependent_friction"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["slave", "master"]
    }
    fn words(&self) -> &'static str {
        "friction that grows with the load"
    }
    fn experiment(&self) -> &'static str {
        "the same strokes with two different known loads: Coulomb friction stays, load-dependent \
         friction grows in proportion"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for LoadDependentFriction {
    fn uses_sign(&self) -> bool {
        true
    }
    fn uses_model(&self) -> bool {
        true
    }
    fn terms(&self, _: &Axis) -> Vec<Term> {
        vec![Term { bound: (0.0, 0.9), ..Term::positive("coefficient", "1") }]
    }
    fn columns(&self, view: &View<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![view.model.iter().zip(view.sign).map(|(f, s)| f.abs() * s).collect()]
    }
}
