//! How an axis finds the zero of its positions.

use crate::axis_unit::{AxisUnit, KeyNames};
use crate::checked_toml::{Bounds, Keys, Section, bounds};
use crate::limits::VOLTS;

/// How an axis finds the zero of its positions after power-up of the card.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Homing {
    /// Its encoders are absolute: positions are right from the first scan on.
    Absolute,
    /// Its encoders are incremental: the axis is unhomed until a search has found its stops.
    Stops(StopSearch),
}

/// The stops of an axis, and the limits that the watchdog enforces until they are found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StopSearch {
    /// Lower mechanical stop of the handle, or of the motor where the handle has no encoder (rad
    /// or m).
    pub lower: f64,
    /// Upper mechanical stop (rad or m).
    pub upper: f64,
    /// The travel that a search finds may differ from that between the stops by this (rad or m).
    pub tolerance: f64,
    /// Largest magnitude of the motor voltage (V).
    pub volts_max: f64,
    /// Highest speed in either direction (rad/s or m/s).
    pub speed_max: f64,
    /// Largest distance from the position at power-up, in either direction (rad or m).
    pub travel_max: f64,
    /// Longest time under power (s).
    pub time_max_s: f64,
}

const STOP_DEG: Bounds = bounds(-180.0, 180.0, "where the handle meets its stop, in degrees");
const STOP_M: Bounds = bounds(-5.0, 5.0, "where the handle meets its stop, in m");
const TOLERANCE_DEG: Bounds = bounds(0.1, 60.0, "the stops yield a little; in degrees");
const TOLERANCE_M: Bounds = bounds(1e-5, 1.0, "the stops yield a little; in m");
const SPEED_DEG: Bounds =
    bounds(1.0, 720.0, "a search is slow, its turns are not; in degrees a second");
const SPEED_M: Bounds = bounds(1e-3, 2.0, "a search is slow, its turns are not; in m/s");
const TRAVEL_DEG: Bounds = bounds(1.0, 720.0, "from one stop to the other, and more; in degrees");
const TRAVEL_M: Bounds = bounds(1e-3, 20.0, "from one stop to the other, and more; in m");
const TIME: Bounds = bounds(1.0, 3600.0, "in s; a search takes half a minute");

/// Travel, as a multiple of the distance between the stops, where the file has none: the motor
/// turns further than the handle by the ratio of the line and its windup.
const TRAVEL_SHARE: f64 = 1.5;

pub(crate) const LOWER_STOP: KeyNames = KeyNames("lower_stop_deg", "lower_stop_m");
pub(crate) const UPPER_STOP: KeyNames = KeyNames("upper_stop_deg", "upper_stop_m");

const KEYS: Keys = &[
    ("method", "How the zero of the positions is found after power-up."),
    ("lower_stop_{deg,m}", "Position of the handle at its lower mechanical stop (method stops)."),
    ("upper_stop_{deg,m}", "Position of the handle at its upper mechanical stop."),
    ("tolerance_{deg,m}", "Difference allowed between the travel found and that of the stops."),
    ("volts_max", "Largest magnitude of the motor voltage while the axis is unhomed."),
    ("speed_max_{deg,m}_s", "Highest speed while it is unhomed."),
    (
        "travel_max_{deg,m}",
        "Largest distance from power-up while it is unhomed; 1.5 times that of the stops.",
    ),
    ("time_max_s", "Longest time under power while an axis is unhomed."),
];

impl Homing {
    /// Reads `[axes.homing]`; `None` where there is no such section.
    pub(crate) fn read(section: Section<'_>, unit: AxisUnit) -> Option<Self> {
        section.document("[axes.homing]", KEYS);
        if !section.exists() {
            return None;
        }
        let absolute =
            section.word("method", &[("stops", false), ("absolute", true)]).unwrap_or(true);
        if absolute {
            return Some(Self::Absolute);
        }
        Some(Self::Stops(StopSearch::read(&section, unit)))
    }
}

impl StopSearch {
    fn read(section: &Section<'_>, unit: AxisUnit) -> Self {
        let scale = unit.si_per_file_unit();
        let stop = unit.choose(STOP_DEG, STOP_M);
        let (lower_key, upper_key) = (unit.key(section, LOWER_STOP), unit.key(section, UPPER_STOP));
        let lower = section.number(lower_key, stop);
        let upper = section.number(upper_key, stop);
        if lower >= upper {
            let advice = "swap the two";
            section.problem(upper_key, format!("more than {lower}"), upper, advice);
        }
        let optional = |names: KeyNames, degrees: f64, metres: f64, bounds: (Bounds, Bounds)| {
            let key = unit.key(section, names);
            let bounds = unit.choose(bounds.0, bounds.1);
            section.number_or(key, unit.choose(degrees, metres), bounds)
        };
        let travel = TRAVEL_SHARE * (upper - lower).max(0.0);
        let tolerance = optional(
            KeyNames("tolerance_deg", "tolerance_m"),
            5.0,
            0.01,
            (TOLERANCE_DEG, TOLERANCE_M),
        );
        let speed = optional(
            KeyNames("speed_max_deg_s", "speed_max_m_s"),
            360.0,
            0.5,
            (SPEED_DEG, SPEED_M),
        );
        let travel_key = unit.key(section, KeyNames("travel_max_deg", "travel_max_m"));
        let travel_bounds = unit.choose(TRAVEL_DEG, TRAVEL_M);
        let travel = section.number_or_none(travel_key, travel_bounds).unwrap_or(travel);
        Self {
            lower: lower * scale,
            upper: upper * scale,
            tolerance: tolerance * scale,
            volts_max: section.number_or("volts_max", 5.0, VOLTS),
            speed_max: speed * scale,
            travel_max: travel * scale,
            time_max_s: section.number_or("time_max_s", 60.0, TIME),
        }
    }

    /// Range of the positions of an unhomed axis, which count from power-up (rad or m).
    pub const fn range(&self) -> (f64, f64) {
        (-self.travel_max, self.travel_max)
    }

    /// Distance between the stops (rad or m).
    pub fn travel(&self) -> f64 {
        self.upper - self.lower
    }
}
