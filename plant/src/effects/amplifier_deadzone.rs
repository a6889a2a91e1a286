//! `amplifier_deadzone`: an amplifier with a dead zone about 0 V.
//!
//! `v → v - clamp(v, -w, w)`.

use super::{Effect, Moment, effect};

effect! {
    "amplifier_deadzone": "an amplifier that does nothing for small volts";
    at Drive = 0.1 "V";
    /// An amplifier with a dead zone.
    pub struct AmplifierDeadzone {
        /// Half width `w`.
        half_width: "V (N)", 0.0, 1e4, 0.1, "assumed";
    }
    search {
        space: |of| of.sizes(of.up_to("half_width", 10.0), &[0.5, 1.5, 4.0]),
    }
}

impl Effect for AmplifierDeadzone {
    fn amplifier(&mut self, volts: f64, _moment: &Moment) -> f64 {
        volts - volts.clamp(-self.half_width, self.half_width)
    }
}
