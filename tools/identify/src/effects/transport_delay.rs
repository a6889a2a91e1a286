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

use super::{Effect, Shape, Term, waves};
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
    uses_model: true,
    linear: true,
    shift: |_, shapes| shapes.first().copied(),
    terms: |_| vec![Term::given()],
    shapes: |axis| {
        let longest = 1.0 / axis.cut_off;
        vec![Shape::by_steps("delay", "s", (-longest, longest), 20)]
    },
    columns: Some(|view, shapes| {
        let step = step_of(&view.signals.time).unwrap_or(1.0);
        let late = waves::shifted(view.model, shapes[0] / step);
        vec![late.iter().zip(view.model).map(|(late, now)| late - now).collect()]
    }),
    deliver: Some(|command, step, _, shapes| waves::shifted(command, -shapes[0] / step)),
    ..Effect::NONE
};
