//! `guided_sine`: a sine about a centre.

use std::f64::consts::{PI, TAU};

use crate::checked_toml::{Bounds, Keys, Section, bounds};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::sines::{Envelope, Line, sum};
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::UnitKeys;

/// A sine about a centre.
#[derive(Clone, Debug, PartialEq)]
pub struct GuidedSine {
    /// Amplitude, frequency and phase; the phase is 0 but for coupled axes.
    pub line: Line,
    /// Centre, duration and fades.
    pub envelope: Envelope,
}

const GUIDED_HZ: Bounds = bounds(
    0.005,
    3.0,
    "guided movements are of 0.2 to 3 Hz (appendix); slow ones down to 0.008 Hz show friction \
     (§ 5.2.2)",
);

pub(super) const KEYS: Keys = &[
    ("amplitude_{deg,m}", "Amplitude, to either side of the centre."),
    ("frequency_hz", "Frequency."),
    ("duration_s", "Whole duration, fades included."),
    ("centre_{deg,m}", "Centre of the sine; 0, if left out."),
    ("fade_in_s", "Time of the blend from the start position into the sine."),
    ("fade_out_s", "Time of the blend from the sine to rest at the centre."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> GuidedSine {
    let envelope = Envelope::read(section);
    let amplitude = keys.amplitude("amplitude");
    let frequency_hz = section.number("frequency_hz", GUIDED_HZ);
    let line = Line { amplitude, frequency_hz, phase: 0.0 };
    GuidedSine { line, envelope: envelope.about(keys.position("centre")) }
}

impl SegmentKind for GuidedSine {
    fn duration_s(&self) -> f64 {
        self.envelope.duration_s
    }

    fn range(&self) -> Option<(f64, f64)> {
        self.envelope.range(self.line.amplitude)
    }

    fn target(&self) -> Option<f64> {
        Some(self.envelope.centre)
    }

    fn peak_speed_from(&self, start: f64) -> f64 {
        self.envelope.peak_speed_from(start, self.line.amplitude, self.feedforward_speed())
    }

    fn feedforward_speed(&self) -> f64 {
        self.line.amplitude * TAU * self.line.frequency_hz
    }

    fn at(&self, start: f64, time_s: f64, peak_speed: f64) -> Point {
        let sine = sum(&[self.line], self.envelope.centre, time_s);
        self.envelope.apply(sine, start, time_s, peak_speed)
    }

    fn advance_phase(&mut self, phase: f64) -> bool {
        self.line.phase += phase;
        true
    }

    fn scale(&mut self, factor: f64) -> Result<(), (&'static str, &'static str)> {
        self.line.amplitude *= factor.abs();
        if factor <= 0.0 {
            self.line.phase += PI;
        }
        self.envelope.centre *= factor;
        Ok(())
    }
}
