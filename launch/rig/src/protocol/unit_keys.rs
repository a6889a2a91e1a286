//! Positions and speeds of a segment, whose keys end in their unit.

use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Bounds, Section, bounds};

pub(super) const DURATION: Bounds = bounds(0.1, 36_000.0, "in seconds");
pub(super) const FADE: Bounds = bounds(0.1, 60.0, "in seconds");
pub(super) const LINE_HZ: Bounds =
    bounds(0.02, 24.0, "the transmission is examined up to 24 Hz (fig. 3.4)");
pub(super) const AMPLITUDE_DEG: Bounds =
    bounds(0.01, 120.0, "movements are of up to 120° (§ 4.2); the value is in degrees");
pub(super) const AMPLITUDE_M: Bounds = bounds(1e-6, 5.0, "the value is in m");
pub(super) const POSITION_DEG: Bounds =
    bounds(-120.0, 120.0, "positions lie within ±120° (§ 4.2); the value is in degrees");
pub(super) const POSITION_M: Bounds = bounds(-5.0, 5.0, "the value is in m");

/// Reads keys that end in `_deg` or `_m`, and remembers which unit the segment uses.
pub(super) struct UnitKeys<'r, 's> {
    pub(super) section: &'r Section<'s>,
    pub(super) unit: Option<AxisUnit>,
}

impl UnitKeys<'_, '_> {
    /// The key and unit with which `stem` is in the file; the segment's unit, or degrees, where it
    /// is not.
    fn key(&mut self, stem: &str) -> (String, AxisUnit) {
        self.key_per(stem, "")
    }

    /// As `key`, for units with a suffix `per`: `_s` for speeds.
    fn key_per(&mut self, stem: &str, per: &str) -> (String, AxisUnit) {
        let (degrees, metres) = (format!("{stem}_deg{per}"), format!("{stem}_m{per}"));
        let (key, other, unit) = match self.section.has(&metres) && !self.section.has(&degrees) {
            true => (metres, degrees, AxisUnit::Metre),
            false if self.unit == Some(AxisUnit::Metre) && !self.section.has(&degrees) => {
                (metres, degrees, AxisUnit::Metre)
            }
            false => (degrees, metres, AxisUnit::Radian),
        };
        if self.section.has(&other) {
            self.section.misplaced(&other, &format!("`{key}` alone"), "give the value once");
        }
        if self.section.has(&key) {
            if self.unit.is_some_and(|before| before != unit) {
                let advice = "keep to degrees or to metres within a segment";
                let found = "another unit";
                self.section.problem(&key, "the unit of the segment's other values", found, advice);
            }
            self.unit = Some(unit);
        }
        (key, unit)
    }

    /// Reads a value that must be there (rad or m).
    pub(super) fn required(&mut self, stem: &str, degrees: Bounds, metres: Bounds) -> f64 {
        let (key, unit) = self.key(stem);
        self.section.number(&key, unit.choose(degrees, metres)) * unit.si_per_file_unit()
    }

    /// Reads a speed, `stem_deg_s` or `stem_m_s`, that must be there (rad/s or m/s).
    pub(super) fn speed(&mut self, stem: &str, degrees: Bounds, metres: Bounds) -> f64 {
        let (key, unit) = self.key_per(stem, "_s");
        self.section.number(&key, unit.choose(degrees, metres)) * unit.si_per_file_unit()
    }

    /// Reads an optional value (rad or m).
    pub(super) fn optional(&mut self, stem: &str, degrees: Bounds, metres: Bounds) -> Option<f64> {
        let (key, unit) = self.key(stem);
        self.section
            .number_or_none(&key, unit.choose(degrees, metres))
            .map(|value| value * unit.si_per_file_unit())
    }

    /// Reads an optional position (rad or m).
    pub(super) fn position(&mut self, stem: &str) -> Option<f64> {
        self.optional(stem, POSITION_DEG, POSITION_M)
    }

    /// Reads an amplitude that must be there (rad or m).
    pub(super) fn amplitude(&mut self, stem: &str) -> f64 {
        self.required(stem, AMPLITUDE_DEG, AMPLITUDE_M)
    }

    /// Reads a list of values (rad or m).
    pub(super) fn list(&mut self, stem: &str, degrees: Bounds, metres: Bounds) -> Vec<f64> {
        let (key, unit) = self.key(stem);
        let mut values = self.section.numbers(&key, unit.choose(degrees, metres));
        values.iter_mut().for_each(|value| *value *= unit.si_per_file_unit());
        values
    }
}
