//! Compliance in series beyond the declared tolerance.
//!
//! `F = k x` with `k` outside of what is declared: hose bulging, belts, a clamp that gives way (or
//! one that stiffens). A spring in series with the declared one acts as a smaller stiffness: `1/k =
//! 1/k_declared + compliance`.
//!
//! Parameter: `stiffness_beyond_declared` (N/m or N·m/rad), fitted less declared; negative where
//! compliance is added.
//!
//! In a residual: a straight line over the position. Confused with: a wrong scale of force or
//! position, a relaxing branch in records slower or faster than its relaxation.

use super::{Axis, Declared, Effect, InverseEffect, Term, View};

pub(super) struct LineCompliance;

impl Effect for LineCompliance {
    fn id(&self) -> &'static str {
        "line_compliance"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["line"]
    }
    fn words(&self) -> &'static str {
        "compliance in series (a stiffness outside of its declared tolerance)"
    }
    fn experiment(&self) -> &'static str {
        "slow load and unload in steps, with the position measured on both sides of each clamp: \
         what gives way is the compliance"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for LineCompliance {
    fn lifts(&self) -> Option<Declared> {
        Some(Declared::Stiffness)
    }
    fn applies(&self, axis: &Axis) -> bool {
        axis.spring
    }
    fn linear(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::free("stiffness_beyond_declared", axis.units.stiffness)]
    }
    fn columns(&self, view: &View<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![view.signals.position.clone()]
    }
}
