//! Friction that varies along the stroke.
//!
//! `F = sign(v) · (sine · sin(n x) + cosine · cos(n x))` beside Coulomb friction: a bent spindle,
//! an eccentric pulley, seals in a bore that is not straight. Source: first harmonic of any
//! variation; the thesis, ch. 4 and fig. 5.5.
//!
//! Parameters: `sine`, `cosine` (N or N·m), together below the Coulomb friction; `order` `n` (rad
//! per m, or waves per turn), 0.4 to 12 waves over the travel.
//!
//! In a residual: plotted over the position, a wave in one direction and its mirror image in the
//! other. Confused with: torque ripple and gravity (the same sign both ways), drift where the
//! stroke is made once.

use super::{Axis, Effect, Instant, InverseEffect, Law, Shape, Term};

pub(super) struct PositionDependentFriction;

impl Effect for PositionDependentFriction {
    fn id(&self) -> &'static str {
        "position_dependent_friction"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["master", "slave"]
    }
    fn words(&self) -> &'static str {
        "friction that varies along the stroke"
    }
    fn experiment(&self) -> &'static str {
        "the whole stroke at one slow constant speed, both ways, several times: half the \
         difference of the two directions over the \
         position is the friction"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for PositionDependentFriction {
    fn needs(&self) -> &'static [&'static str] {
        &["coulomb_friction"]
    }
    fn uses_sign(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::free("sine", axis.units.force), Term::free("cosine", axis.units.force)]
    }
    fn shapes(&self, axis: &Axis) -> Vec<Shape> {
        let wave = std::f64::consts::TAU / axis.travel();
        vec![Shape::by_steps(
            "order",
            format!("rad/{}", axis.units.position),
            (0.4 * wave, 12.0 * wave),
            59,
        )]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for PositionDependentFriction {
    fn force(&self, now: &Instant, shapes: &[f64], _: &[f64], out: &mut [f64]) {
        let (sine, cosine) = (shapes[0] * now.position).sin_cos();
        (out[0], out[1]) = (now.sign * sine, now.sign * cosine);
    }
}
