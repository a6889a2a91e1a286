//! `free`: the hand moves, the machine follows, in a force field (§ 4.2).

use ipc_types::Mode;

use crate::protocol::field::{FIELD_KEYS, Field};
use crate::protocol::field_check::check_field;
use crate::protocol::segment_kind::{Placement, SegmentKind};
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::{DURATION, POSITION_DEG, POSITION_M, UnitKeys};
use crate::read::{Keys, Section};

/// The hand moves as it likes in a force field; the machine follows under force control (§ 4.2).
#[derive(Clone, Debug, PartialEq)]
pub struct Free {
    /// Duration (s).
    pub duration_s: f64,
    /// The force field.
    pub field: Field,
}

impl Free {
    pub(super) const KEYS: Keys = FIELD_KEYS;

    pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Self {
        let mut position = |stem| keys.optional(stem, POSITION_DEG, POSITION_M);
        let centre = position("centre").unwrap_or(0.0);
        let walls = ["wall_min", "wall_max"].map(&mut position);
        Self {
            duration_s: section.number("duration_s", DURATION),
            field: Field::read(section, centre, walls),
        }
    }
}

impl SegmentKind for Free {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn end_is_unknown(&self) -> bool {
        true
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

    fn check(&self, placed: &Placement<'_>) -> bool {
        check_field(&self.field, placed)
    }
}
