//! A vibration of fixed frequency.
//!
//! `F = sine · sin(2π f t) + cosine · cos(2π f t)`: the scanner's gradients shake the table, a pump
//! runs beside.
//!
//! Parameters: `sine`, `cosine` (N, N·m or V); `frequency` `f` (Hz), from two periods in the record
//! to a little above the low-pass, without 0.15 Hz to either side of 50 and 60 Hz, where a tone is
//! taken for mains hum.
//!
//! In a residual: one line in its spectrum, whatever the movement does. Confused with: mains hum,
//! torque ripple at constant speed, a movement that repeats itself at the same frequency.

use super::{Axis, Effect, Instant, InverseEffect, Law, Shape, Term, waves};

pub(super) struct PeriodicDisturbance;

impl Effect for PeriodicDisturbance {
    fn id(&self) -> &'static str {
        "periodic_disturbance"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["slave", "master"]
    }
    fn words(&self) -> &'static str {
        "a vibration of fixed frequency"
    }
    fn experiment(&self) -> &'static str {
        "the same record with the machine at rest, and with the suspected source switched off"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for PeriodicDisturbance {
    fn is_tone(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::free("sine", axis.units.force), Term::free("cosine", axis.units.force)]
    }
    fn shapes(&self, axis: &Axis) -> Vec<Shape> {
        let range = (2.0 / axis.seconds, 1.1 * axis.cut_off);
        vec![Shape::by_steps(
            "frequency",
            "Hz",
            range,
            waves::points((range.1 - range.0) * axis.seconds),
        )]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for PeriodicDisturbance {
    fn force(&self, now: &Instant, shapes: &[f64], _: &[f64], out: &mut [f64]) {
        let frequency = waves::beside_mains(shapes[0]);
        (out[0], out[1]) = (std::f64::consts::TAU * frequency * now.time).sin_cos();
    }
}
