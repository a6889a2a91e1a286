//! `torque_ripple`: torque that varies with the motor's angle.
//!
//! `τ += a sin(n q_m + φ)`: cogging; it is there without current.

use super::search::{SearchRange, pairs};
use super::{Effect, Moment, effect};

effect! {
    "torque_ripple": "torque that varies with the motor's angle (cogging)";
    at Drive = 0.1 "N m";
    /// Cogging.
    pub struct TorqueRipple {
        /// Amplitude `a`.
        amplitude: "N m (N)", 0.0, 1e3, 0.1, "assumed";
        /// Periods per turn `n` (per 2π m for a linear drive).
        order: "1", 1.0, 1e5, 6.0, "assumed: three pole pairs";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.0, "assumed";
    }
    search {
        space: |of| {
            let orders = [&of.features.orders[..], &[4.0, 5.0, 6.0, 7.0, 8.0]].concat();
            of.space(
                [SearchRange::spatial_frequency("order", 3.5, 200.0)],
                pairs(("amplitude", &[0.5 * of.size]), ("order", &orders)),
            )
            .phasor("amplitude", 10.0 * of.size)
        },
    }
}

impl Effect for TorqueRipple {
    fn motor(&mut self, torque_nm: f64, moment: &Moment) -> f64 {
        torque_nm + self.amplitude * (self.order * moment.master_position_rad + self.phase).sin()
    }
}
