//! `sensor_crosstalk`: coupling of the motor's volts into the torque channel.
//!
//! `τ → τ + k v_motor`.

use super::{Effect, Moment, Reading, effect};

effect! {
    "sensor_crosstalk": "motor volts in the torque channel";
    at Sensor = 0.05 "N m/V";
    /// Motor volts in the torque channel.
    pub struct SensorCrosstalk {
        /// Coupling `k`.
        coupling: "N m/V", -10.0, 10.0, 0.05, "assumed";
    }
    search {
        space: |of| {
            of.sizes(of.either("coupling", 20.0), &[1.0]).signed().only_if(of.features.torque)
        },
    }
}

impl Effect for SensorCrosstalk {
    fn sense(&mut self, reading: &mut Reading, _moment: &Moment) {
        reading.slave_torque_nm += self.coupling * reading.motor_v;
    }
}
