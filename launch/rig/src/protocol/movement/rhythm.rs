//! `rhythm`: the hand keeps a rhythm in a field of spring and damper (appendix: of a spring).

use ipc_types::Mode;

use crate::checked_toml::{Keys, Section, bounds};
use crate::protocol::field::{DAMPER, Field, SPRING_ADVICE};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::{DURATION, UnitKeys};

/// The hand keeps a rhythm in a field of spring and damper: each half period it should be at the
/// other extreme.
#[derive(Clone, Debug, PartialEq)]
pub struct Rhythm {
    /// Full cycles per second (Hz).
    pub frequency_hz: f64,
    /// Distance from the centre to each extreme (rad or m).
    pub amplitude: f64,
    /// The field, with its spring about the centre.
    pub field: Field,
    /// Whole duration (s).
    pub duration_s: f64,
}

pub(super) const KEYS: Keys = &[
    ("frequency_hz", "Full cycles per second; each has two beats."),
    ("amplitude_{deg,m}", "Distance from the centre to each extreme."),
    ("centre_{deg,m}", "Centre of movement and spring; 0, if left out."),
    ("spring", "Stiffness of the spring, in N·m/rad (N/m on an axis in m)."),
    ("damper", "Damping, in N·m·s/rad or N·s/m; negative feeds energy into the movement."),
    ("duration_s", "Whole duration."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Rhythm {
    let duration_s = section.number("duration_s", DURATION);
    let frequency_hz =
        section.number("frequency_hz", bounds(0.1, 5.0, "a hand keeps up to about 3 Hz"));
    if duration_s * frequency_hz < 1.0 {
        let expected = format!("at least one cycle ({:.1} s)", 1.0 / frequency_hz);
        let found = format!("{duration_s} s");
        section.problem("duration_s", expected, found, "a rhythm needs some beats");
    }
    let stiffness = section.number_or("spring", 0.0, bounds(0.0, 10.0, SPRING_ADVICE));
    Rhythm {
        frequency_hz,
        amplitude: keys.amplitude("amplitude"),
        field: Field {
            stiffness,
            damping: section.number_or("damper", 0.0, DAMPER),
            centre: keys.position("centre").unwrap_or(0.0),
            ..Field::default()
        },
        duration_s,
    }
}

impl Rhythm {
    /// The last beat due at `time_s`: its number from 1, and where the hand should be (rad or m);
    /// `None` before the first. Beats come every half period, the first after half a period at the
    /// upper extreme, the last before the end.
    pub fn beat(&self, time_s: f64) -> Option<(u32, f64)> {
        let last = (2.0 * self.frequency_hz * self.duration_s - 1e-9).ceil() - 1.0;
        let number = (2.0 * self.frequency_hz * time_s + 1e-9).floor().min(last);
        if number < 1.0 {
            return None;
        }
        let side = if number % 2.0 == 1.0 { 1.0 } else { -1.0 };
        Some((number as u32, self.field.centre + side * self.amplitude))
    }
}

impl SegmentKind for Rhythm {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The extremes of the rhythm; the hand may go beyond.
    fn range(&self) -> Option<(f64, f64)> {
        Some((self.field.centre - self.amplitude, self.field.centre + self.amplitude))
    }

    fn mode(&self, _time_s: f64) -> Mode {
        Mode::Rhythm
    }

    /// At rest at the centre of the field.
    fn at(&self, _start: f64, _time_s: f64, _peak_speed: f64) -> Point {
        Point::at_rest(self.field.centre)
    }

    fn field(&self) -> Option<&Field> {
        Some(&self.field)
    }

    fn single_axis(&self) -> bool {
        true
    }
}
