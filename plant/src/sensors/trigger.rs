//! The scanner's trigger: one pulse per volume.

use crate::parameter::parameter_set;
use crate::{ParameterError, ParameterSet};

parameter_set! {
    /// The trigger output of an MR scanner as a voltage over time, without jitter.
    ///
    /// The thesis's programs wait while the line reads more than 2.0 V (appendix, `tg.s90 > 2.0`):
    /// it idles high and a pulse pulls it low. For a scanner with positive pulses, swap the two
    /// levels.
    #[derive(Copy, PartialEq)]
    pub struct ScannerTrigger {
        /// Repetition time TR: from the start of one volume to that of the next.
        repetition_s: "s", 1e-3, 60.0, 2.0, "assumed: usual in fMRI";
        /// Length of the pulse.
        pulse_s: "s", 1e-6, 60.0, 0.01, "assumed: long enough for 500 Hz sampling";
        /// Start of the first pulse.
        start_s: "s", 0.0, 1e9, 0.0, "choice";
        /// Number of volumes, an integer; 0 for unlimited.
        volumes: "1", 0.0, 1e9, 0.0, "choice";
        /// Voltage between pulses.
        idle_v: "V", -10.0, 10.0, 5.0, "appendix: above 2.0 V while waiting";
        /// Voltage during a pulse.
        pulse_v: "V", -10.0, 10.0, 0.0, "appendix: not above 2.0 V";
    }
}

/// Tolerance for a time just before an edge, s: sums of steps are not exact.
pub(super) const EDGE_S: f64 = 1e-9;

impl ScannerTrigger {
    /// Checks the ranges, and that a pulse ends before the next one starts.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`].
    pub fn checked(self) -> Result<Self, ParameterError> {
        self.check()?;
        if self.pulse_s < self.repetition_s {
            return Ok(self);
        }
        let (minimum, maximum) = (1e-6, self.repetition_s);
        Err(ParameterError::OutOfRange {
            name: "pulse_s",
            value: self.pulse_s,
            minimum,
            maximum,
            unit: "s",
        })
    }

    /// Index of the volume being scanned, from 0; `None` before the first and after the last.
    pub fn volume(&self, time_s: f64) -> Option<u64> {
        let since = time_s - self.start_s + EDGE_S;
        if since.is_nan() || since < 0.0 {
            return None;
        }
        let volume = (since / self.repetition_s).floor();
        (self.volumes == 0.0 || volume < self.volumes).then_some(volume as u64)
    }

    /// Whether a pulse is active; its start is included, its end is not.
    pub fn pulse(&self, time_s: f64) -> bool {
        self.volume(time_s).is_some_and(|volume| {
            time_s - (self.start_s + volume as f64 * self.repetition_s) + EDGE_S < self.pulse_s
        })
    }

    /// Voltage of the line, V.
    pub fn volts(&self, time_s: f64) -> f64 {
        if self.pulse(time_s) { self.pulse_v } else { self.idle_v }
    }
}
