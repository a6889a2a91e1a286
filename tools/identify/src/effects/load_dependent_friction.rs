//! Friction that grows with the transmitted force.
//!
//! `F = coefficient · |f| · sign(v)`, where `f` is the force that the rest of the model predicts:
//! bearings loaded by the belt, seals loaded by the fluid. `f` is computed from the motion, not
//! measured, since noise of the measured force would explain itself.
//!
//! Parameter: `coefficient` (1), 0 to 0.9; 0.01 for ball bearings, 0.1 to 0.3 for dry seals.
//!
//! In a residual: plotted over the force, a V in one direction and its mirror image in the other;
//! nothing without load. Confused with: Coulomb friction (constant load), a wrong scale of the
//! force.

use super::{Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "load_dependent_friction",
    sites: &["slave", "master"],
    words: "friction that grows with the load",
    experiment: "the same strokes with two different known loads: Coulomb friction stays, \
                 load-dependent friction grows in proportion",
    uses_sign: true,
    uses_model: true,
    terms: |_| vec![Term { bound: (0.0, 0.9), ..Term::positive("coefficient", "1") }],
    columns: Some(|view, _| {
        vec![view.model.iter().zip(view.sign).map(|(f, s)| f.abs() * s).collect()]
    }),
    beside_functions: true,
    ..Effect::NONE
};
