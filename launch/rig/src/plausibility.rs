//! Limits on how the machine may answer its control, enforced by the watchdog under power.

use crate::axis_unit::{AxisUnit, KeyNames};
use crate::checked_toml::{Bounds, Keys, Section, bounds};
use crate::limits::Limits;

/// Limits on how an axis may answer its control. What exceeds them under power trips.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plausibility {
    /// Largest distance of both master and slave from the reference of a position-controlled axis
    /// at rest (rad or m).
    pub following_error_max: f64,
    /// What the reference's speed adds to it (rad or m per rad/s or m/s, thus s).
    pub following_error_time_s: f64,
    /// Largest change of the difference between master and slave since power was given (rad or m).
    pub disagreement_max: f64,
    /// Way that one side may move while the encoder of the other counts nothing (rad or m).
    pub stuck_travel_max: f64,
    /// Longest time for which the output may stay at its limit (s).
    pub saturation_time_s: f64,
    /// Rating of motor and amplifier; `None` where it is not known, and not watched.
    pub thermal: Option<ThermalRating>,
}

/// What motor and amplifier bear for long. They heat with the square of the current, which is
/// taken to be proportional to the volts: so it is behind a current amplifier, and at stall behind
/// a voltage amplifier, whose moving motor draws less.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThermalRating {
    /// Magnitude of the volts that may be applied without end (V).
    pub continuous_v: f64,
    /// Time constant of the heating (s).
    pub time_constant_s: f64,
}

/// The defaults are shares of the range of positions, which fits any unit and machine: they find
/// an axis that runs away or stands still, not one that is badly tuned.
const FOLLOWING_SHARE: f64 = 0.125;
/// More than a compliant line winds up in movements; a search for the stops winds it up further,
/// and is exempt.
const DISAGREEMENT_SHARE: f64 = 0.25;
/// More than a line winds up before a side with dry friction gives way.
const STUCK_SHARE: f64 = 1.0 / 12.0;

const ERROR_DEG: Bounds = bounds(0.1, 240.0, "the value is in degrees");
const ERROR_M: Bounds = bounds(1e-6, 10.0, "the value is in m");
const ERROR_TIME: Bounds = bounds(0.0, 10.0, "in s: distance over speed of the reference");
const SATURATION: Bounds = bounds(0.01, 600.0, "in s; a movement may touch the limit for a while");
const CONTINUOUS: Bounds = bounds(0.01, 10.0, "in V, below `volts_max`");
const THERMAL_TIME: Bounds = bounds(0.1, 36_000.0, "in s; see the motor's data sheet");

const KEYS: Keys = &[
    (
        "following_error_max_{deg,m}",
        "Largest distance of master and slave, whichever is nearer, from the reference under \
         position control; an eighth of the range of positions, if left out.",
    ),
    ("following_error_time_s", "What the reference's speed adds to it."),
    (
        "disagreement_max_{deg,m}",
        "Largest change of the difference between master and slave since power was given; a \
         quarter of the range of positions, if left out.",
    ),
    (
        "stuck_travel_max_{deg,m}",
        "Way that one side may move while the encoder of the other counts nothing; a twelfth of \
         the range of positions, if left out.",
    ),
    ("saturation_time_s", "Longest time for which the output may stay at its limit."),
    (
        "continuous_v",
        "Volts that motor and amplifier bear for long; not watched, if left out. They are taken to \
         heat with the square of the volts.",
    ),
    ("thermal_time_s", "Time constant of that heating."),
];

impl Plausibility {
    /// Reads `[axes.plausibility]`.
    pub(crate) fn read(section: Section<'_>, unit: AxisUnit, limits: &Limits) -> Self {
        section.document("[axes.plausibility]", KEYS);
        let range = (limits.position_max - limits.position_min).max(0.0);
        let volts_max = limits.volts_max;
        let (error, scale) = (unit.choose(ERROR_DEG, ERROR_M), unit.si_per_file_unit());
        let length = |names, default: f64| {
            section
                .number_or_none(unit.key(&section, names), error)
                .map_or(default, |value| value * scale)
        };
        let following = length(
            KeyNames("following_error_max_deg", "following_error_max_m"),
            range * FOLLOWING_SHARE,
        );
        let disagreement = length(
            KeyNames("disagreement_max_deg", "disagreement_max_m"),
            range * DISAGREEMENT_SHARE,
        );
        let stuck =
            length(KeyNames("stuck_travel_max_deg", "stuck_travel_max_m"), range * STUCK_SHARE);
        let continuous_v = section.number_or_none("continuous_v", CONTINUOUS);
        if let Some(continuous_v) = continuous_v.filter(|&volts| volts >= volts_max) {
            let expected = format!("less than volts_max, {volts_max}");
            let advice = "what the output can never exceed needs no supervision";
            section.problem("continuous_v", expected, continuous_v, advice);
        }
        if continuous_v.is_none() {
            section.misplaced("thermal_time_s", "continuous_v beside it", "add continuous_v");
        }
        let time_constant_s = section.number_or("thermal_time_s", 30.0, THERMAL_TIME);
        Self {
            following_error_max: following,
            following_error_time_s: section.number_or("following_error_time_s", 0.05, ERROR_TIME),
            disagreement_max: disagreement,
            stuck_travel_max: stuck,
            saturation_time_s: section.number_or("saturation_time_s", 2.0, SATURATION),
            thermal: continuous_v
                .map(|continuous_v| ThermalRating { continuous_v, time_constant_s }),
        }
    }
}
