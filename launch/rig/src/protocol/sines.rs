//! Sines that fade in from rest and fade out to rest at their centre.

use std::f64::consts::TAU;

use super::trajectory::{MIN_JERK_PEAK_SPEED, Point, Weight};
use super::unit_keys::{DURATION, FADE};
use crate::checked_toml::Section;

/// One sine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Amplitude (rad or m).
    pub amplitude: f64,
    /// Frequency (Hz).
    pub frequency_hz: f64,
    /// Phase at the segment's start (rad).
    pub phase: f64,
}

/// A sum of sines about a centre, `t` after the segment's start (s).
pub(super) fn sum(lines: &[Line], centre: f64, t: f64) -> Point {
    lines.iter().fold(Point::at_rest(centre), |mut point, line| {
        let omega = TAU * line.frequency_hz;
        let (sin, cos) = (omega * t + line.phase).sin_cos();
        point.position += line.amplitude * sin;
        point.velocity += line.amplitude * omega * cos;
        point.acceleration -= line.amplitude * omega * omega * sin;
        point
    })
}

/// Duration and fades of a movement about a centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Envelope {
    /// Centre (rad or m).
    pub centre: f64,
    /// Whole duration, fades included (s).
    pub duration_s: f64,
    /// Time of the blend from the start position into the full movement (s).
    pub fade_in_s: f64,
    /// Time of the blend from the full movement to rest at the centre (s).
    pub fade_out_s: f64,
}

impl Envelope {
    /// Reads `duration_s` and the fades, which share the duration; the centre is 0.
    pub(super) fn read(section: &Section<'_>) -> Self {
        let duration_s = section.number("duration_s", DURATION);
        let fade_in_s = section.number_or("fade_in_s", f64::min(1.0, duration_s / 2.0), FADE);
        let fade_out_s =
            section.number_or("fade_out_s", f64::min(fade_in_s, duration_s / 2.0), FADE);
        if fade_in_s + fade_out_s > duration_s {
            let fades = section.has("fade_in_s") || section.has("fade_out_s");
            let key = if fades { "fade_in_s" } else { "duration_s" };
            let expected = format!("fades of at most duration_s ({duration_s} s) together");
            let found = format!("{fade_in_s} s and {fade_out_s} s");
            let advice = "fade_out_s is as long as fade_in_s where it is not given";
            section.problem(key, expected, found, advice);
        }
        Self { centre: 0.0, duration_s, fade_in_s, fade_out_s }
    }

    /// The same about another centre (rad or m; 0 for `None`).
    pub(super) fn about(self, centre: Option<f64>) -> Self {
        Self { centre: centre.unwrap_or(0.0), ..self }
    }

    /// Fades a movement in from rest at `start` and out to rest at the centre, `t` after the
    /// segment's start (s).
    pub(super) fn apply(&self, full: Point, start: f64, t: f64, peak_speed: f64) -> Point {
        let out = Weight::rising(t - (self.duration_s - self.fade_out_s), self.fade_out_s);
        let settling = full.blend(Point::at_rest(self.centre), out, peak_speed);
        Point::at_rest(start).blend(settling, Weight::rising(t, self.fade_in_s), peak_speed)
    }

    /// A bound of the speed (rad/s or m/s) that begins at rest at `start`: the movement's own
    /// `speed` and the fades at their worst together.
    pub(super) fn peak_speed_from(&self, start: f64, amplitude: f64, speed: f64) -> f64 {
        let fading_in =
            MIN_JERK_PEAK_SPEED * ((self.centre - start).abs() + amplitude) / self.fade_in_s;
        let fading_out = MIN_JERK_PEAK_SPEED * amplitude / self.fade_out_s;
        speed + fading_in.max(fading_out)
    }

    /// The range of a movement of this amplitude (rad or m).
    pub(super) fn range(&self, amplitude: f64) -> Option<(f64, f64)> {
        Some((self.centre - amplitude, self.centre + amplitude))
    }
}
