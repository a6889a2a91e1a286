//! `periodic_disturbance`: a vibration of fixed frequency.
//!
//! `τ += a sin(2π f t + φ)`: the scanner's gradients shake the table.

use super::{Effect, Moment, SideLoad, effect};

effect! {
    "periodic_disturbance": "a vibration of fixed frequency";
    at Slave = 0.2 "N m", Master = 0.2 "N m";
    /// A vibration.
    pub struct PeriodicDisturbance {
        /// Amplitude `a`.
        amplitude: "N m (N)", 0.0, 1e3, 0.2, "assumed";
        /// Frequency `f`.
        frequency_hz: "Hz", 0.01, 900.0, 11.0, "assumed: echo-planar slices per second";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.0, "assumed";
    }
}

impl Effect for PeriodicDisturbance {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let angle = std::f64::consts::TAU * self.frequency_hz * moment.time_s + self.phase;
        load.load.force += self.amplitude * angle.sin();
    }
}
