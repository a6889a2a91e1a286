//! Movements as functions of time: position, velocity and acceleration at any instant, exact
//! derivatives of each other.
//!
//! Every movement begins at rest where the one before ended, and ends at rest. Sines are blended in
//! from the start and out to their centre with the minimum-jerk curve `s(τ) = 10 τ³ - 15 τ⁴ + 6 τ⁵`
//! (Flash and Hogan 1985), whose first and second derivatives vanish at both ends: joins are
//! therefore smooth in acceleration. A blend of two positions lies between them, so a movement
//! never leaves the hull of its start and its own range.

mod excitation;

use std::f64::consts::TAU;

use ipc_types::Mode;
use rig::protocol::{Field, Line, MIN_JERK_PEAK_SPEED, Movement};

/// One axis at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Position (rad or m).
    pub position: f64,
    /// Velocity (rad/s or m/s).
    pub velocity: f64,
    /// Acceleration (rad/s² or m/s²).
    pub acceleration: f64,
    /// Peak speed of the movement that it is part of, 0 at a hold: shapes the friction feed-forward
    /// (rad/s or m/s).
    pub peak_speed: f64,
}

impl Point {
    /// At rest.
    pub const fn at_rest(position: f64) -> Self {
        Self { position, velocity: 0.0, acceleration: 0.0, peak_speed: 0.0 }
    }

    /// From `self` to `to` by a weight that itself moves; the peak speed is that of `peak`.
    pub(crate) fn blend(self, to: Self, weight: Weight, peak_speed: f64) -> Self {
        let (distance, speed) = (to.position - self.position, to.velocity - self.velocity);
        Self {
            position: self.position + weight.value * distance,
            velocity: self.velocity + weight.rate * distance + weight.value * speed,
            acceleration: self.acceleration
                + weight.curve * distance
                + 2.0 * weight.rate * speed
                + weight.value * (to.acceleration - self.acceleration),
            peak_speed,
        }
    }
}

/// A weight between 0 and 1 with its first and second derivative by time.
#[derive(Clone, Copy)]
pub(crate) struct Weight {
    value: f64,
    rate: f64,
    curve: f64,
}

impl Weight {
    /// The minimum-jerk curve from 0 at `t = 0` to 1 at `t = duration`, constant outside.
    pub(crate) fn rising(t: f64, duration: f64) -> Self {
        if t <= 0.0 {
            return Self { value: 0.0, rate: 0.0, curve: 0.0 };
        }
        if t >= duration {
            return Self { value: 1.0, rate: 0.0, curve: 0.0 };
        }
        let x = t / duration;
        Self {
            value: x * x * x * (10.0 + x * (6.0 * x - 15.0)),
            rate: 30.0 * x * x * (1.0 - x) * (1.0 - x) / duration,
            curve: 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (duration * duration),
        }
    }
}

/// From rest at `from` to rest at `to` within `duration`, minimum jerk.
fn min_jerk(from: f64, to: f64, t: f64, duration: f64) -> Point {
    let peak_speed = MIN_JERK_PEAK_SPEED * (to - from).abs() / duration;
    Point::at_rest(from).blend(Point::at_rest(to), Weight::rising(t, duration), peak_speed)
}

/// What the trajectory passes through when somebody stops it: towards rest at `hold` over `fade_s`,
/// beginning at once. While it fades, the movement goes on underneath; the blend stays between the
/// two.
pub fn stopping(moving: Point, hold: f64, since_stop_s: f64, fade_s: f64) -> Point {
    moving.blend(Point::at_rest(hold), Weight::rising(since_stop_s, fade_s), moving.peak_speed)
}

/// A movement made ready to be played: evaluating it allocates nothing.
#[derive(Clone, Debug)]
pub struct Track {
    movement: Movement,
    /// Peak speed of the sines alone, fades left out, or of a table; 0 for other movements.
    sine_peak_speed: f64,
}

impl Track {
    /// Makes a movement ready.
    pub fn new(movement: Movement) -> Self {
        let sine_peak_speed = match &movement {
            Movement::GuidedSine { amplitude, frequency_hz, .. } => amplitude * TAU * frequency_hz,
            Movement::Multisine { lines, duration_s, .. } => sampled_peak_speed(lines, *duration_s),
            Movement::Learn(learn) => learn.amplitude * TAU * learn.frequency_hz,
            Movement::Chirp(chirp) => chirp.amplitude * TAU * chirp.highest_hz(),
            Movement::File(table) => table.spline.peak_speed(),
            _ => 0.0,
        };
        Self { movement, sine_peak_speed }
    }

    /// The movement.
    pub fn movement(&self) -> &Movement {
        &self.movement
    }

    /// Whole duration (s).
    pub fn duration_s(&self) -> f64 {
        self.movement.duration_s()
    }

    /// What control shall do at time `t` into the movement (s).
    pub fn mode(&self, t: f64) -> Mode {
        match &self.movement {
            Movement::Rest { .. } => Mode::Passive,
            Movement::Free { .. } => Mode::Impedance,
            Movement::Learn(_) => Mode::Learning,
            Movement::Initialise(_) => Mode::Initialise,
            Movement::Centre(centre) if t >= centre.rise_s => Mode::Centre,
            Movement::Rhythm(_) => Mode::Rhythm,
            Movement::Hold { position: None, .. } => Mode::Hold,
            Movement::Hold { position: Some(_), rise_s, .. } if t >= *rise_s => Mode::Hold,
            _ => Mode::Position,
        }
    }

