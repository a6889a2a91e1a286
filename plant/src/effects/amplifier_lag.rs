//! `amplifier_lag`: a first-order lag in the amplifier.
//!
//! `T v̇ + v = v_in`, exact for held volts.

use super::search::SearchRange;
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
