//! `steps`: from position to position.

use crate::checked_toml::{Keys, Section};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::trajectory::{MIN_JERK_PEAK_SPEED, Point, min_jerk};
use crate::protocol::unit_keys::{DURATION, FADE, POSITION_DEG, POSITION_M, UnitKeys};

/// Minimum-jerk movements from position to position, with a rest at each.
#[derive(Clone, Debug, PartialEq)]
pub struct Steps {
    /// Target positions, in order (rad or m).
    pub positions: Vec<f64>,
    /// Rest at each (s).
    pub dwell_s: f64,
    /// Time of each movement (s).
    pub rise_s: f64,
}

pub(super) const KEYS: Keys = &[
    ("positions_{deg,m}", "Target positions, in order."),
    ("dwell_s", "Rest at each position."),
    ("rise_s", "Time of each minimum-jerk movement."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Steps {
    Steps {
        positions: keys.list("positions", POSITION_DEG, POSITION_M),
        dwell_s: section.number("dwell_s", DURATION),
        rise_s: section.number_or("rise_s", 1.0, FADE),
    }
}

impl SegmentKind for Steps {
    fn duration_s(&self) -> f64 {
        self.positions.len() as f64 * (self.dwell_s + self.rise_s)
    }

    fn range(&self) -> Option<(f64, f64)> {
        let least = self.positions.iter().copied().fold(f64::INFINITY, f64::min);
        Some((least, self.positions.iter().copied().fold(f64::NEG_INFINITY, f64::max)))
    }

    fn end(&self, _start: Option<f64>) -> Option<f64> {
        self.positions.last().copied()
    }

    fn peak_speed_from(&self, start: f64) -> f64 {
        let starts = std::iter::once(start).chain(self.positions.iter().copied());
        let longest =
            starts.zip(&self.positions).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
        MIN_JERK_PEAK_SPEED * longest / self.rise_s
    }

    fn at(&self, start: f64, time_s: f64, _peak_speed: f64) -> Point {
        let each = self.rise_s + self.dwell_s;
        let index = ((time_s / each) as usize).min(self.positions.len().saturating_sub(1));
        let Some(to) = self.positions.get(index) else { return Point::at_rest(start) };
        let before = index.checked_sub(1).and_then(|before| self.positions.get(before));
        let from = before.copied().unwrap_or(start);
        min_jerk(from, *to, time_s - index as f64 * each, self.rise_s)
    }

    fn scale(&mut self, factor: f64) -> Result<(), (&'static str, &'static str)> {
        self.positions.iter_mut().for_each(|position| *position *= factor);
        Ok(())
    }
}
