//! Saturation of the amplifier.
//!
//! `f = clamp(F, ±limit)`: the part of the command `F` beyond the limit is lost.
//!
//! Parameter: `limit` (N, N·m or V), searched from 30 to 98 % of the largest command of the
//! records.
//!
//! In a residual: an error only at the highest commands, where the force falls short. Confused
//! with: load-dependent friction, a command channel that clips.

use super::{Axis, Effect, Regressor, Shape, Term, View};

pub(super) const EFFECT: Effect = Effect {
    id: "amplifier_saturation",
    sites: &["drive"],
    words: "an amplifier that clips",
    experiment: "steps of the command up to its limit with the current measured",
    regressor: &AmplifierSaturation,
};

struct AmplifierSaturation;

impl Regressor for AmplifierSaturation {
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
