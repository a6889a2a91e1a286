//! `sensor_drift`: a torque cell whose zero wanders.
//!
//! `τ → τ + d t`, `t` since the start.

use super::{Effect, Moment, Reading, Site, effect};

effect! {
    /// A zero that wanders.
    pub struct SensorDrift {
        /// Drift `d`.
        rate: "N m/s", -10.0, 10.0, 0.01, "assumed";
    }
}

impl Effect for SensorDrift {
    fn id(&self) -> &'static str {
        "sensor_drift"
    }

    fn site(&self) -> Site {
        self.site
    }

    fn sense(&mut self, reading: &mut Reading, moment: &Moment) {
        reading.slave_torque_nm += self.rate * moment.time_s;
    }
}
