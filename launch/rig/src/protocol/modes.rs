//! The thesis's modules around an experiment: initialise, centre, rhythm (appendix).

use super::field::Field;
use super::lengths::{
    AMPLITUDE_DEG, AMPLITUDE_M, DURATION, FADE, Lengths, POSITION_DEG, POSITION_M,
};
use crate::axis::Axis;
use crate::axis_unit::AxisUnit;
use crate::read::{Bounds, Section, Source, bounds};

/// Gently to the ends of the travel, to find them: to one end until the handle stalls, then to the
/// other.
///
/// The reference goes on at `speed`, within a twentieth of the range's half of the rig's limits. An
/// end is found where the measured position stands still for `still_s` while the reference leads by
/// more than `lead`, or has come to its own end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Initialise {
    /// Speed of the reference (rad/s or m/s).
    pub speed: f64,
    /// The output stays within ± this (V).
    pub volts: f64,
    /// Whether the upper end comes first.
    pub upper_first: bool,
    /// Whether the other end is sought too.
    pub both: bool,
    /// The reference leads by more than this at an end (rad or m).
    pub lead: f64,
    /// How long the handle must stand still (s).
    pub still_s: f64,
    /// A range that ends further within the rig's limits than this is told as a warning (rad or m).
    pub tolerance: f64,
    /// Time limit (s).
    pub duration_s: f64,
}

const SPEED_DEG: Bounds =
    bounds(1.0, 60.0, "gentle: the handle runs against its end; in degrees a second");
const SPEED_M: Bounds = bounds(1e-3, 0.5, "gentle: the handle runs against its end; in m/s");
const LEAD_DEG: Bounds =
    bounds(1.0, 45.0, "more than the handle lags when it moves freely; in degrees");
const LEAD_M: Bounds = bounds(1e-3, 1.0, "more than the handle lags when it moves freely; in m");

/// The reference stays this share of the range away from the rig's limits, so that an overshoot
/// does not trip the watchdog.
const MARGIN_SHARE: f64 = 0.0125;
/// Starting, standing still, and turning, at both ends (s).
const OVERHEAD_S: f64 = 4.0;

impl Initialise {
    pub(super) fn read(section: &Section<'_>, lengths: &mut Lengths<'_, '_>) -> Self {
        let speed = lengths.speed("speed", SPEED_DEG, SPEED_M);
        let metres = lengths.unit == Some(AxisUnit::Metre);
        let ends = &[("both", true), ("first", false)];
        Self {
            speed,
            volts: section.number(
                "volts",
                bounds(0.1, 10.0, "enough to overcome friction, little enough to be held"),
            ),
            upper_first: section
                .word_or_none("first", &[("lower", false), ("upper", true)])
                .unwrap_or(false),
            both: section.word_or_none("ends", ends).unwrap_or(true),
            lead: lengths.optional("lead", LEAD_DEG, LEAD_M).unwrap_or(if metres {
                0.02
            } else {
                8.0_f64.to_radians()
            }),
            still_s: section.number_or("still_s", 0.5, bounds(0.1, 5.0, "in seconds")),
            tolerance: lengths
                .optional("tolerance", AMPLITUDE_DEG, AMPLITUDE_M)
                .unwrap_or(if metres { 0.05 } else { 10.0_f64.to_radians() }),
            duration_s: section.number("duration_s", DURATION),
        }
    }

    /// The ends of the reference's own way for an axis with these limits (rad or m).
    pub fn reach(&self, position_min: f64, position_max: f64) -> (f64, f64) {
        let margin = MARGIN_SHARE * (position_max - position_min);
        (position_min + margin, position_max - margin)
    }

