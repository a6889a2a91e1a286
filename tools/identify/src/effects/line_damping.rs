//! Damping in the line beyond the declared tolerance.
//!
//! `F = d v` with `d` outside of what is declared, where a spring stands beside it (Kelvin-Voigt).
//!
//! Parameter: `damping_beyond_declared` (N·s/m or N·m·s/rad), fitted less declared; either sign,
//! the sum at least 0.
//!
//! In a residual: a straight line over the velocity; loops over the position that grow with
//! frequency. Confused with: a relaxing branch faster than the record, viscous friction, dead time.

use super::{Axis, Declared, Effect, InverseEffect, Term, View};

pub(super) struct LineDamping;

impl Effect for LineDamping {
    fn id(&self) -> &'static str {
        "line_damping"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["line"]
    }
    fn words(&self) -> &'static str {
        "damping in the line beyond the declared tolerance"
    }
    fn experiment(&self) -> &'static str {
        "sines of the same amplitude at frequencies spaced by factors of two: the loop of a \
         damper grows with frequency, that of a \
         relaxing branch has a largest one, that of friction stays"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for LineDamping {
    fn lifts(&self) -> Option<Declared> {
        Some(Declared::Viscous)
    }
    fn applies(&self, axis: &Axis) -> bool {
        axis.spring
    }
    fn linear(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::positive("damping_beyond_declared", axis.units.damping)]
    }
    fn columns(&self, view: &View<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![view.signals.velocity.clone()]
    }
}
