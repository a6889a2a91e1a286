//! `amplifier_saturation`: an amplifier that clips.
//!
//! `v → clamp(v, -v_max, v_max)`.

use super::search::{SearchRange, each};
use super::{Effect, Moment, effect};

effect! {
    "amplifier_saturation": "an amplifier that clips";
    at Drive = 2.0 "V";
    /// An amplifier that clips.
    pub struct AmplifierSaturation {
        /// Largest output `v_max`.
        limit: "V (N)", 1e-3, 1e4, 2.0, "assumed";
    }
    search {
        space: |of| {
            let volts = of.features.volts;
            let starts = each("limit", &[0.45, 0.6, 0.75, 0.9].map(|share| share * volts));
            // The limit falls as the effect grows.
            of.space([SearchRange::linear("limit", 0.2 * volts, volts)], starts).with_sizes(0)
        },
    }
}

impl Effect for AmplifierSaturation {
    fn amplifier(&mut self, volts: f64, _moment: &Moment) -> f64 {
        volts.clamp(-self.limit, self.limit)
    }
}
