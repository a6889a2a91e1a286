//! `centre`: to the centre of the experiment, and rest there under power (appendix).

use ipc_types::Mode;

use super::hold::read_times;
use crate::checked_toml::{Keys, Section};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::trajectory::{Point, min_jerk, min_jerk_peak_speed};
use crate::protocol::unit_keys::UnitKeys;

/// Moves to the centre of the experiment and rests there under power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Centre {
    /// Its position (rad or m).
    pub position: f64,
    /// Time of the movement there, within the duration (s).
    pub rise_s: f64,
    /// Whole duration (s).
    pub duration_s: f64,
}

impl Centre {
    pub(super) const KEYS: Keys = &[
        ("position_{deg,m}", "Position of the centre; 0, if left out."),
        ("rise_s", "Time of the movement there, part of the duration."),
        ("duration_s", "Whole duration."),
    ];

    pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Self {
        let (duration_s, rise_s) = read_times(section, 3.0);
        let position = keys.position("position").unwrap_or(0.0);
        Self { position, rise_s, duration_s }
    }
}

impl SegmentKind for Centre {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn target(&self) -> Option<f64> {
        Some(self.position)
    }

    fn peak_speed_from(&self, start: f64) -> f64 {
        min_jerk_peak_speed(start, self.position, self.rise_s)
    }

    fn mode(&self, time_s: f64) -> Mode {
        if time_s >= self.rise_s { Mode::Centre } else { Mode::Position }
    }

    fn at(&self, start: f64, time_s: f64, _peak_speed: f64) -> Point {
        if time_s >= self.rise_s {
            return Point::at_rest(self.position);
        }
        min_jerk(start, self.position, time_s, self.rise_s)
    }

    fn scale(&mut self, factor: f64) -> Result<(), (&'static str, &'static str)> {
        self.position *= factor;
        Ok(())
    }
}
