//! Mains frequency in the channel of the force.
//!
//! `F = sine · sin(2π f t) + cosine · cos(2π f t)` with `f` within 0.1 Hz of 50 or 60 Hz: what
//! grids and sampling clocks differ.
//!
//! Parameters: `sine`, `cosine` (N, N·m or V), some thousandths of the range to some per cent;
//! `frequency` `f` (Hz).
//!
//! In a residual: a line in its spectrum at 50 or 60 Hz. A real vibration at mains frequency cannot
//! be told from it in one channel and is taken for hum. Confused with: periodic disturbance.

use super::{Axis, Effect, Instant, InverseEffect, Law, Shape, Spacing, Term, waves};

pub(super) struct MainsHum;

impl Effect for MainsHum {
    fn id(&self) -> &'static str {
        "mains_hum"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["sensor"]
    }
    fn words(&self) -> &'static str {
        "mains frequency in the measured force (hum)"
    }
    fn experiment(&self) -> &'static str {
        "the same record at rest with the motor's supply off: hum stays, a vibration of the \
         machine does not"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for MainsHum {
    fn applies(&self, axis: &Axis) -> bool {
        axis.cut_off > 35.0
    }
    fn is_tone(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::free("sine", axis.units.force), Term::free("cosine", axis.units.force)]
    }
    fn shapes(&self, axis: &Axis) -> Vec<Shape> {
        let points = 2 * waves::points(0.2 * axis.seconds);
        vec![Shape {
            spacing: Spacing::Mains,
            ..Shape::by_steps("frequency", "Hz", (49.9, 60.1), points)
        }]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for MainsHum {
    fn force(&self, now: &Instant, shapes: &[f64], _: &[f64], out: &mut [f64]) {
        (out[0], out[1]) = (std::f64::consts::TAU * shapes[0] * now.time).sin_cos();
    }
}
