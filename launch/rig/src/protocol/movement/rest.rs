//! `rest`: no output.

use ipc_types::Mode;

use crate::checked_toml::{Keys, Section};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::{DURATION, UnitKeys};

/// 0 V at the motor; the handle stays or is moved by hand.
#[derive(Clone, Debug, PartialEq)]
pub struct Rest {
    /// Duration (s).
    pub duration_s: f64,
}

pub(super) const KEYS: Keys = &[("duration_s", "Duration.")];

pub(super) fn read(section: &Section<'_>, _keys: &mut UnitKeys<'_, '_>) -> Rest {
    Rest { duration_s: section.number("duration_s", DURATION) }
}

impl SegmentKind for Rest {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn end_is_unknown(&self) -> bool {
        true
    }

    fn mode(&self, _time_s: f64) -> Mode {
        Mode::Passive
    }

    fn at(&self, start: f64, _time_s: f64, _peak_speed: f64) -> Point {
        Point::at_rest(start)
    }
}
