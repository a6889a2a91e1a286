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
//!
//! On the way from the first end to the other the search also measures by how much the motor moves
//! per movement of the handle: in the middle of that way, where the windup of the line is constant.

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
    /// Movement of the motor per movement of the handle; `None` where it was not measured.
    pub ratio: Option<f64>,
    /// By how much the motor is ahead of the handle at the end that was met last, positive at the
    /// upper end (rad or m): so far it springs back when it is let go. Without a measurement twice
    /// the lead; 0 where only one end was sought.
    pub windup: f64,
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

/// What is known of an axis's stops before the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stops {
    /// Their distance (rad or m).
    pub travel: f64,
    /// Lead of the reference at which control's output reaches its limit (rad or m): an end counts
    /// from there on, so that the motor pushes as hard at both.
    pub lead: f64,
}

/// The search for the ends of travel.
#[derive(Clone, Copy, Debug)]
pub struct RangeFinder {
    how: Initialise,
    /// What is known of the stops; `None` where the rig file does not say.
    stops: Option<Stops>,
    reach: (f64, f64),
    upward: bool,
    /// The end that was found first.
    first: Option<(Measured, bool)>,
    point: Point,
    last_s: f64,
    /// Position and time of the last movement.
    anchor: f64,
    moved_s: f64,
    /// The measured positions without the noise of the encoders.
    smooth: Option<Measured>,
    ratio: RatioSums,
}

/// Sums for the regression of the motor's position on the handle's.
#[derive(Clone, Copy, Debug, Default)]
struct RatioSums {
    count: f64,
    motor: f64,
    handle: f64,
    product: f64,
    square: f64,
}

/// Weight of a measurement in the smoothed positions.
const SMOOTHING: f64 = 0.1;
/// Part of the expected travel, from the first end on, in which the ratio is measured.
const RATIO_WAY: (f64, f64) = (0.2, 0.8);

impl RatioSums {
    fn add(&mut self, measured: Measured) {
        self.count += 1.0;
        self.motor += measured.motor;
        self.handle += measured.handle;
        self.product += measured.motor * measured.handle;
        self.square += measured.handle * measured.handle;
    }

    /// The slope, and the motor's position at the handle's position 0; `None` while the handle has
    /// not moved.
    fn line(&self) -> Option<(f64, f64)> {
        let spread = self.square - self.handle * self.handle / self.count;
        let slope = (self.product - self.motor * self.handle / self.count) / spread;
        let offset = (self.motor - slope * self.handle) / self.count;
        (self.count > 2.0 && spread > 0.0 && slope.is_finite()).then_some((slope, offset))
    }
}

impl RangeFinder {
    /// Creates a search that starts with the handle at `start` (rad or m), on an axis with these
    /// limits (rad or m); with `stops` the reference may lead beyond them.
    pub fn new(
        how: Initialise,
        start: f64,
        (position_min, position_max): (f64, f64),
        stops: Option<Stops>,
    ) -> Self {
        let beyond = stops.map_or(0.0, |stops| stops.lead);
        let (lower, upper) = how.reach(position_min, position_max);
        let reach = (lower - beyond, upper + beyond);
        Self {
            how,
            stops,
            reach,
            upward: how.upper_first,
            first: None,
            point: Point::at_rest(start),
            last_s: 0.0,
            anchor: start,
            moved_s: 0.0,
            smooth: None,
            ratio: RatioSums::default(),
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
        let before = self.smooth.unwrap_or(measured);
        let smooth = Measured {
            motor: before.motor + SMOOTHING * (measured.motor - before.motor),
            handle: before.handle + SMOOTHING * (measured.handle - before.handle),
        };
        self.smooth = Some(smooth);
        self.measure_ratio(measured);
        if (position - self.anchor).abs() > STILL_SHARE * self.how.lead {
            self.anchor = position;
            self.moved_s = self.last_s;
        }
        let lead = (self.point.position - position) * if self.upward { 1.0 } else { -1.0 };
        let arrived = self.point.velocity == 0.0 && self.last_s > 0.0;
        let still = self.last_s - self.moved_s >= self.how.still_s;
        let met = lead > self.stops.map_or(self.how.lead, |stops| stops.lead.max(self.how.lead));
        if !still || !(met || arrived) {
            return self.within_time();
        }
        self.end_at(smooth, met)
    }

    /// Counts a measurement on the way from the first end to the other.
    fn measure_ratio(&mut self, measured: Measured) {
        let (Some((first, _)), Some(stops)) = (self.first, self.stops) else { return };
        let way = (measured.handle - first.handle).abs() / stops.travel;
        if (RATIO_WAY.0..RATIO_WAY.1).contains(&way) {
            self.ratio.add(measured);
        }
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
            Range { lower: first, upper: measured, met: (first_met, met), ratio: None, windup: 0.0 }
        } else {
            Range { lower: measured, upper: first, met: (met, first_met), ratio: None, windup: 0.0 }
        };
        let line = self.ratio.line();
        let unmeasured = 2.0 * self.how.lead * if self.upward { 1.0 } else { -1.0 };
        let windup = line
            .map(|(ratio, offset)| measured.motor - (offset + ratio * measured.handle))
            .filter(|windup| windup * unmeasured > 0.0)
            .unwrap_or(unmeasured);
        let range = Range { ratio: line.map(|(ratio, _)| ratio), windup, ..range };
        if range.upper.motor - range.lower.motor < LEAST_LEADS * self.how.lead {
            return FinderState::Stuck;
        }
        FinderState::Found(range)
    }

    /// If only one end was requested, the rig's limit takes the place of the other.
    fn one_sided(&self, measured: Measured, met: bool) -> Range {
        let at = |position| Measured { motor: position, handle: position };
        if self.upward {
            Range {
                lower: at(self.reach.0),
                upper: measured,
                met: (false, met),
                ratio: None,
                windup: 0.0,
            }
        } else {
            Range {
                lower: measured,
                upper: at(self.reach.1),
                met: (met, false),
                ratio: None,
                windup: 0.0,
            }
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
