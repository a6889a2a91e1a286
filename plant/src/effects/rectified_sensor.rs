//! `rectified_sensor`: a torque channel that loses its sign.
//!
//! `τ → (1 - r) τ + r |τ|`: 1 is a full rectifier (a reflected intensity on the wrong side of its
//! maximum).

use super::search::{SearchRange, each};
use super::{Effect, Moment, Reading, effect};

effect! {
    "rectified_sensor": "a torque channel that loses its sign";
    at Sensor = 0.5 "1";
    /// A channel that loses its sign.
    pub struct RectifiedSensor {
        /// Part that is rectified `r`.
        part: "1", 0.0, 1.0, 0.5, "assumed";
    }
    search {
        // Only a hand reveals a sign.
        space: |of| {
            let (parts, sizes): (&[f64], usize) = match of.features.rectified {
                // A fully rectified reading does not scale with the rectified share.
                true => (&[0.58, 0.66, 0.78, 0.95], 0),
                false => (&[0.1, 0.4], 1),
            };
            of.space([SearchRange::linear("part", 0.0, 1.0)], each("part", parts))
                .with_sizes(sizes)
                .only_if(of.features.torque && of.features.hand)
        },
    }
}

impl Effect for RectifiedSensor {
    fn sense(&mut self, reading: &mut Reading, _moment: &Moment) {
        reading.slave_torque_nm +=
            self.part * (reading.slave_torque_nm.abs() - reading.slave_torque_nm);
    }
}
