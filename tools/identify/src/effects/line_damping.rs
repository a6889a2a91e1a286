//! Damping in the line beyond the declared tolerance.
//!
//! `F = d v` with `d` outside the declared range, in parallel with a spring (Kelvin-Voigt).
//!
//! Parameter: `damping_beyond_declared` (N·s/m or N·m·s/rad), fitted less declared; any sign; the
//! sum is at least 0.
//!
//! In a residual: plotted over the velocity, a straight line; plotted over the position, loops that
//! widen with frequency. Confused with: a relaxing branch faster than the movement, viscous
//! friction, dead time.

use super::{Declared, Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "line_damping",
    sites: &["line"],
    words: "damping in the line beyond the declared tolerance",
    experiment: "sines of the same amplitude at frequencies spaced by factors of two: the loop of \
                 a damper grows with frequency, that of a relaxing branch has a largest one, that \
                 of friction stays",
    lifts: Some(Declared::Viscous),
    applies: |axis| axis.spring,
    linear: true,
    terms: |axis| vec![Term::positive("damping_beyond_declared", axis.units.damping)],
    columns: Some(|view, _| vec![view.signals.velocity.clone()]),
    ..Effect::NONE
};
