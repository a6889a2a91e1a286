//! A centre of mass off the axis of rotation.
//!
//! `τ = sine · sin q + cosine · cos q`; `√(sine² + cosine²) = m g l`. Source: pendulum.
//!
//! Parameters: `sine`, `cosine` (N·m); 0.2 kg at 0.1 m makes 0.2 N·m. Rotary axes that turn by 0.3
//! rad or more.
//!
//! In a residual: plotted over the position, one wave per turn, equal in both directions. Confused
//! with: a spring (over a small angle), an offset, torque ripple of low order.

use super::{Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "gravity_imbalance",
    sites: &["master", "slave"],
    words: "a centre of mass off the axis (gravity)",
    experiment: "the same slow stroke with the axis turned by 90°, or upright: gravity follows, a \
                 spring does not",
    applies: |axis| axis.rotary && axis.travel() > 0.3,
    terms: Term::sine_and_cosine,
    force: Some(|now, _, _, out| (out[0], out[1]) = now.position.sin_cos()),
    beside_functions: true,
    ..Effect::NONE
};
