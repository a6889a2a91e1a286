//! First-order lag of the amplifier.
//!
//! `T ḟ + f = F`, as of a current loop. A force `f` requires the command `F = f + T ḟ`; `ḟ` is
//! computed from the motion, not from the command.
//!
//! Parameter: `time_constant` `T` (s), at least 0; 0.1 ms in a fast current loop, 5 ms in a slow
//! one.
//!
//! In a residual: an error proportional to the rate of the force, largest at fast reversals.
//! Confused with: dead time (equal to first order; below one and a half sampling periods neither is
//! reported), mass or damping outside its tolerance.

use super::transport_delay::LAG_OR_DEAD_TIME;
use super::{Effect, Term};
use crate::filter::derivatives;
use crate::input::step_of;

pub(super) const EFFECT: Effect = Effect {
    id: "amplifier_lag",
    sites: &["drive"],
    words: "an amplifier that follows late (lag)",
    experiment: LAG_OR_DEAD_TIME,
    applies: |axis| axis.commanded,
    uses_model: true,
    linear: true,
    shift: |amplitudes, _| amplitudes.first().copied(),
    terms: |_| vec![Term::positive("time_constant", "s")],
    columns: Some(|view, _| {
        vec![derivatives(view.model, step_of(&view.signals.time).unwrap_or(1.0)).0]
    }),
    deliver: Some(|command, step, amplitudes, _| {
        let share = step / amplitudes[0].max(1e-9 * step);
        let kept = (-share).exp();
        let mut before = command.first().copied().unwrap_or(0.0);
        let mut state = before;
        let follow = |f: &f64| {
            // Exact for a command that is linear between samples.
            let slope = (f - before) / share;
            state = f - slope + (state - before + slope) * kept;
            before = *f;
            state
        };
        command.iter().map(follow).collect()
    }),
    ..Effect::NONE
};
