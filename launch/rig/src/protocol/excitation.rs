//! Movements to find out about the machine: a ramp at constant speed, a sine that passes through
//! the frequencies.

use std::f64::consts::TAU;

use super::lengths::{
    AMPLITUDE_DEG, AMPLITUDE_M, DURATION, LINE_HZ, Lengths, POSITION_DEG, POSITION_M,
};
use super::movement::read_times;
use crate::read::{Bounds, Section, bounds};

/// To a position at constant speed, and rest there under power. Speed comes and goes along the
/// minimum-jerk curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    /// Where to (rad or m).
    pub position: f64,
    /// Speed on the way (rad/s or m/s).
    pub speed: f64,
    /// Time in which the speed comes, and in which it goes (s).
    pub ease_s: f64,
    /// Whole duration (s).
    pub duration_s: f64,
}

/// A ramp from a known start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RampProfile {
    /// Constant speed (rad/s or m/s); less than asked for where the way is short.
    pub speed: f64,
    /// Time under way (s).
    pub moving_s: f64,
}

const SPEED_DEG: Bounds = bounds(0.1, 1500.0, "in degrees a second");
const SPEED_M: Bounds = bounds(1e-4, 10.0, "in m/s");

impl Ramp {
    pub(super) fn read(section: &Section<'_>, lengths: &mut Lengths<'_, '_>) -> Self {
        Self {
            position: lengths.required("position", POSITION_DEG, POSITION_M),
            speed: lengths.speed("speed", SPEED_DEG, SPEED_M),
            ease_s: section.number_or("ease_s", 0.2, bounds(0.02, 10.0, "in seconds")),
            duration_s: section.number("duration_s", DURATION),
        }
    }

    /// The ramp that begins at `start` (rad or m).
    pub fn profile(&self, start: f64) -> RampProfile {
        let way = (self.position - start).abs();
        let speed = self.speed.min(way / self.ease_s);
        let moving_s = if speed > 0.0 { way / speed + self.ease_s } else { 0.0 };
        RampProfile { speed, moving_s }
    }
}

/// A sine about a centre of which the frequency goes from one value to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chirp {
    /// Amplitude (rad or m).
    pub amplitude: f64,
    /// Frequency at the beginning and at the end (Hz).
    pub frequencies_hz: [f64; 2],
    /// Whether it grows by equal factors in equal times; else by equal steps.
    pub exponential: bool,
    /// Centre (rad or m).
    pub centre: f64,
    /// Whole duration, fades included (s).
    pub duration_s: f64,
    /// Time from the position at the start into the full movement (s).
    pub fade_in_s: f64,
    /// Time from the full movement to rest at the centre (s).
    pub fade_out_s: f64,
}

impl Chirp {
    pub(super) fn read(section: &Section<'_>, lengths: &mut Lengths<'_, '_>) -> Self {
        let (duration_s, fade_in_s, fade_out_s) = read_times(section);
        Self {
            amplitude: lengths.required("amplitude", AMPLITUDE_DEG, AMPLITUDE_M),
            frequencies_hz: [section.number("from_hz", LINE_HZ), section.number("to_hz", LINE_HZ)],
            exponential: section
                .word_or_none("sweep", &[("linear", false), ("exponential", true)])
                .unwrap_or(true),
            centre: lengths.optional("centre", POSITION_DEG, POSITION_M).unwrap_or(0.0),
            duration_s,
            fade_in_s,
            fade_out_s,
        }
    }

    /// The higher of its two frequencies (Hz).
    pub fn highest_hz(&self) -> f64 {
        self.frequencies_hz[0].max(self.frequencies_hz[1])
    }

    pub(super) fn range(&self) -> (f64, f64) {
        (self.centre - self.amplitude, self.centre + self.amplitude)
    }

    /// Phase (rad), angular frequency (rad/s) and its rate (rad/s²) at a time (s).
    pub fn phase(&self, time_s: f64) -> (f64, f64, f64) {
        let [from, to] = self.frequencies_hz.map(|hertz| TAU * hertz);
        let growth = (to / from).ln();
        if self.exponential && growth.abs() > 1e-9 {
            let rate = growth / self.duration_s;
            let omega = from * (rate * time_s).exp();
            ((omega - from) / rate, omega, omega * rate)
        } else {
            let rate = (to - from) / self.duration_s;
            (time_s * (from + 0.5 * rate * time_s), from + rate * time_s, rate)
        }
    }
}
