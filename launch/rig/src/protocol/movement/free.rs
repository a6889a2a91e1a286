//! `free`: the hand moves, the machine follows, in a force field (§ 4.2).

use ipc_types::Mode;

use crate::checked_toml::{Keys, Section};
use crate::protocol::field::{FIELD_KEYS, Field};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::{DURATION, UnitKeys};

/// The hand moves as it likes in a force field; the machine follows under force control (§ 4.2).
#[derive(Clone, Debug, PartialEq)]
pub struct Free {
    /// Duration (s).
    pub duration_s: f64,
    /// The force field.
    pub field: Field,
}

pub(super) const KEYS: Keys = FIELD_KEYS;

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Free {
    let centre = keys.position("centre").unwrap_or(0.0);
    let walls = ["wall_min", "wall_max"].map(|stem| keys.position(stem));
    Free {
        duration_s: section.number("duration_s", DURATION),
        field: Field::read(section, centre, walls),
    }
}

impl SegmentKind for Free {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn mode(&self, _time_s: f64) -> Mode {
        Mode::Impedance
    }

    /// At rest at the centre of the field.
    fn at(&self, _start: f64, _time_s: f64, _peak_speed: f64) -> Point {
        Point::at_rest(self.field.centre)
    }

    fn field(&self) -> Option<&Field> {
        Some(&self.field)
    }
}
