//! Saturation of the amplifier.
//!
//! `f = clamp(F, ±limit)`: the part of the command `F` beyond the limit is lost.
//!
//! Parameter: `limit` (N, N·m or V), searched from 2 to 98 % of the largest command of the
//! records: an integrating law winds up to several times the limit.
//!
//! In a residual: an error only at the highest commands, where the force falls short. Confused
//! with: load-dependent friction, a command channel that clips.

use super::{Effect, Shape, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "amplifier_saturation",
    sites: &["drive"],
    words: "an amplifier that clips",
    experiment: "steps of the command up to its limit with the current measured",
    applies: |axis| axis.commanded,
    terms: |_| vec![Term::given()],
    shapes: |axis| {
        vec![Shape::by_factors(
            "limit",
            axis.units.force,
            (0.02 * axis.force_peak, 0.98 * axis.force_peak),
            40,
        )]
    },
    columns: Some(|view, shapes| {
        vec![view.signals.force.iter().map(|f| f - f.clamp(-shapes[0], shapes[0])).collect()]
    }),
    deliver: Some(|command, _, _, shapes| {
        command.iter().map(|f| f.clamp(-shapes[0], shapes[0])).collect()
    }),
    ..Effect::NONE
};
