//! `sensor_offset`: an offset of the torque cell.
//!
//! `τ → τ + o`.

use super::{Effect, Moment, Reading, effect};

effect! {
    "sensor_offset": "a torque cell whose zero is off";
    at Sensor = 0.1 "N m";
    /// A constant offset.
    pub struct SensorOffset {
        /// Offset `o`.
        offset: "N m", -1e3, 1e3, 0.1, "assumed";
    }
    search {
        space: |of| {
            of.sizes(of.either("offset", 20.0), &[1.0]).signed().only_if(of.features.torque)
        },
    }
}

impl Effect for SensorOffset {
    fn sense(&mut self, reading: &mut Reading, _moment: &Moment) {
        reading.slave_torque_nm += self.offset;
    }
}
