//! `sensor_crosstalk`: motor volts that couple into the torque channel.
//!
//! `τ → τ + k v_motor`.

use super::{Effect, Moment, Reading, Site, effect};

effect! {
    /// Motor volts in the torque channel.
    pub struct SensorCrosstalk {
        /// Coupling `k`.
        coupling: "N m/V", -10.0, 10.0, 0.05, "assumed";
    }
}

impl Effect for SensorCrosstalk {
    fn id(&self) -> &'static str {
        "sensor_crosstalk"
    }

    fn site(&self) -> Site {
        self.site
    }

    fn sense(&mut self, reading: &mut Reading, _moment: &Moment) {
        reading.slave_torque_nm += self.coupling * reading.motor_v;
    }
}
