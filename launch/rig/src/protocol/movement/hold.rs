//! `hold`: to a position, and rest there under power.

use ipc_types::Mode;

use crate::checked_toml::{Keys, Section};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::trajectory::{Point, min_jerk, min_jerk_peak_speed};
use crate::protocol::unit_keys::{DURATION, FADE, UnitKeys};

/// Moves to a position and rests there under power.
#[derive(Clone, Debug, PartialEq)]
pub struct Hold {
    /// Position; `None`: where the handle is (rad or m).
    pub position: Option<f64>,
    /// Time of the movement there, within the duration (s).
    pub rise_s: f64,
    /// Whole duration (s).
    pub duration_s: f64,
    /// Mode of the setpoints at rest.
    pub resting: Mode,
}

pub(super) const KEYS: Keys = &[
    ("position_{deg,m}", "Position; where the handle is, if left out."),
    ("rise_s", "Time of the movement there, part of the duration."),
    ("duration_s", "Whole duration."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Hold {
    let (duration_s, rise_s) = read_times(section, 1.0);
    Hold { position: keys.position("position"), rise_s, duration_s, resting: Mode::Hold }
}

/// Reads `duration_s`, and `rise_s`, which is part of it and by default `rise_s`, but at most half
/// of it (s).
pub(super) fn read_times(section: &Section<'_>, rise_s: f64) -> (f64, f64) {
    let duration_s = section.number("duration_s", DURATION);
    let rise_s = section.number_or("rise_s", f64::min(rise_s, duration_s / 2.0), FADE);
    if rise_s > duration_s {
        let expected = format!("at most duration_s ({duration_s} s)");
        section.problem("rise_s", expected, rise_s, "the rise is part of the duration");
    }
    (duration_s, rise_s)
}

impl SegmentKind for Hold {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn target(&self) -> Option<f64> {
        self.position
    }

    fn end(&self, start: Option<f64>) -> Option<f64> {
        self.position.or(start)
    }

    fn peak_speed_from(&self, start: f64) -> f64 {
        min_jerk_peak_speed(start, self.position.unwrap_or(start), self.rise_s)
    }

    fn mode(&self, time_s: f64) -> Mode {
        match self.position {
            Some(_) if time_s < self.rise_s => Mode::Position,
            _ => self.resting,
        }
    }

    fn at(&self, start: f64, time_s: f64, _peak_speed: f64) -> Point {
        match self.position {
            Some(position) if time_s < self.rise_s => {
                min_jerk(start, position, time_s, self.rise_s)
            }
            position => Point::at_rest(position.unwrap_or(start)),
        }
    }

    fn scale(&mut self, factor: f64) -> Result<(), (&'static str, &'static str)> {
        self.position = self.position.map(|position| position * factor);
        Ok(())
    }
}