    /// The axis at time `t` (s) into the movement that began at rest at `start` (rad or m). Before
    /// its beginning and after its end it is at rest.
    pub fn at(&self, start: f64, t: f64) -> Point {
        let t = t.clamp(0.0, self.duration_s());
        match &self.movement {
            Movement::GuidedSine {
                amplitude,
                frequency_hz,
                duration_s,
                centre,
                fade_in_s,
                fade_out_s,
            } => {
                let line = Line { amplitude: *amplitude, frequency_hz: *frequency_hz, phase: 0.0 };
                self.faded(
                    sum(&[line], *centre, t),
                    *centre,
                    start,
                    t,
                    (*duration_s, *fade_in_s, *fade_out_s),
                )
            }
            Movement::Multisine { lines, duration_s, centre, fade_in_s, fade_out_s } => self.faded(
                sum(lines, *centre, t),
                *centre,
                start,
                t,
                (*duration_s, *fade_in_s, *fade_out_s),
            ),
            Movement::Steps { positions, dwell_s, rise_s } => {
                let each = rise_s + dwell_s;
                let index = ((t / each) as usize).min(positions.len().saturating_sub(1));
                let Some(to) = positions.get(index) else { return Point::at_rest(start) };
                let from = index
                    .checked_sub(1)
                    .and_then(|before| positions.get(before))
                    .copied()
                    .unwrap_or(start);
                min_jerk(from, *to, t - index as f64 * each, *rise_s)
            }
            Movement::Hold { position: Some(position), rise_s, .. } if t < *rise_s => {
                min_jerk(start, *position, t, *rise_s)
            }
            Movement::Hold { position, .. } => Point::at_rest(position.unwrap_or(start)),
            Movement::Rest { .. } => Point::at_rest(start),
            // Before anything is learnt; the lesson knows better.
            Movement::Learn(learn) => {
                let line = Line {
                    amplitude: learn.amplitude,
                    frequency_hz: learn.frequency_hz,
                    phase: 0.0,
                };
                let sine = sum(&[line], learn.centre, t - learn.fade_in_s);
                self.faded(
                    sine,
                    learn.centre,
                    start,
                    t,
                    (learn.duration_s(), learn.fade_in_s, learn.fade_out_s),
                )
            }
            // What the field is about, not where the handle is.
            Movement::Free { field, .. } => Point::at_rest(field.centre),
            Movement::Rhythm(rhythm) => Point::at_rest(rhythm.field.centre),
            // Where the search is depends on what is measured: `range::RangeFinder` says.
            Movement::Initialise(_) => Point::at_rest(start),
            Movement::Centre(centre) if t < centre.rise_s => {
                min_jerk(start, centre.position, t, centre.rise_s)
            }
            Movement::Centre(centre) => Point::at_rest(centre.position),
            Movement::Ramp(ramp) => excitation::ramp(ramp, start, t),
            Movement::Chirp(chirp) => {
                let times = (chirp.duration_s, chirp.fade_in_s, chirp.fade_out_s);
                self.faded(excitation::chirp(chirp, t), chirp.centre, start, t, times)
            }
            Movement::File(table) if t < table.rise_s => {
                min_jerk(start, table.spline.begin(), t, table.rise_s)
            }
            Movement::File(table) => {
                let (position, velocity, acceleration) = table.spline.at(t - table.rise_s);
                Point { position, velocity, acceleration, peak_speed: self.sine_peak_speed }
            }
        }
    }

    /// The force field, if the hand moves in one.
    pub fn field(&self) -> Option<&Field> {
        match &self.movement {
            Movement::Free { field, .. } => Some(field),
            Movement::Rhythm(rhythm) => Some(&rhythm.field),
            _ => None,
        }
    }

    fn faded(
        &self,
        sines: Point,
        centre: f64,
        start: f64,
        t: f64,
        times: (f64, f64, f64),
    ) -> Point {
        let (duration, fade_in, fade_out) = times;
        let out = Weight::rising(t - (duration - fade_out), fade_out);
        let settling = sines.blend(Point::at_rest(centre), out, self.sine_peak_speed);
        Point::at_rest(start).blend(settling, Weight::rising(t, fade_in), self.sine_peak_speed)
    }
}

/// A sum of sines about a centre.
fn sum(lines: &[Line], centre: f64, t: f64) -> Point {
    lines.iter().fold(Point::at_rest(centre), |mut point, line| {
        let omega = TAU * line.frequency_hz;
        let (sin, cos) = (omega * t + line.phase).sin_cos();
        point.position += line.amplitude * sin;
        point.velocity += line.amplitude * omega * cos;
        point.acceleration -= line.amplitude * omega * omega * sin;
        point
    })
}

/// Highest speed of a sum of sines, looked for on a grid of 16 points in the fastest period, at
/// most 20,000 in all: good to a few percent, which is enough for the shape of a feed-forward. The
/// limit on speed does not rest on it.
fn sampled_peak_speed(lines: &[Line], duration_s: f64) -> f64 {
    let fastest = lines.iter().map(|line| line.frequency_hz).fold(0.0, f64::max);
    let points = (16.0 * fastest * duration_s).clamp(16.0, 20_000.0) as usize;
    (0..points)
        .map(|i| sum(lines, 0.0, duration_s * i as f64 / points as f64).velocity.abs())
        .fold(0.0, f64::max)
}
