//! Mains hum in the force channel.
//!
//! `F = sine · sin(2π f t) + cosine · cos(2π f t)` with `f` within 0.1 Hz of 50 or 60 Hz, the
//! tolerance of mains and sampling clock.
//!
//! Parameters: `sine`, `cosine` (N, N·m or V), a few tenths of a per cent to a few per cent of the
//! range; `frequency` `f` (Hz).
//!
//! In a residual: a spectral line at 50 or 60 Hz. A mechanical vibration at mains frequency cannot
//! be distinguished from it in one channel and is reported as hum. Confused with: periodic
//! disturbance.

use super::{Effect, Shape, Spacing, Term, waves};

pub(super) const EFFECT: Effect = Effect {
    id: "mains_hum",
    sites: &["sensor"],
    words: "mains frequency in the measured force (hum)",
    experiment: "the same record at rest with the motor's supply off: hum stays, a vibration of \
                 the machine does not",
    applies: |axis| axis.cut_off > 35.0,
    is_tone: true,
    terms: Term::sine_and_cosine,
    shapes: |axis| {
        let points = 2 * waves::points(0.2 * axis.seconds);
        vec![Shape {
            spacing: Spacing::Mains,
            ..Shape::by_steps("frequency", "Hz", (49.9, 60.1), points)
        }]
    },
    force: Some(|now, shapes, _, out| {
        (out[0], out[1]) = (std::f64::consts::TAU * shapes[0] * now.time).sin_cos()
    }),
    ..Effect::NONE
};
