//! The range in which the handle may move while a person holds it.

use crate::axis_unit::{AxisUnit, KeyNames};
use crate::checked_toml::{Bounds, Keys, Section, bounds};

/// Range of motion of the subject at the handle of an axis, within the position limits. It is given
/// for a subject or a study: protocols keep within it, the soft stops lie at its ends, and the
/// watchdog cuts the motor's power where the handle leaves it, except in a search for the stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeOfMotion {
    /// Lowest position of the handle (rad or m).
    pub min: f64,
    /// Highest position of the handle (rad or m).
    pub max: f64,
    /// The watchdog trips where the handle is beyond an end by more than this (rad or m).
    pub tolerance: f64,
}

const POSITION_DEG: Bounds =
    bounds(-120.0, 120.0, "within the position limits; the value is in degrees");
const POSITION_M: Bounds = bounds(-5.0, 5.0, "within the position limits; the value is in m");
const TOLERANCE_DEG: Bounds =
    bounds(0.0, 20.0, "the overshoot of a movement to an end; the value is in degrees");
const TOLERANCE_M: Bounds =
    bounds(0.0, 0.5, "the overshoot of a movement to an end; the value is in m");

pub(crate) const MIN: KeyNames = KeyNames("min_deg", "min_m");
pub(crate) const MAX: KeyNames = KeyNames("max_deg", "max_m");

const KEYS: Keys = &[
    ("min_{deg,m}", "Lowest position of the handle with a person at it."),
    ("max_{deg,m}", "Highest position of the handle with a person at it."),
    (
        "tolerance_{deg,m}",
        "The watchdog trips where the handle is beyond an end by more than this: room for noise \
         and overshoot of a movement to the end.",
    ),
];

impl RangeOfMotion {
    /// Reads `[axes.range_of_motion]`; `None` where there is no such section.
    pub(crate) fn read(section: Section<'_>, unit: AxisUnit) -> Option<Self> {
        section.document("[axes.range_of_motion]", KEYS);
        if !section.exists() {
            return None;
        }
        let scale = unit.si_per_file_unit();
        let position = unit.choose(POSITION_DEG, POSITION_M);
        let tolerance = unit.choose(TOLERANCE_DEG, TOLERANCE_M);
        let tolerance_key = unit.key(&section, KeyNames("tolerance_deg", "tolerance_m"));
        Some(Self {
            min: section.number(unit.key(&section, MIN), position) * scale,
            max: section.number(unit.key(&section, MAX), position) * scale,
            tolerance: section.number_or(tolerance_key, unit.choose(2.0, 0.005), tolerance) * scale,
        })
    }

    /// How far a position is beyond the range (rad or m); 0 within it.
    pub fn excess(&self, position: f64) -> f64 {
        (self.min - position).max(position - self.max).max(0.0)
    }
}
