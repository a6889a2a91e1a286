//! A centre of mass off the axis of rotation.
//!
//! `τ = sine · sin q + cosine · cos q`; `√(sine² + cosine²) = m g l`. Source: pendulum.
//!
//! Parameters: `sine`, `cosine` (N·m); 0.2 kg at 0.1 m makes 0.2 N·m. Rotary axes that turn by 0.3
//! rad or more.
//!
//! In a residual: one wave a turn over the position, the same both ways. Confused with: a spring
//! (over a small angle), an offset, torque ripple of low order.

use super::{Axis, Effect, Instant, InverseEffect, Law, Term};

pub(super) struct GravityImbalance;

impl Effect for GravityImbalance {
    fn id(&self) -> &'static str {
        "gravity_imbalance"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["master", "slave"]
    }
    fn words(&self) -> &'static str {
        "a centre of mass off the axis (gravity)"
    }
    fn experiment(&self) -> &'static str {
        "the same slow stroke with the axis turned by 90°, or upright: gravity follows, a spring \
         does not"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for GravityImbalance {
    fn applies(&self, axis: &Axis) -> bool {
        axis.rotary && axis.travel() > 0.3
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::free("sine", axis.units.force), Term::free("cosine", axis.units.force)]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for GravityImbalance {
    fn force(&self, now: &Instant, _: &[f64], _: &[f64], out: &mut [f64]) {
        (out[0], out[1]) = now.position.sin_cos();
    }
}
