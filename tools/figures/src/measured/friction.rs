//! Friction of a recorded sine: against position where it is slow, and at its highest speed.

use std::f64::consts::TAU;

use rig::protocol::GuidedSine;
use serde::Serialize;

use super::trace::Trace;

/// Fastest sine that shows friction against position, Hz: the thesis has 0.008 and 0.03.
const SLOW_HZ: f64 = 0.1;
/// Stretches of the position, each with a mean.
const STRETCHES: usize = 40;
/// Samples that a mean needs.
const LEAST_SAMPLES: usize = 20;
/// Share of the highest speed that counts as such: the middle fifth of a stroke, where the motor
/// hardly accelerates.
const FASTEST: f64 = 0.95;

/// Torque of the motor in one direction.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct Direction {
    /// Handle, rad, and mean torque there, N·m.
    pub(super) position_rad: Vec<f64>,
    pub(super) torque_nm: Vec<f64>,
    /// Mean magnitude over the second half of each stroke, N·m.
    pub(super) mean_nm: f64,
}

/// Friction against position, forward and backward.
#[derive(Clone, Debug, Serialize)]
pub(super) struct FrictionMap {
    pub(super) directions: [Direction; 2],
}

/// Mean torque of the motor at the highest speed of a sine.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct SpeedPoint {
    pub(super) speed_rad_s: f64,
    /// Forward and backward, N·m.
    pub(super) torque_nm: [f64; 2],
}

/// Whether a sine is slow enough for a map.
pub(super) fn is_slow(sine: &GuidedSine) -> bool {
    sine.line.frequency_hz <= SLOW_HZ
}

/// A sample of a settled sine: its index, its direction (0 forward), and how far its stroke is, 0
/// to 1.
fn strokes(trace: &Trace, sine: &GuidedSine) -> impl Iterator<Item = (usize, usize, f64)> {
    let [_, speed] = &trace.smooth;
    let settled = trace.settled(&sine.envelope);
    let begin = settled.start;
    // The reference is a sine from the segment's beginning on.
    let omega = TAU * sine.line.frequency_hz / trace.rate_hz;
    let period = TAU / omega;
    settled.filter_map(move |at| {
        // A stroke begins a quarter of a period before the middle.
        let stroke = 2.0 * (omega * at as f64 / TAU + 0.25);
        let direction = (stroke.floor() as i64).rem_euclid(2) as usize;
        // The first stroke began before the movement was settled.
        let whole = (0.5 * stroke.floor() - 0.25) * period >= begin as f64;
        let moves = speed.get(at).is_some_and(|speed| (*speed < 0.0) == (direction == 1));
        (whole && moves).then(|| (at, direction, stroke.fract()))
    })
}

/// A mean that is being taken.
#[derive(Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    /// The mean of so many values at least.
    fn of(self, least: usize) -> Option<f64> {
        (self.count >= least).then(|| self.sum / self.count as f64)
    }
}

/// Friction against position; `None` where no stroke is whole.
pub(super) fn map(trace: &Trace, sine: &GuidedSine) -> Option<FrictionMap> {
    let handle = trace.handle();
    let within = |low: f64, high: f64, value: f64| (low.min(value), high.max(value));
    let (low, high) = strokes(trace, sine)
        .fold((f64::MAX, f64::MIN), |(low, high), (at, ..)| within(low, high, handle[at]));
    if high <= low {
        return None;
    }
    let mut means = [[Mean::default(); STRETCHES]; 2];
    let mut later = [Mean::default(); 2];
    for (at, direction, share) in strokes(trace, sine) {
        let stretch = ((handle[at] - low) / (high - low) * STRETCHES as f64) as usize;
        means[direction][stretch.min(STRETCHES - 1)].add(trace.motor_nm[at]);
        // A soft line is wound up for a good part of each stroke.
        if share > 0.5 {
            later[direction].add(trace.motor_nm[at].abs());
        }
    }
    let of = |direction: usize| {
        let mut found = Direction::default();
        for (stretch, mean) in means[direction].iter().enumerate() {
            if let Some(torque_nm) = mean.of(LEAST_SAMPLES) {
                let middle = (stretch as f64 + 0.5) / STRETCHES as f64;
                found.position_rad.push(low + middle * (high - low));
                found.torque_nm.push(torque_nm);
            }
        }
        found.mean_nm = later[direction].of(1).unwrap_or(f64::NAN);
        found
    };
    Some(FrictionMap { directions: [of(0), of(1)] })
}

/// Torque at the highest speed; `None` where a direction never reached it.
pub(super) fn at_speed(trace: &Trace, sine: &GuidedSine) -> Option<SpeedPoint> {
    let [_, speed] = &trace.smooth;
    let highest = TAU * sine.line.frequency_hz * sine.line.amplitude;
    let mut means = [Mean::default(); 2];
    for (at, direction, share) in strokes(trace, sine) {
        // The speed of a stroke's middle, by its place: it is noisy where it is slow.
        if (std::f64::consts::PI * share).sin() > FASTEST && speed[at].abs() > 0.2 * highest {
            means[direction].add(trace.motor_nm[at]);
        }
    }
    let [forward, backward] = means.map(|mean| mean.of(LEAST_SAMPLES));
    Some(SpeedPoint { speed_rad_s: highest, torque_nm: [forward?, backward?] })
}
