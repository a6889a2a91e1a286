//! Stribeck friction: more of it near standstill.

use super::{Effect, InverseEffect, Shape, Speeds, Term, Units};
use crate::inverse::signals::Signals;

/// `F = stribeck · sign(v) · exp(-(v/stribeck_speed)²)`, at least 0, on top of Coulomb friction (without which a
/// high Stribeck speed would mimic it). Source of the form: Armstrong-Hélouvry, Dupont, Canudas de Wit,
/// Automatica 30 (1994), eq. 3.
pub(super) struct StribeckFriction;

impl Effect for StribeckFriction {
    fn id(&self) -> &'static str {
        "stribeck_friction"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["master", "slave"]
    }
    fn words(&self) -> &'static str {
        "friction that falls with speed near standstill (Stribeck)"
    }
    fn experiment(&self) -> &'static str {
        "constant speeds spaced by factors of two down to the slowest that the drive can hold, both ways"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for StribeckFriction {
    fn needs(&self) -> &'static [&'static str] {
        &["coulomb_friction"]
    }
    fn terms(&self, units: &Units) -> Vec<Term> {
        vec![Term { name: "stribeck".into(), unit: units.force.into(), bound: (0.0, f64::INFINITY) }]
    }
    fn shapes(&self, units: &Units, speeds: &Speeds) -> Vec<Shape> {
        // Above a third of the peak the bell is as wide as the record and acts as a changed viscous friction.
        let (low, high) = (0.01 * speeds.peak, 0.35 * speeds.peak);
        vec![Shape { name: "stribeck_speed".into(), unit: units.velocity.into(), low, high, points: 7 }]
    }
    fn columns(&self, signals: &Signals, sign: &[f64], shapes: &[f64]) -> Vec<Vec<f64>> {
        let speed = shapes.first().copied().unwrap_or(1.0);
        vec![signals.velocity.iter().zip(sign).map(|(v, s)| s * (-(v / speed).powi(2)).exp()).collect()]
    }
}
