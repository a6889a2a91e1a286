//! Dead time between the force and the motion.
//!
//! `F(t) = f(t + delay)`, where `f` is the force that the model predicts from the motion: for a
//! positive delay the motion lags the recorded force (dead time of amplifier, network or position
//! sensor), for a negative one the force channel lags.
//!
//! Parameter: `delay` (s), any sign, at most one period of the cut-off frequency; 0.1 to 20 ms.
//!
//! In a residual: an error proportional to the rate of the force. Confused with: a lag of the
//! amplifier (equal to first order), damping in parallel with a spring, channels that were not
//! sampled at the same instant. Below one and a half sampling periods it is not reported:
//! zero-order hold of the command alone delays it by half a period, and computing time in the loop
//! by one more.

use super::{Axis, Effect, Regressor, Shape, Term, View, waves};
use crate::input::step_of;

/// The experiment that distinguishes a lag from dead time.
pub(super) const LAG_OR_DEAD_TIME: &str = "steps of the command with the current measured: a lag \
                                           begins at once, dead time does not; or sines up to the \
                                           bandwidth: a lag loses amplitude, dead time only phase";

pub(super) const EFFECT: Effect = Effect {
    id: "transport_delay",
    sites: &["drive", "line", "sensor"],
    words: "dead time between force and motion",
    experiment: LAG_OR_DEAD_TIME,
    regressor: &TransportDelay,
};

struct TransportDelay;

impl Regressor for TransportDelay {
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
