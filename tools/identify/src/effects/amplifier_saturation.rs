//! An amplifier that clips.
//!
//! `f = clamp(F, ±limit)`: of the command `F` beyond the limit nothing arrives.
//!
//! Parameter: `limit` (N, N·m or V), 30 to 98 % of the largest command of the records; one above it
//! does not act.
//!
//! In a residual: nothing at all but for the highest commands, where the motion lags what was asked
//! for. Confused with: load-dependent friction, a command channel at its own rail.

use super::{Axis, Effect, InverseEffect, Shape, Term, View};

pub(super) struct AmplifierSaturation;

impl Effect for AmplifierSaturation {
    fn id(&self) -> &'static str {
        "amplifier_saturation"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["drive"]
    }
    fn words(&self) -> &'static str {
        "an amplifier that clips"
    }
    fn experiment(&self) -> &'static str {
        "steps of the command up to its limit with the current measured"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for AmplifierSaturation {
    fn applies(&self, axis: &Axis) -> bool {
        axis.commanded
    }
    fn terms(&self, _: &Axis) -> Vec<Term> {
        vec![Term::given()]
    }
    fn shapes(&self, axis: &Axis) -> Vec<Shape> {
        vec![Shape::by_factors(
            "limit",
            axis.units.force,
            (0.3 * axis.force_peak, 0.98 * axis.force_peak),
            12,
        )]
    }
    fn columns(&self, view: &View<'_>, shapes: &[f64]) -> Vec<Vec<f64>> {
        vec![view.signals.force.iter().map(|f| f - f.clamp(-shapes[0], shapes[0])).collect()]
    }
    fn deliver(&self, command: &[f64], _: f64, _: &[f64], shapes: &[f64]) -> Option<Vec<f64>> {
        Some(command.iter().map(|f| f.clamp(-shapes[0], shapes[0])).collect())
    }
}
