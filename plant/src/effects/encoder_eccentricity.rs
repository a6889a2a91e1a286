//! `encoder_eccentricity`: an encoder disc that does not run true.
//!
//! `q → q + a sin(n q + φ)` on the slave's encoder, or on the master's (for a drive: its position)
//! where `on_master` is 1; once (`n = 1`) or twice a turn.

use super::search::{Choice, pairs};
use super::{Effect, Moment, Reading, effect};

effect! {
    "encoder_eccentricity": "an encoder disc that does not run true";
    at Sensor = 0.01 "rad";
    /// A disc that does not run true.
    pub struct EncoderEccentricity {
        /// Amplitude `a`.
        amplitude: "rad (m)", 0.0, 1.0, 0.01, "assumed";
        /// Waves per turn `n`.
        order: "1", 1.0, 1000.0, 1.0, "assumed";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.0, "assumed";
        /// 1 for the master's encoder, 0 for the slave's.
        on_master: "1", 0.0, 1.0, 0.0, "choice";
    }
    search {
        space: |of| {
            let at = |on_master: f64| {
                let mut starts = pairs(("amplitude", &[0.5 * of.size]), ("order", &[1.0, 2.0]));
                starts.iter_mut().for_each(|values| values.push(("on_master", on_master)));
                starts
            };
            of.space([], [0.0, 1.0].map(at).concat()).phasor("amplitude", 10.0 * of.size)
        },
        // Small movements cannot tell the encoders apart.
        choice: Some(Choice {
            parameter: "on_master",
            other: "the same effect of the other encoder",
        }),
    }
}

impl Effect for EncoderEccentricity {
    fn sense(&mut self, reading: &mut Reading, _moment: &Moment) {
        let position =
            if self.on_master > 0.5 { &mut reading.master_rad } else { &mut reading.slave_rad };
        *position += self.amplitude * (self.order * *position + self.phase).sin();
    }
}
