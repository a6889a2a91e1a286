//! Finds the ends of an axis's travel. Pure: time and measured positions are arguments.
//!
//! ```text
//! towards the first end ──stands still──> towards the other ──stands still──> found
//!          └────────────────── time limit ──────┴──> nothing found
//! ```
//!
//! The reference starts at the measured position, accelerates to the protocol's speed and moves
//! towards its final position just within the rig's limits, so that overshoot does not reach the
//! watchdog's limit. An end of travel is detected where the measured position has stood still for
//! the stated time while the reference either leads by more than the stated distance or has reached
//! its final position; in the second case the handle moves as far as the rig allows. Control's
//! anti-windup keeps the reference close meanwhile, so the return movement starts at once.

use rig::protocol::Initialise;
use rig::protocol::trajectory::Point;

/// Movement below this counts as standing still (share of the lead).
const STILL_SHARE: f64 = 1.0 / 16.0;
/// Time in which the reference reaches its speed (s).
const START_S: f64 = 0.4;
/// A range narrower than this multiple of the lead is rejected: the handle was held, or is stuck.
const LEAST_LEADS: f64 = 1.0;

/// Measured position of an axis (rad or m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// By the motor's encoder, which setpoints and limits refer to.
    pub motor: f64,
    /// By the handle's own encoder, or the motor's if there is none.
    pub handle: f64,
}

/// The ends of an axis's travel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower end.
    pub lower: Measured,
    /// Upper end.
    pub upper: Measured,
    /// Whether the lower and the upper end were met; otherwise the movement ended at the rig's
    /// limit, or that direction was not searched.
    pub met: (bool, bool),
}

/// State of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FinderState {
    /// Under way.
    Going,
    /// Done.
    Found(Range),
    /// The time limit passed.
    TimedOut,
    /// The two ends are at the same place.
    Stuck,
}

/// The search for the ends of travel.
#[derive(Clone, Copy, Debug)]
pub struct RangeFinder {
    how: Initialise,
    reach: (f64, f64),
    upward: bool,
    /// The end that was found first.
    first: Option<(Measured, bool)>,
    point: Point,
    last_s: f64,
    /// Position and time of the last movement.
    anchor: f64,
    moved_s: f64,
}

impl RangeFinder {
    /// Creates a search that starts with the handle at `start` (rad or m), on an axis with these
    /// limits (rad or m).
    pub fn new(how: Initialise, start: f64, (position_min, position_max): (f64, f64)) -> Self {
        let reach = how.reach(position_min, position_max);
        Self {
            how,
            reach,
            upward: how.upper_first,
            first: None,
            point: Point::at_rest(start),
            last_s: 0.0,
            anchor: start,
            moved_s: 0.0,
        }
    }

    /// The present reference.
    pub const fn point(&self) -> Point {
        self.point
    }

    /// Advances to `time_s` after the beginning of the search. A position that is not finite counts
    /// as no movement.
    pub fn step(&mut self, time_s: f64, measured: Measured) -> FinderState {
        let elapsed_s = (time_s - self.last_s).clamp(0.0, 0.1);
        self.last_s = self.last_s.max(time_s);
        self.go_on(elapsed_s);
        let position = measured.motor;
        if !position.is_finite() || !measured.handle.is_finite() {
            return self.within_time();
        }
        if (position - self.anchor).abs() > STILL_SHARE * self.how.lead {
            self.anchor = position;
            self.moved_s = self.last_s;
        }
        let lead = (self.point.position - position) * if self.upward { 1.0 } else { -1.0 };
        let arrived = self.point.velocity == 0.0 && self.last_s > 0.0;
        let still = self.last_s - self.moved_s >= self.how.still_s;
        if !still || !(lead > self.how.lead || arrived) {
            return self.within_time();
        }
        self.end_at(measured, lead > self.how.lead)
    }

    /// Handles an end of travel: the search turns to the other end, or is over.
    fn end_at(&mut self, measured: Measured, met: bool) -> FinderState {
        let Some((first, first_met)) = self.first else {
            if !self.how.both {
                return FinderState::Found(self.one_sided(measured, met));
            }
            self.first = Some((measured, met));
            self.upward = !self.upward;
            self.point = Point::at_rest(measured.motor);
            (self.anchor, self.moved_s) = (measured.motor, self.last_s);
            return self.within_time();
        };
        let range = if self.upward {
            Range { lower: first, upper: measured, met: (first_met, met) }
        } else {
            Range { lower: measured, upper: first, met: (met, first_met) }
        };
        if range.upper.motor - range.lower.motor < LEAST_LEADS * self.how.lead {
            return FinderState::Stuck;
        }
        FinderState::Found(range)
    }

    /// If only one end was requested, the rig's limit takes the place of the other.
    fn one_sided(&self, measured: Measured, met: bool) -> Range {
        let at = |position| Measured { motor: position, handle: position };
        if self.upward {
            Range { lower: at(self.reach.0), upper: measured, met: (false, met) }
        } else {
            Range { lower: measured, upper: at(self.reach.1), met: (met, false) }
        }
    }

    fn within_time(&self) -> FinderState {
        if self.last_s >= self.how.duration_s { FinderState::TimedOut } else { FinderState::Going }
    }

    /// Advances the reference: constant acceleration up to its speed, constant deceleration before
    /// its final position.
    fn go_on(&mut self, elapsed_s: f64) {
        let acceleration = self.how.speed / START_S;
        let direction = if self.upward { 1.0 } else { -1.0 };
        let end = if self.upward { self.reach.1 } else { self.reach.0 };
        let left = (end - self.point.position) * direction;
        let before = self.point.velocity * direction;
        // Highest speed from which it can still stop at its final position.
        let most = (2.0 * acceleration * left.max(0.0)).sqrt();
        let after = (before + acceleration * elapsed_s).min(self.how.speed).min(most);
        let way = 0.5 * (before + after) * elapsed_s;
        // The last part is covered in one step, since the square root approaches its end
        // asymptotically.
        if left <= way || most < 0.01 * self.how.speed {
            self.point = Point {
                peak_speed: self.how.speed,
                ..Point::at_rest(if left > 0.0 { end } else { self.point.position })
            };
            return;
        }
        let slope = if elapsed_s > 0.0 { (after - before) / elapsed_s } else { 0.0 };
        self.point = Point {
            position: self.point.position + direction * way,
            velocity: direction * after,
            acceleration: direction * slope,
            peak_speed: self.how.speed,
        };
    }
}
