//! A vibration at a fixed frequency.
//!
//! `F = sine · sin(2π f t) + cosine · cos(2π f t)`: gradients of the scanner shake the table, or a
//! pump runs nearby.
//!
//! Parameters: `sine`, `cosine` (N, N·m or V); `frequency` `f` (Hz), from two periods per record to
//! 1.1 times the cut-off frequency, except within 0.15 Hz of 50 and 60 Hz, where a tone counts as
//! mains hum.
//!
//! In a residual: one spectral line, independent of the movement. Confused with: mains hum, torque
//! ripple at constant speed, a periodic movement of the same frequency.

use super::{Effect, Shape, Term, waves};

pub(super) const EFFECT: Effect = Effect {
    id: "periodic_disturbance",
    sites: &["slave", "master"],
    words: "a vibration of fixed frequency",
    experiment: "the same record with the machine at rest, and with the suspected source switched \
                 off",
    is_tone: true,
    terms: Term::sine_and_cosine,
    shapes: |axis| {
        let range = (2.0 / axis.seconds, 1.1 * axis.cut_off);
        vec![Shape::by_steps(
            "frequency",
            "Hz",
            range,
            waves::points((range.1 - range.0) * axis.seconds),
        )]
    },
    force: Some(|now, shapes, _, out| {
        let frequency = waves::beside_mains(shapes[0]);
        (out[0], out[1]) = (std::f64::consts::TAU * frequency * now.time).sin_cos();
    }),
    ..Effect::NONE
};
