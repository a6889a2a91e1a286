//! A spring that stiffens or softens.
//!
//! `F = cubic · x³ + quadratic · x²` beside the declared `k x`: the odd term acts alike both ways,
//! the even one makes one direction stiffer than the other (gas trapped in one line, fibres that
//! take load one after the other, a spring that was measured from another zero: a shift by `e`
//! makes `3 cubic e x²`). Source: Duffing 1918.
//!
//! Parameters: `cubic` (N/m³, N·m/rad³ or V⁻²), `quadratic` (N/m², N·m/rad² or V⁻¹), either sign;
//! at the largest deflection they add some per cent to several times the linear force.
//!
//! In a residual: over the position an S (odd) or a parabola (even), without a loop; in frequency,
//! energy at two and three times what was put in. Confused with: a compliance outside of its
//! tolerance, backlash.

use super::{Axis, Effect, Instant, InverseEffect, Law, Term};

pub(super) struct NonlinearStiffness;

impl Effect for NonlinearStiffness {
    fn id(&self) -> &'static str {
        "nonlinear_stiffness"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["line", "slave"]
    }
    fn words(&self) -> &'static str {
        "a spring that is not linear"
    }
    fn experiment(&self) -> &'static str {
        "slow load and unload in steps over the whole travel, both ways: the curve itself"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for NonlinearStiffness {
    fn applies(&self, axis: &Axis) -> bool {
        axis.spring
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        let unit = |power| format!("{}/{}{power}", axis.units.force, axis.units.position);
        vec![Term::free("cubic", unit("³")), Term::free("quadratic", unit("²"))]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for NonlinearStiffness {
    fn force(&self, now: &Instant, _: &[f64], _: &[f64], out: &mut [f64]) {
        let square = now.position * now.position;
        (out[0], out[1]) = (square * now.position, square);
    }
}
