//! Mass or inertia beyond the declared tolerance.
//!
//! `F = m a` with `m` outside the declared range: missing physics that acts like a changed
//! parameter. Within the tolerance, such a change is calibration and not an effect. Where no mass
//! is declared, as for a part tested by itself, the declared mass is 0.
//!
//! Parameter: `mass_beyond_declared` (kg or kg·m²), fitted less declared; any sign; the sum is at
//! least 0.
//!
//! In a residual: plotted over the acceleration, a straight line. Confused with: a wrong scale of
//! the force, dead time beside a spring.

use super::{Declared, Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "extra_inertia",
    sites: &["master", "slave"],
    words: "mass beyond the declared tolerance",
    experiment: "quick reversals with and without a known mass clamped on: the known mass gives \
                 the scale of force",
    lifts: Some(Declared::Mass),
    linear: true,
    terms: |axis| vec![Term::positive("mass_beyond_declared", axis.units.mass)],
    columns: Some(|view, _| vec![view.signals.acceleration.clone()]),
    beside_functions: true,
    ..Effect::NONE
};
