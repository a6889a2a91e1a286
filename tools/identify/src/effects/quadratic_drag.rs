//! Drag that grows with the square of speed.
//!
//! `F = coefficient · |v| v`: turbulent flow through ports and bends, air. Source: Borda-Carnot;
//! Merritt, Hydraulic Control Systems (1967), ch. 3.
//!
//! Parameter: `coefficient` (N·s²/m² or N·m·s²/rad²), at least 0; at the highest speed, from a few
//! per cent to the whole of the viscous friction.
//!
//! In a residual: plotted over the velocity, an S that is steeper at both ends. Confused with:
//! viscous friction (over a narrow range of speed), negative Stribeck friction.

use super::{Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "quadratic_drag",
    sites: &["master", "slave"],
    words: "drag that grows with the square of speed",
    experiment: "constant speeds up to the highest that the drive can hold, both ways: drag \
                 quadruples when speed doubles",
    terms: |axis| {
        vec![Term::positive(
            "coefficient",
            format!("{}·({})⁻²", axis.units.force, axis.units.velocity),
        )]
    },
    force: Some(|now, _, _, out| out[0] = now.velocity.abs() * now.velocity),
    ..Effect::NONE
};
