//! `sensor_gain`: a gain error of the torque cell.
//!
//! `τ → (1 + g) τ`.

use super::search::SearchRange;
use super::{Effect, Moment, Reading, effect};

effect! {
    "sensor_gain": "a torque cell whose scale is off";
    at Sensor = 0.1 "1";
    /// A gain error.
    pub struct SensorGain {
        /// Relative error `g`.
        error: "1", -0.99, 10.0, 0.1, "assumed";
    }
    search {
        // Only a hand reveals a factor.
        space: |of| of
            .sizes(SearchRange::linear("error", -0.8, 2.0), &[1.0])
            .signed()
            .only_if(of.features.torque && of.features.hand),
    }
}

impl Effect for SensorGain {
    fn sense(&mut self, reading: &mut Reading, _moment: &Moment) {
        reading.slave_torque_nm *= 1.0 + self.error;
    }
}
