//! `ramp`: to a position at constant speed.

use crate::checked_toml::{Bounds, Keys, Section, bounds};
use crate::protocol::segment_kind::{Placement, SegmentKind};
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::{DURATION, POSITION_DEG, POSITION_M, UnitKeys};

/// Moves to a position at constant speed and rests there under power. The speed rises and falls
/// along the minimum-jerk curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    /// Target position (rad or m).
    pub position: f64,
    /// Speed of the movement (rad/s or m/s).
    pub speed: f64,
    /// Rise time and fall time of the speed (s).
    pub ease_s: f64,
    /// Whole duration (s).
    pub duration_s: f64,
}

/// A ramp from a known start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RampProfile {
    /// Constant speed (rad/s or m/s); below [`Ramp::speed`] where the distance is short.
    pub speed: f64,
    /// Time of the movement (s).
    pub moving_s: f64,
}

const SPEED_DEG: Bounds = bounds(0.1, 1500.0, "in degrees a second");
const SPEED_M: Bounds = bounds(1e-4, 10.0, "in m/s");

pub(super) const KEYS: Keys = &[
    ("position_{deg,m}", "Target position."),
    ("speed_{deg,m}_s", "Speed of the movement."),
    ("ease_s", "Rise time and fall time of the speed."),
    ("duration_s", "Whole duration."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Ramp {
    Ramp {
        position: keys.required("position", POSITION_DEG, POSITION_M),
        speed: keys.speed("speed", SPEED_DEG, SPEED_M),
        ease_s: section.number_or("ease_s", 0.2, bounds(0.02, 10.0, "in seconds")),
        duration_s: section.number("duration_s", DURATION),
    }
}

impl Ramp {
    /// The ramp that begins at `start` (rad or m).
    pub fn profile(&self, start: f64) -> RampProfile {
        let distance = (self.position - start).abs();
        let speed = self.speed.min(distance / self.ease_s);
        let moving_s = if speed > 0.0 { distance / speed + self.ease_s } else { 0.0 };
        RampProfile { speed, moving_s }
    }
}

/// The minimum-jerk curve at `x` of the rise time, its slope and its integral, for a speed and a
/// rise time of 1.
fn ease(x: f64) -> (f64, f64, f64) {
    let x = x.clamp(0.0, 1.0);
    let value = x * x * x * (10.0 + x * (6.0 * x - 15.0));
    let slope = 30.0 * x * x * (1.0 - x) * (1.0 - x);
    (value, slope, x * x * x * x * (2.5 + x * (x - 3.0)))
}

impl SegmentKind for Ramp {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn target(&self) -> Option<f64> {
        Some(self.position)
    }

    fn peak_speed_from(&self, start: f64) -> f64 {
        self.profile(start).speed
    }

    fn at(&self, start: f64, time_s: f64, _peak_speed: f64) -> Point {
        let profile = self.profile(start);
        if time_s <= 0.0 || profile.speed <= 0.0 {
            return Point::at_rest(if profile.speed > 0.0 { start } else { self.position });
        }
        if time_s >= profile.moving_s {
            return Point::at_rest(self.position);
        }
        let (rise, left) = (self.ease_s, profile.moving_s - time_s);
        let direction = (self.position - start).signum();
        let (velocity, acceleration, position) = if left < rise {
            // The end mirrors the beginning in time.
            let (value, slope, distance) = ease(left / rise);
            (value, -slope / rise, self.position - direction * profile.speed * rise * distance)
        } else {
            let (value, slope, distance) = ease(time_s / rise);
            let distance = rise * distance + (time_s - rise).max(0.0);
            (value, slope / rise, start + direction * profile.speed * distance)
        };
        let speed = direction * profile.speed;
        Point {
            position,
            velocity: speed * velocity,
            acceleration: speed * acceleration,
            peak_speed: profile.speed,
        }
    }

    fn check(&self, placed: &Placement<'_>) -> bool {
        let needed = placed.worst_start(|start| self.profile(start).moving_s);
        if needed > self.duration_s {
            let expected = format!("at least {needed:.1} s, the time to the target at that speed");
            let found = format!("{} s", self.duration_s);
            let advice = "take more time, move faster, or put a hold before it";
            placed.source.problem(&placed.key("duration_s"), expected, found, advice);
        }
        needed <= self.duration_s
    }

    fn scale(&mut self, factor: f64) -> Result<(), (&'static str, &'static str)> {
        self.position *= factor;
        Ok(())
    }
}
