//! Backlash: a gap in which no force is transmitted.
//!
//! `F = -stiffness_lost · clamp(x - centre, ±gap/2)` beside the declared `k x`, with
//! `stiffness_lost` near `k`: inside the gap there is no spring force, outside it the force starts
//! from the edge of the gap. Source: Nordin and Gutman, Automatica 38 (2002), dead zone model.
//!
//! Parameters: `gap` (m or rad), 0.5 to 60 % of the travel; `centre` (m or rad), within the travel;
//! `stiffness_lost` (N/m or N·m/rad), at least 0, near the stiffness for a real gap.
//!
//! In a residual: plotted over the position, a flat part between two kinks, without a loop.
//! Confused with: a stiffening spring (no kinks), presliding hysteresis (a loop).

use super::{Effect, Shape, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "backlash",
    sites: &["line", "master", "slave"],
    words: "backlash",
    experiment: "very slow load and unload through zero force, with the position read finely: the \
                 flat part is the gap",
    applies: |axis| axis.spring,
    terms: |axis| vec![Term::positive("stiffness_lost", axis.units.stiffness)],
    shapes: |axis| {
        let (low, travel) = (axis.positions.0, axis.travel());
        vec![
            Shape::by_factors("gap", axis.units.position, (0.005 * travel, 0.6 * travel), 8),
            Shape::by_steps(
                "centre",
                axis.units.position,
                (low + 0.1 * travel, low + 0.9 * travel),
                17,
            ),
        ]
    },
    force: Some(|now, shapes, _, out| {
        let half = 0.5 * shapes[0];
        out[0] = -(now.position - shapes[1]).clamp(-half, half);
    }),
    ..Effect::NONE
};
