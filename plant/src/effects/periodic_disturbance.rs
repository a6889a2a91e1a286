//! `periodic_disturbance`: a vibration of fixed frequency.
//!
//! `τ += a sin(2π f t + φ)`: the scanner's gradients shake the table.

use super::search::{SearchRange, pairs};
use super::{Effect, Moment, SideLoad, Site, effect};

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
    search {
        space: |of| {
            let lines = &of.features.lines_hz[usize::from(of.site == Site::Slave)];
            of.space(
                [SearchRange::frequency("frequency_hz", 0.3, 120.0)],
                pairs(("amplitude", &[0.3 * of.size]), ("frequency_hz", lines)),
            )
            .phasor("amplitude", 10.0 * of.size)
        },
    }
}

impl Effect for PeriodicDisturbance {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let angle = std::f64::consts::TAU * self.frequency_hz * moment.time_s + self.phase;
        load.load.force += self.amplitude * angle.sin();
    }
}
