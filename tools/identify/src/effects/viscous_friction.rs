//! Viscous friction beyond the declared tolerance.
//!
//! `F = c v` with `c` outside the declared range: missing physics that acts like a changed
//! parameter. Within the tolerance, such a change is calibration and not an effect.
//!
//! Parameter: `viscous_beyond_declared` (N·s/m or N·m·s/rad), fitted less declared; any sign; the
//! sum is at least 0.
//!
//! In a residual: plotted over the velocity, a straight line. Confused with: quadratic drag,
//! damping by a hand, damping in the line.

use super::{Declared, Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "viscous_friction",
    sites: &["master", "slave"],
    words: "viscous friction beyond the declared tolerance",
    experiment: "strokes at several constant speeds, both ways: the slope of force over speed is \
                 the viscous friction",
    lifts: Some(Declared::Viscous),
    linear: true,
    terms: |axis| vec![Term::positive("viscous_beyond_declared", axis.units.damping)],
    columns: Some(|view, _| vec![view.signals.velocity.clone()]),
    ..Effect::NONE
};
