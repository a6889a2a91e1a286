//! The unit in which the page shows positions.

use rig::{AxisUnit, RigFile};

/// Degrees for angles, mm for lengths.
pub(crate) struct DisplayUnit {
    pub(crate) unit: &'static str,
    pub(crate) factor: f64,
}

impl DisplayUnit {
    pub(crate) fn of(rig: &RigFile) -> Self {
        match rig.axes.first().map(|axis| axis.unit) {
            Some(AxisUnit::Metre) => Self { unit: "mm", factor: 1e3 },
            _ => Self { unit: "°", factor: 180.0 / std::f64::consts::PI },
        }
    }

    pub(crate) fn scale(&self, values: impl Iterator<Item = f64>) -> Vec<f64> {
        values.map(|value| value * self.factor).collect()
    }
}