    /// Whether an axis can be driven so.
    pub(super) fn check(
        &self,
        axis: &Axis,
        key: impl Fn(&str) -> String,
        source: &Source<'_>,
    ) -> bool {
        let limit = axis.control.output_limit_v;
        if self.volts > limit {
            let expected = format!("at most control.output_limit_v of the rig file ({limit} V)");
            source.problem(&key("volts"), expected, self.volts, "drive gently against an end");
            return false;
        }
        let (least, most) = (axis.limits.position_min, axis.limits.position_max);
        let ways = if self.both { 2.0 } else { 1.0 };
        let needed = ways * ((most - least) / self.speed + OVERHEAD_S);
        if self.duration_s < needed {
            let expected = format!(
                "at least {:.0} s: from any position to the ends at this speed",
                needed.ceil()
            );
            let advice = "it is a time limit; the segment ends as soon as the ends are found";
            source.problem(&key("duration_s"), expected, format!("{} s", self.duration_s), advice);
            return false;
        }
        true
    }
}

/// To the middle of the experiment, and rest there under power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Centre {
    /// Where it is (rad or m).
    pub position: f64,
    /// Time of the movement there, within the duration (s).
    pub rise_s: f64,
    /// Whole duration (s).
    pub duration_s: f64,
}

impl Centre {
    pub(super) fn read(section: &Section<'_>, lengths: &mut Lengths<'_, '_>) -> Self {
        let duration_s = section.number("duration_s", DURATION);
        let rise_s = section.number_or("rise_s", f64::min(3.0, duration_s / 2.0), FADE);
        if rise_s > duration_s {
            let expected = format!("at most duration_s ({duration_s} s)");
            section.problem("rise_s", expected, rise_s, "the rise is part of the duration");
        }
        let position = lengths.optional("position", POSITION_DEG, POSITION_M).unwrap_or(0.0);
        Self { position, rise_s, duration_s }
    }
}

/// The hand keeps a rhythm in a spring field: each half period it should be at the other extreme.
#[derive(Clone, Debug, PartialEq)]
pub struct Rhythm {
    /// Full cycles a second (Hz).
    pub frequency_hz: f64,
    /// How far from the centre the hand should go (rad or m).
    pub amplitude: f64,
    /// What the hand feels, about the centre.
    pub field: Field,
    /// Whole duration (s).
    pub duration_s: f64,
}

impl Rhythm {
    pub(super) fn read(section: &Section<'_>, lengths: &mut Lengths<'_, '_>) -> Self {
        let duration_s = section.number("duration_s", DURATION);
        let frequency_hz =
            section.number("frequency_hz", bounds(0.1, 5.0, "a hand keeps up to about 3 Hz"));
        if duration_s * frequency_hz < 1.0 {
            let expected = format!("at least one cycle ({:.1} s)", 1.0 / frequency_hz);
            section.problem(
                "duration_s",
                expected,
                format!("{duration_s} s"),
                "a rhythm needs some beats",
            );
        }
        let stiffness = section.number_or(
            "spring",
            0.0,
            bounds(0.0, 10.0, "N·m/rad, or N/m on an axis in m; the thesis's screen has 0.1 to 2"),
        );
        Self {
            frequency_hz,
            amplitude: lengths.required("amplitude", AMPLITUDE_DEG, AMPLITUDE_M),
            field: Field {
                stiffness,
                centre: lengths.optional("centre", POSITION_DEG, POSITION_M).unwrap_or(0.0),
                ..Field::default()
            },
            duration_s,
        }
    }

    /// The beat that is due at `time_s` into the segment: its number from 1, and where the hand
    /// should be (rad or m). Beats come each half period, the first after half of one, on the upper
    /// side, the last before the end; `None` before.
    pub fn beat(&self, time_s: f64) -> Option<(u32, f64)> {
        let last = (2.0 * self.frequency_hz * self.duration_s - 1e-9).ceil() - 1.0;
        let number = (2.0 * self.frequency_hz * time_s + 1e-9).floor().min(last);
        if number < 1.0 {
            return None;
        }
        let side = if number % 2.0 == 1.0 { 1.0 } else { -1.0 };
        Some((number as u32, self.field.centre + side * self.amplitude))
    }

    /// The extremes between which the hand goes (rad or m).
    pub fn range(&self) -> (f64, f64) {
        (self.field.centre - self.amplitude, self.field.centre + self.amplitude)
    }
}
