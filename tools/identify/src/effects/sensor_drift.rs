//! A force channel whose zero wanders.
//!
//! `F → F + rate · t`, `t` since the start of the record. Source: bridge amplifiers warm up; data
//! sheets give some thousandths of the range per hour, bad cables far more.
//!
//! Parameter: `rate` (N/s, N·m/s or V/s), either sign.
//!
//! In a residual: a ramp over the time that does not care for the movement. Confused with: a slow
//! real force, thermal drift (which changes sign with the velocity), relaxation of an element that
//! is held.

use super::{Axis, Effect, Instant, InverseEffect, Law, Term};

pub(super) struct SensorDrift;

impl Effect for SensorDrift {
    fn id(&self) -> &'static str {
        "sensor_drift"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["sensor"]
    }
    fn words(&self) -> &'static str {
        "a zero of the force that wanders"
    }
    fn experiment(&self) -> &'static str {
        "the unloaded channel recorded for as long as the run, before and after it"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for SensorDrift {
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::free("rate", format!("{}/s", axis.units.force))]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for SensorDrift {
    fn force(&self, now: &Instant, _: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = now.time;
    }
}
