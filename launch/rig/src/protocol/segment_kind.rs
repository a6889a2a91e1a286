//! What every kind of segment provides: its duration, its bounds, its checks and its trajectory.

use ipc_types::Mode;

use super::field::Field;
use super::trajectory::Point;
use crate::axis::Axis;
use crate::axis_unit::AxisUnit;
use crate::checked_toml::Source;
use crate::rig_file::RigFile;

/// A kind of segment. Positions are in rad or m by the axis's unit, times in s from the segment's
/// start.
///
/// Every movement begins at rest where the previous one ended, and ends at rest.
pub trait SegmentKind {
    /// Whole duration (s).
    fn duration_s(&self) -> f64;

    /// Position at which the movement ends wherever it begins (rad or m); `None` where there is no
    /// such position.
    fn target(&self) -> Option<f64> {
        None
    }

    /// Bounds of the positions: the axis stays in the hull of them and its start (rad or m).
    /// `None` where the movement has no bounds of its own.
    fn range(&self) -> Option<(f64, f64)> {
        self.target().map(|target| (target, target))
    }

    /// End position of a movement that begins at `start` (rad or m); `None` where it is unknown.
    fn end(&self, _start: Option<f64>) -> Option<f64> {
        self.target()
    }

    /// Whether the hand or the machine's stops determine where the axes are at the end.
    fn end_is_unknown(&self) -> bool {
        self.field().is_some()
    }

    /// An upper bound of the speed when the movement begins at rest at `start` (rad/s or m/s).
    fn peak_speed_from(&self, _start: f64) -> f64 {
        0.0
    }

    /// Peak speed of the full movement without its fades, for the feed-forward (rad/s or m/s); may
    /// be expensive, so callers compute it once.
    fn feedforward_speed(&self) -> f64 {
        0.0
    }

    /// Mode of the setpoints at a time (s).
    fn mode(&self, _time_s: f64) -> Mode {
        Mode::Position
    }

    /// The reference at a time from 0 to the duration (s) for a movement that begins at rest at
    /// `start`; `peak_speed` is [`SegmentKind::feedforward_speed`]. Must not allocate.
    fn at(&self, start: f64, time_s: f64, peak_speed: f64) -> Point;

    /// The force field, where the hand moves in one; it is checked against the rig.
    fn field(&self) -> Option<&Field> {
        None
    }

    /// Limit on the output during the segment (V); `None` for the rig's own.
    fn output_limit_v(&self) -> Option<f64> {
        None
    }

    /// Checks the segment against its axis and the rig, after the range and before the speed;
    /// reports problems and returns false where there are any.
    fn check(&self, _placed: &Placement<'_>) -> bool {
        true
    }

    /// Whether the segment moves a single axis only.
    fn single_axis(&self) -> bool {
        false
    }

    /// Advances the phase of a sine (rad); false for other movements.
    fn advance_phase(&mut self, _phase: f64) -> bool {
        false
    }

    /// Multiplies amplitudes and positions; a negative factor mirrors the movement.
    ///
    /// # Errors
    /// What was expected, and what to do, where the movement cannot be scaled so.
    fn scale(&mut self, _factor: f64) -> Result<(), (&'static str, &'static str)> {
        Err(("a movement of the machine", "take it out"))
    }
}

/// A segment on an axis of a rig.
pub struct Placement<'a> {
    pub(crate) rig: &'a RigFile,
    pub(crate) axis: &'a Axis,
    /// Index of the axis.
    pub(crate) index: usize,
    /// The segment's section in the file.
    pub(crate) section: &'a str,
    /// Position at its start (rad or m); `None` where it is unknown.
    pub(crate) start: Option<f64>,
    pub(crate) source: &'a Source<'a>,
}

impl Placement<'_> {
    /// Path of one of the segment's keys.
    pub(crate) fn key(&self, name: &str) -> String {
        format!("{}.{name}", self.section)
    }

    /// The first of these keys that is in the file, else `kind`.
    pub(crate) fn first_key<'k>(&self, names: impl IntoIterator<Item = &'k str>) -> String {
        let mut keys = names.into_iter().map(|name| self.key(name));
        keys.find(|key| self.source.has(key)).unwrap_or_else(|| self.key("kind"))
    }

    /// A position in the file's unit.
    pub(crate) fn show(&self, si: f64) -> String {
        match self.axis.unit {
            AxisUnit::Radian => format!("{:.1}°", si.to_degrees()),
            AxisUnit::Metre => format!("{si:.4} m"),
        }
    }

    /// The largest value of a function of the start position: at the start where it is known, else
    /// over the position limits.
    pub(crate) fn worst_start(&self, of: impl Fn(f64) -> f64) -> f64 {
        let limits = &self.axis.limits;
        match self.start {
            Some(start) => of(start),
            None => of(limits.position_min).max(of(limits.position_max)),
        }
    }
}
