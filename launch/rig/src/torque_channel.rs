//! The sensor of the torque that the hand applies.

use ipc_types::ANALOG;

use crate::axis_unit::{AxisUnit, KeyNames};
use crate::checked_toml::{Bounds, Keys, Section, bounds};

/// The sensor of the torque (or force) that the hand applies at the slave; positive torque drives
/// the slave in its positive direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueChannel {
    /// Analog input: index into `Sample::analog_v`.
    pub channel: usize,
    /// Sensitivity, with its sign (V/(N·m) or V/N).
    pub volts_per_unit: f64,
    /// Reading without torque (V).
    pub offset_v: f64,
    /// A reading that does not change by one bit for so long is a fault (s); `None` where it may
    /// stay the same for any time.
    pub stuck_time_s: Option<f64>,
}

impl TorqueChannel {
    /// Torque for a reading (N·m or N).
    pub fn torque(&self, volts: f64) -> f64 {
        (volts - self.offset_v) / self.volts_per_unit
    }

    /// Reading at a torque (V).
    pub fn volts(&self, torque: f64) -> f64 {
        torque * self.volts_per_unit + self.offset_v
    }
}

const SENSITIVITY: Bounds = bounds(-100.0, 100.0, "volts per N·m or N, with the sensor's sign");

const KEYS: Keys = &[
    ("channel", "Index of the analog input, one of [[channels]]."),
    ("volts_per_nm", "Sensitivity, with its sign."),
    ("volts_per_n", "Sensitivity on an axis in m, with its sign."),
    ("offset_v", "Reading without torque."),
    (
        "stuck_time_s",
        "A reading that does not change by one bit for so long trips; not watched, if left out. \
         For sensors whose noise is more than one count of the converter.",
    ),
];

impl TorqueChannel {
    pub(crate) fn read(section: Section<'_>, unit: AxisUnit) -> Self {
        section.document("[axes.torque]", KEYS);
        let channel =
            section.whole("channel", 0, ANALOG as u64 - 1, "an index of [[channels]]") as usize;
        let key = unit.key(&section, KeyNames("volts_per_nm", "volts_per_n"));
        let volts_per_unit = section.number(key, SENSITIVITY);
        if volts_per_unit.abs() < 1e-6 {
            let advice = "a sensor without sensitivity measures nothing";
            section.problem(key, "a sensitivity", volts_per_unit, advice);
        }
        let offset = bounds(-10.0, 10.0, "the reading without torque, in V");
        let offset_v = section.number_or("offset_v", 0.0, offset);
        let stuck = bounds(0.01, 600.0, "in s; many scans, so that chance gives no equal readings");
        let stuck_time_s = section.number_or_none("stuck_time_s", stuck);
        Self { channel, volts_per_unit, offset_v, stuck_time_s }
    }
}
