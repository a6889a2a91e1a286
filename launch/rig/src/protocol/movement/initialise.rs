//! `initialise`: finds the ends of the handle's travel (appendix).

use ipc_types::Mode;

use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Bounds, Keys, Section, bounds};
use crate::protocol::segment_kind::{Placement, SegmentKind};
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::{AMPLITUDE_DEG, AMPLITUDE_M, DURATION, UnitKeys};

/// Moves gently to one end of the travel until the handle stalls, then to the other.
///
/// The reference moves at `speed`, within the rig's position limits less a margin. An end is found
/// when the measured position has stood still for `still_s` while the reference leads by more than
/// `lead` or has reached its own end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Initialise {
    /// Speed of the reference (rad/s or m/s).
    pub speed: f64,
    /// The output stays within ± this (V).
    pub volts: f64,
    /// Whether the upper end comes first.
    pub upper_first: bool,
    /// Whether both ends are sought.
    pub both: bool,
    /// Least lead of the reference at an end (rad or m).
    pub lead: f64,
    /// Time for which the handle must stand still (s).
    pub still_s: f64,
    /// A found range that ends further inside the rig's limits than this causes a warning (rad or
    /// m).
    pub tolerance: f64,
    /// Time limit (s).
    pub duration_s: f64,
}

const SPEED_DEG: Bounds =
    bounds(1.0, 60.0, "slow, as the handle runs against its end; in degrees a second");
const SPEED_M: Bounds = bounds(1e-3, 0.5, "slow, as the handle runs against its end; in m/s");
const LEAD_DEG: Bounds =
    bounds(1.0, 45.0, "more than the lag of the handle in free movement; in degrees");
const LEAD_M: Bounds = bounds(1e-3, 1.0, "more than the lag of the handle in free movement; in m");

/// Distance of the reference from the rig's limits as a share of the range, so that an overshoot
/// does not trip the watchdog.
const MARGIN_SHARE: f64 = 0.0125;
/// Time to start, stand still and turn, at each end (s).
const OVERHEAD_S: f64 = 4.0;

pub(super) const KEYS: Keys = &[
    ("speed_{deg,m}_s", "Speed of the reference."),
    ("volts", "The output stays within ± this."),
    ("first", "End that is sought first."),
    ("ends", "Whether both ends are sought, or the first only."),
    ("lead_{deg,m}", "Least lead of the reference over the handle at an end."),
    ("still_s", "Time for which the handle must stand still at an end."),
    ("tolerance_{deg,m}", "A range that ends further inside the limits causes a warning."),
    ("duration_s", "Time limit."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Initialise {
    let speed = keys.speed("speed", SPEED_DEG, SPEED_M);
    let metres = keys.unit == Some(AxisUnit::Metre);
    let volts = bounds(0.1, 10.0, "enough to overcome friction, little enough for a hand to hold");
    let default = |degrees: f64, m| if metres { m } else { degrees.to_radians() };
    Initialise {
        speed,
        volts: section.number("volts", volts),
        upper_first: section.word_or("first", &[("lower", false), ("upper", true)], false),
        both: section.word_or("ends", &[("both", true), ("first", false)], true),
        lead: keys.optional("lead", LEAD_DEG, LEAD_M).unwrap_or(default(8.0, 0.02)),
        still_s: section.number_or("still_s", 0.5, bounds(0.1, 5.0, "in seconds")),
        tolerance: keys
            .optional("tolerance", AMPLITUDE_DEG, AMPLITUDE_M)
            .unwrap_or(default(10.0, 0.05)),
        duration_s: section.number("duration_s", DURATION),
    }
}

impl Initialise {
    /// Ends of the reference's own range for an axis with these limits (rad or m).
    pub fn reach(&self, position_min: f64, position_max: f64) -> (f64, f64) {
        let margin = MARGIN_SHARE * (position_max - position_min);
        (position_min + margin, position_max - margin)
    }
}

impl SegmentKind for Initialise {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn end_is_unknown(&self) -> bool {
        true
    }

    fn peak_speed_from(&self, _start: f64) -> f64 {
        self.speed
    }

    fn mode(&self, _time_s: f64) -> Mode {
        Mode::Initialise
    }

    /// At rest at the start: the reference depends on measurements, and the experiment process
    /// computes it.
    fn at(&self, start: f64, _time_s: f64, _peak_speed: f64) -> Point {
        Point::at_rest(start)
    }

    fn output_limit_v(&self) -> Option<f64> {
        Some(self.volts)
    }

    fn check(&self, placed: &Placement<'_>) -> bool {
        let (limit, limits) = (placed.axis.control.output_limit_v, &placed.axis.limits);
        if self.volts > limit {
            let expected = format!("at most control.output_limit_v of the rig file ({limit} V)");
            let advice = "drive gently against an end";
            return placed.source.problem(&placed.key("volts"), expected, self.volts, advice);
        }
        if let Some(search) = placed.axis.stop_search() {
            if self.volts > search.volts_max {
                let expected =
                    format!("at most homing.volts_max of the rig file ({} V)", search.volts_max);
                let advice = "an unhomed axis has limits of its own";
                return placed.source.problem(&placed.key("volts"), expected, self.volts, advice);
            }
            if self.speed > search.speed_max {
                let expected = format!(
                    "at most homing.speed_max of the rig file ({}/s)",
                    placed.show(search.speed_max)
                );
                let found = format!("{}/s", placed.show(self.speed));
                let key = placed.first_key(["speed_deg_s", "speed_m_s"]);
                return placed.source.problem(&key, expected, found, "move more slowly");
            }
        }
        let ends = if self.both { 2.0 } else { 1.0 };
        let travel = limits.position_max - limits.position_min;
        let needed = ends * (travel / self.speed + OVERHEAD_S);
        if self.duration_s < needed {
            let needed = needed.ceil();
            let expected =
                format!("at least {needed:.0} s: from any position to the ends at this speed");
            let found = format!("{} s", self.duration_s);
            let advice = "it is a time limit; the segment ends as soon as the ends are found";
            return placed.source.problem(&placed.key("duration_s"), expected, found, advice);
        }
        true
    }

    fn single_axis(&self) -> bool {
        true
    }
}
