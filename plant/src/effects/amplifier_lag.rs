//! `amplifier_lag`: a first-order lag in the amplifier.
//!
//! `T v̇ + v = v_in`, exact for held volts.
//!
//! # In a model of one channel
//!
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

use super::one_channel::Term;
use super::one_channel::samples::{derivatives, step_of};
use super::search::SearchRange;
use super::transport_delay::LAG_OR_DEAD_TIME;
use super::{Effect, LineConstants, Moment, effect};

effect! {
    "amplifier_lag": "an amplifier that follows late";
    at Drive = 5e-3 "s";
    /// A first-order lag.
    pub struct AmplifierLag {
        /// Time constant `T`.
        time_constant: "s", 1e-6, 10.0, 5e-3, "assumed: current loop";
    }
    state {
        volts: f64 = 0.0;
    }
    search {
        space: |of| {
            of.sizes(SearchRange::logarithmic("time_constant", 2e-4, 0.1), &[0.3, 1.0, 3.0])
        },
    }
    one_channel {
        rank: 200,
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
        of_plant: |fit| fit.renamed(&[("time_constant", "time_constant")]),
    }
}

impl Effect for AmplifierLag {
    fn prepare(&mut self, _constants: &dyn LineConstants) {
        self.volts = 0.0;
    }

    fn amplifier(&mut self, volts: f64, moment: &Moment) -> f64 {
        // The value in the middle of the step, which is what the step uses; then on to its end.
        let half = (-0.5 * moment.step_s / self.time_constant).exp();
        let middle = volts + (self.volts - volts) * half;
        self.volts = volts + (middle - volts) * half;
        middle
    }
}
