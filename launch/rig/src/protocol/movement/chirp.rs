//! `chirp`: a sine whose frequency changes from one value to another.

use std::f64::consts::TAU;

use crate::checked_toml::{Keys, Section};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::sines::Envelope;
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::{LINE_HZ, UnitKeys};

/// A sine about a centre whose frequency changes from one value to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chirp {
    /// Amplitude (rad or m).
    pub amplitude: f64,
    /// Frequency at the start and at the end (Hz).
    pub frequencies_hz: [f64; 2],
    /// Whether the frequency changes exponentially with time; else linearly.
    pub exponential: bool,
    /// Centre, duration and fades.
    pub envelope: Envelope,
}

pub(super) const KEYS: Keys = &[
    ("amplitude_{deg,m}", "Amplitude, to either side of the centre."),
    ("from_hz", "Frequency at the start."),
    ("to_hz", "Frequency at the end."),
    ("sweep", "How the frequency changes with time."),
    ("duration_s", "Whole duration, fades included."),
    ("centre_{deg,m}", "Centre of the movement; 0, if left out."),
    ("fade_in_s", "Time of the blend from the start position into the movement."),
    ("fade_out_s", "Time of the blend from the movement to rest at the centre."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Chirp {
    let envelope = Envelope::read(section);
    let sweeps = &[("linear", false), ("exponential", true)];
    Chirp {
        amplitude: keys.amplitude("amplitude"),
        frequencies_hz: [section.number("from_hz", LINE_HZ), section.number("to_hz", LINE_HZ)],
        exponential: section.word_or("sweep", sweeps, true),
        envelope: envelope.about(keys.position("centre")),
    }
}

impl Chirp {
    /// Phase (rad), angular frequency (rad/s) and its rate (rad/s²) at a time (s).
    pub fn phase(&self, time_s: f64) -> (f64, f64, f64) {
        let [from, to] = self.frequencies_hz.map(|hertz| TAU * hertz);
        let (growth, duration_s) = ((to / from).ln(), self.envelope.duration_s);
        if self.exponential && growth.abs() > 1e-9 {
            let rate = growth / duration_s;
            let omega = from * (rate * time_s).exp();
            ((omega - from) / rate, omega, omega * rate)
        } else {
            let rate = (to - from) / duration_s;
            (time_s * (from + 0.5 * rate * time_s), from + rate * time_s, rate)
        }
    }
}

impl SegmentKind for Chirp {
    fn duration_s(&self) -> f64 {
        self.envelope.duration_s
    }

    fn range(&self) -> Option<(f64, f64)> {
        self.envelope.range(self.amplitude)
    }

    fn target(&self) -> Option<f64> {
        Some(self.envelope.centre)
    }

    fn peak_speed_from(&self, start: f64) -> f64 {
        self.envelope.peak_speed_from(start, self.amplitude, self.feedforward_speed())
    }

    fn feedforward_speed(&self) -> f64 {
        self.amplitude * TAU * self.frequencies_hz[0].max(self.frequencies_hz[1])
    }

    fn at(&self, start: f64, time_s: f64, peak_speed: f64) -> Point {
        let (phase, omega, rate) = self.phase(time_s);
        let (sin, cos) = phase.sin_cos();
        let full = Point {
            position: self.envelope.centre + self.amplitude * sin,
            velocity: self.amplitude * omega * cos,
            acceleration: self.amplitude * (rate * cos - omega * omega * sin),
            peak_speed: 0.0,
        };
        self.envelope.apply(full, start, time_s, peak_speed)
    }

    fn scale(&mut self, factor: f64) -> Result<(), (&'static str, &'static str)> {
        if factor < 0.0 {
            return Err(("0 or more for a chirp", "a chirp cannot be mirrored"));
        }
        self.amplitude *= factor;
        self.envelope.centre *= factor;
        Ok(())
    }
}
