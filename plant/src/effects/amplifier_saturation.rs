//! `amplifier_saturation`: an amplifier that clips.
//!
//! `v → clamp(v, -v_max, v_max)`.

use super::{Effect, Moment, effect};

effect! {
    "amplifier_saturation": "an amplifier that clips";
    at Drive = 2.0 "V";
    /// An amplifier that clips.
    pub struct AmplifierSaturation {
        /// Largest output `v_max`.
        limit: "V (N)", 1e-3, 1e4, 2.0, "assumed";
    }
}

impl Effect for AmplifierSaturation {
    fn amplifier(&mut self, volts: f64, _moment: &Moment) -> f64 {
        volts.clamp(-self.limit, self.limit)
    }
}
