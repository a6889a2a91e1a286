//! `sensor_drift`: an offset of the torque cell that drifts.
//!
//! `τ → τ + d t`, `t` since the start.
//!
//! # In a model of one channel
//!
//! Zero drift of the force channel.
//!
//! `F → F + rate · t`, `t` since the start of the record. Source: warm-up of bridge amplifiers;
//! data sheets give a few tenths of a per cent of the range per hour, bad cables far more.
//!
//! Parameter: `rate` (N/s, N·m/s or V/s), any sign.
//!
//! In a residual: a ramp over time, independent of the movement. Confused with: a slow real force,
//! thermal drift of friction (which changes sign with the velocity), relaxation of an element that
//! is held.

use super::one_channel::Term;
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
    monitoring {
        sudden: false,
    }
    one_channel {
        rank: 230,
        words: "a zero of the force that wanders",
        experiment: "the unloaded channel recorded for as long as the run, before and after it",
        terms: |axis| vec![Term::free("rate", format!("{}/s", axis.units.force))],
        force: Some(|now, _, _, out| out[0] = now.time),
        // The plant's acts on the torque cell of a transmission.
        of_plant: |_| None,
    }
}

impl Effect for SensorDrift {
    fn sense(&mut self, reading: &mut Reading, moment: &Moment) {
        reading.slave_torque_nm += self.rate * moment.time_s;
    }
}
