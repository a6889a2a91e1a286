//! Drag that grows with the square of speed.
//!
//! `F = coefficient · |v| v`: turbulent flow through ports and bends, air. Source: Borda-Carnot;
//! Merritt, Hydraulic Control Systems (1967), ch. 3.
//!
//! Parameter: `coefficient` (N·s²/m² or N·m·s²/rad²), at least 0; at the highest speed it makes
//! some per cent to all of the viscous friction.
//!
//! In a residual: an S over the velocity that bends away from the straight line at both ends.
//! Confused with: viscous friction (over a narrow range of speed), Stribeck friction of negative
//! sign.

use super::{Axis, Effect, Instant, InverseEffect, Law, Term};

pub(super) struct QuadraticDrag;

impl Effect for QuadraticDrag {
    fn id(&self) -> &'static str {
        "quadratic_drag"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["master", "slave"]
    }
    fn words(&self) -> &'static str {
        "drag that grows with the square of speed"
    }
    fn experiment(&self) -> &'static str {
        "constant speeds up to the highest that the drive can hold, both ways: drag quadruples \
         when speed doubles"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for QuadraticDrag {
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::positive(
            "coefficient",
            format!("{}·({})⁻²", axis.units.force, axis.units.velocity),
        )]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for QuadraticDrag {
    fn force(&self, now: &Instant, _: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = now.velocity.abs() * now.velocity;
    }
}
