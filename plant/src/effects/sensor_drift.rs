//! `sensor_drift`: an offset of the torque cell that drifts.
//!
//! `τ → τ + d t`, `t` since the start.

use super::{Effect, Moment, Reading, effect};

effect! {
    "sensor_drift": "a torque cell whose zero wanders";
    at Sensor = 0.01 "N m/s";
    /// An offset that drifts.
    pub struct SensorDrift {
        /// Drift `d`.
        rate: "N m/s", -10.0, 10.0, 0.01, "assumed";
    }
    search {
        space: |of| {
            of.sizes(of.either("rate", 20.0), &[0.3]).signed().only_if(of.features.torque)
        },
    }
}

impl Effect for SensorDrift {
    fn sense(&mut self, reading: &mut Reading, moment: &Moment) {
        reading.slave_torque_nm += self.rate * moment.time_s;
    }
}
