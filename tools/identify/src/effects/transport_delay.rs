//! Dead time between the force and the motion.
//!
//! `F(t) = f(t + delay)`, `f` the force that the motion asks for: a positive delay is a motion that
//! comes late after the recorded force (dead time of amplifier, network or position sensor), a
//! negative one a force channel that comes late.
//!
//! Parameter: `delay` (s), within one period of the low-pass's cut-off to either side; 0.1 to 20
//! ms.
//!
//! In a residual: error in proportion to the rate of the force. Confused with: a lag of the
//! amplifier (the same in first order), damping beside a spring, channels that were not sampled at
//! the same instant. Below one and a half sampling periods it gets no name: a command that is
//! sampled and held acts half a period late by itself, and one more where the loop computes in
//! between.

use super::{Axis, Effect, InverseEffect, Shape, Term, View, waves};
use crate::input::step_of;

/// The experiment that tells a lag from dead time.
pub(super) const LAG_OR_DEAD_TIME: &str = "steps of the command with the current measured: a lag \
    begins at once, dead time does not; or sines up to \
     the bandwidth: a lag loses amplitude, dead time only phase";

pub(super) struct TransportDelay;

impl Effect for TransportDelay {
    fn id(&self) -> &'static str {
        "transport_delay"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["drive", "line", "sensor"]
    }
    fn words(&self) -> &'static str {
        "dead time between force and motion"
    }
    fn experiment(&self) -> &'static str {
        LAG_OR_DEAD_TIME
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for TransportDelay {
    fn uses_model(&self) -> bool {
        true
    }
    fn linear(&self) -> bool {
        true
    }
    fn shift(&self, _: &[f64], shapes: &[f64]) -> Option<f64> {
        shapes.first().copied()
    }
    fn terms(&self, _: &Axis) -> Vec<Term> {
        vec![Term::given()]
    }
    fn shapes(&self, axis: &Axis) -> Vec<Shape> {
        let longest = 1.0 / axis.cut_off;
        vec![Shape::by_steps("delay", "s", (-longest, longest), 20)]
    }
    fn columns(&self, view: &View<'_>, shapes: &[f64]) -> Vec<Vec<f64>> {
        let step = step_of(&view.signals.time).unwrap_or(1.0);
        let late = waves::shifted(view.model, shapes[0] / step);
        vec![late.iter().zip(view.model).map(|(late, now)| late - now).collect()]
    }
    fn deliver(&self, command: &[f64], step: f64, _: &[f64], shapes: &[f64]) -> Option<Vec<f64>> {
        Some(waves::shifted(command, -shapes[0] / step))
    }
}
