//! Finds the ends of an axis's travel. Pure: time and measured positions are arguments.
//!
//! ```text
//! towards the first end ──stands still──> towards the other ──stands still──> found
//!          └────────────────── time limit ──────┴──> nothing found
//! ```
//!
//! The reference leaves the measured position, comes to the speed of the protocol and goes on to
//! its own end, a little within the rig's limits: not further, so that no overshoot reaches the
//! watchdog's. An end is where the measured position has stood still for the stated time while the
//! reference leads by more than the stated amount, or has come to its own end: then the handle goes
//! as far as the rig allows. Control holds its reference back meanwhile (its anti-windup), so the
//! way back begins at once.

use rig::protocol::Initialise;
use rig::protocol::trajectory::Point;

/// Movement that counts as none (share of the lead).
const STILL_SHARE: f64 = 1.0 / 16.0;
/// Time in which the reference comes to its speed (s).
const START_S: f64 = 0.4;
/// A range narrower than this many leads is none: the handle was held, or is stuck.
const LEAST_LEADS: f64 = 1.0;

/// What was measured of an axis (rad or m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// By the encoder that setpoints and limits belong to, the motor's.
    pub motor: f64,
    /// By the handle's own encoder; the motor's where there is none.
    pub handle: f64,
}

/// The ends of a travel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower end.
    pub lower: Measured,
    /// Upper end.
    pub upper: Measured,
    /// Whether the lower end and the upper end were met; else the way ended at the rig's limit, or
    /// was not gone.
    pub met: (bool, bool),
}

/// How far the search is.
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

/// The search.
#[derive(Clone, Copy, Debug)]
pub struct RangeFinder {
    how: Initialise,
    reach: (f64, f64),
    upward: bool,
    /// The end that was found first.
    first: Option<(Measured, bool)>,
    point: Point,
    last_s: f64,
    /// Where the handle last moved, and when.
    anchor: f64,
    moved_s: f64,
}

impl RangeFinder {
    /// A search that begins with the handle measured at `start` (rad or m), on an axis with these
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

    /// Where the reference is.
    pub const fn point(&self) -> Point {
        self.point
    }

    /// One step, `time_s` after the search began. A position that is not finite counts as not
    /// moved.
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

    /// An end: the other one comes next, or the search is over.
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

    /// Where only one end was asked for, the other is where the rig allows.
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

    /// Moves the reference on: evenly faster to its speed, and evenly slower before its own end.
    fn go_on(&mut self, elapsed_s: f64) {
        let acceleration = self.how.speed / START_S;
        let direction = if self.upward { 1.0 } else { -1.0 };
        let end = if self.upward { self.reach.1 } else { self.reach.0 };
        let left = (end - self.point.position) * direction;
        let before = self.point.velocity * direction;
        // The speed from which it comes to rest at its end.
        let most = (2.0 * acceleration * left.max(0.0)).sqrt();
        let after = (before + acceleration * elapsed_s).min(self.how.speed).min(most);
        let way = 0.5 * (before + after) * elapsed_s;
        // The last bit of the way goes in one step, or the square root would never end.
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
