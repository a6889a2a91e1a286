//! An amplifier that follows late.
//!
//! `T ḟ + f = F`: a first-order lag of the current loop. A wanted force `f` costs the command `F =
//! f + T ḟ`; `ḟ` comes from the motion, not from the command.
//!
//! Parameter: `time_constant` `T` (s), at least 0; 0.1 ms in a good current loop, 5 ms in a slow
//! one.
//!
//! In a residual: error in proportion to the rate of the force, largest at quick reversals.
//! Confused with: dead time (the same in first order; below one and a half sampling periods neither
//! gets a name), a mass or damping outside of its tolerance.

use super::transport_delay::LAG_OR_DEAD_TIME;
use super::{Axis, Effect, InverseEffect, Term, View};
use crate::filter::derivatives;
use crate::input::step_of;

pub(super) struct AmplifierLag;

impl Effect for AmplifierLag {
    fn id(&self) -> &'static str {
        "amplifier_lag"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["drive"]
    }
    fn words(&self) -> &'static str {
        "an amplifier that follows late (lag)"
    }
    fn experiment(&self) -> &'static str {
        LAG_OR_DEAD_TIME
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for AmplifierLag {
    fn applies(&self, axis: &Axis) -> bool {
        axis.commanded
    }
    fn uses_model(&self) -> bool {
        true
    }
    fn linear(&self) -> bool {
        true
    }
    fn shift(&self, amplitudes: &[f64], _: &[f64]) -> Option<f64> {
        amplitudes.first().copied()
    }
    fn terms(&self, _: &Axis) -> Vec<Term> {
        vec![Term::positive("time_constant", "s")]
    }
    fn columns(&self, view: &View<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![derivatives(view.model, step_of(&view.signals.time).unwrap_or(1.0)).0]
    }
    fn deliver(
        &self,
        command: &[f64],
        step: f64,
        amplitudes: &[f64],
        _: &[f64],
    ) -> Option<Vec<f64>> {
        let share = step / amplitudes[0].max(1e-9 * step);
        let kept = (-share).exp();
        let mut before = command.first().copied().unwrap_or(0.0);
        let mut state = before;
        let follow = |f: &f64| {
            // Exact for a command that goes straight from sample to sample.
            let slope = (f - before) / share;
            state = f - slope + (state - before + slope) * kept;
            before = *f;
            state
        };
        Some(command.iter().map(follow).collect())
    }
}
