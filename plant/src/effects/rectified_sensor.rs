//! `rectified_sensor`: a torque channel that loses its sign.
//!
//! `τ → (1 - r) τ + r |τ|`: 1 is a full rectifier (a reflected intensity on the wrong side of its
//! maximum).

use super::{Effect, Moment, Reading, effect};

effect! {
    "rectified_sensor": "a torque channel that loses its sign";
    at Sensor = 0.5 "1";
    /// A channel that loses its sign.
    pub struct RectifiedSensor {
        /// Part that is rectified `r`.
        part: "1", 0.0, 1.0, 0.5, "assumed";
    }
}

impl Effect for RectifiedSensor {
    fn sense(&mut self, reading: &mut Reading, _moment: &Moment) {
        reading.slave_torque_nm +=
            self.part * (reading.slave_torque_nm.abs() - reading.slave_torque_nm);
    }
}
