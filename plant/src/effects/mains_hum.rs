//! `mains_hum`: hum at mains frequency in the torque channel.
//!
//! `τ → τ + a sin(2π f t + φ)`.

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
}

impl Effect for MainsHum {
    fn sense(&mut self, reading: &mut Reading, moment: &Moment) {
        let angle = std::f64::consts::TAU * self.frequency_hz * moment.time_s + self.phase;
        reading.slave_torque_nm += self.amplitude * angle.sin();
    }
}
