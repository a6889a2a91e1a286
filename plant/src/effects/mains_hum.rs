//! `mains_hum`: hum at mains frequency in the torque channel.
//!
//! `τ → τ + a sin(2π f t + φ)`.

use super::search::{SearchRange, pairs};
use super::{Effect, Moment, Reading, effect};

effect! {
    "mains_hum": "mains frequency in the torque channel";
    at Sensor = 0.05 "N m";
    /// Mains frequency in the torque channel.
    pub struct MainsHum {
        /// Amplitude `a`.
        amplitude: "N m", 0.0, 100.0, 0.05, "assumed";
        /// Frequency `f`.
        frequency_hz: "Hz", 1.0, 1000.0, 50.0, "Europe";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.0, "assumed";
    }
    search {
        space: |of| of
            .space(
                [SearchRange::frequency("frequency_hz", 15.0, 124.0)],
                pairs(("amplitude", &[of.size]), ("frequency_hz", &of.features.hum_hz)),
            )
            .phasor("amplitude", 20.0 * of.size)
            .only_if(of.features.torque),
    }
}

impl Effect for MainsHum {
    fn sense(&mut self, reading: &mut Reading, moment: &Moment) {
        let angle = std::f64::consts::TAU * self.frequency_hz * moment.time_s + self.phase;
        reading.slave_torque_nm += self.amplitude * angle.sin();
    }
}
