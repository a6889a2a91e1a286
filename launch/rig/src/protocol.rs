//! Protocols: what an experiment does, as a list of timed movements.
//!
//! ```toml
//! [protocol]
//! name = "guided"
//!
//! [[segments]]
//! kind = "guided_sine"
//! amplitude_deg = 30.0
//! frequency_hz = 1.0
//! duration_s = 20.0
//! ```
//!
//! A protocol alone knows no machine; [`Protocol::check_against`] holds it against a rig's axes and
//! limits.

mod excitation;
mod field;
mod field_stability;
mod learn;
mod lengths;
mod matrix;
mod modes;
mod movement;
mod overrides;
mod spline;
mod table;
mod tabled;
mod together;

use std::path::Path;

pub use excitation::{Chirp, Ramp, RampProfile};
pub use field::Field;
use field::torque_symbol;
pub use learn::{IDENTIFYING_CYCLES, Learn, LearnLaw};
pub use matrix::{MATRIX_AXES, Matrix};
pub use modes::{Centre, Initialise, Rhythm};
pub use movement::{Line, MIN_JERK_PEAK_SPEED, Movement, MovementKind};
pub use overrides::with_overrides;
pub use spline::Spline;
pub use table::{POINTS, Table};
pub use tabled::Tabled;
pub use together::Companion;

use crate::axis::Axis;
use crate::axis_unit::AxisUnit;
use crate::error::ProtocolError;
use crate::identity::identity;
use crate::read::{Section, Source};
use crate::rig_file::RigFile;

/// Most segments that a protocol plays, repeats counted.
const SEGMENTS: usize = 10_000;
/// Longest protocol (s).
const LONGEST_S: f64 = 86_400.0;

/// A checked protocol.
#[derive(Clone, Debug, PartialEq)]
pub struct Protocol {
    /// Name.
    pub name: String,
    /// What it is for.
    pub description: String,
    /// How often the whole list is played.
    pub repeat: u32,
    /// The segments, as in the file.
    pub segments: Vec<Segment>,
    text: String,
    file_name: String,
    identity: u64,
}

/// One timed movement of one axis, or of several together; the other axes stay where they are.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Name on screens and in events.
    pub label: String,
    /// The axis that moves.
    pub axis: usize,
    /// Unit in which the file gives its positions; `None` where it gives none.
    pub unit: Option<AxisUnit>,
    /// How often it is played.
    pub repeat: u32,
    /// What is done.
    pub movement: Movement,
    /// What other axes do meanwhile.
    pub companions: Vec<Companion>,
}

impl Protocol {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// [`ProtocolError::Unreadable`] where there is no such file or it is no UTF-8, else as
    /// [`Protocol::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ProtocolError> {
        Self::load_with::<&str>(path, &[])
    }

    /// Reads the file, applies overrides (`segments.0.amplitude_deg=20`) and checks the outcome.
    ///
    /// # Errors
    /// As [`Protocol::load`] and [`with_overrides`].
    pub fn load_with<S: AsRef<str>>(
        path: impl AsRef<Path>,
        overrides: &[S],
    ) -> Result<Self, ProtocolError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path)
            .map_err(|source| ProtocolError::Unreadable { path: path.to_owned(), source })?;
        let file_name = path.display().to_string();
        let text = with_overrides(&text, &file_name, overrides)?;
        Self::parse(&tabled::take_in(&text, path.parent().unwrap_or(Path::new("")))?, &file_name)
    }

    /// Checks the text of a protocol; `file_name` appears in messages only.
    ///
    /// # Errors
    /// [`ProtocolError::Invalid`] with every problem that was found.
    pub fn parse(text: &str, file_name: &str) -> Result<Self, ProtocolError> {
        let source = Source::new(text, file_name);
        let table = source.parse()?;
        let protocol = Self::read(source.root(table.get_ref()), text, file_name);
        source.finish()?;
        Ok(protocol)
    }

    fn read(root: Section<'_>, text: &str, file_name: &str) -> Self {
        let head = root.section("protocol");
        let name = head.text("name");
        let description = head.text_or_none("description").unwrap_or_default();
        let repeat =
            head.whole_or("repeat", 1, 1, 1000, "how often the whole list is played") as u32;
        head.finish();
        let segments: Vec<_> =
            root.sections("segments").into_iter().enumerate().map(Segment::read).collect();
        if segments.is_empty() {
            root.problem("segments", "at least one segment", "none", "write each as [[segments]]");
        }
        let protocol = Self {
            name,
            description,
            repeat,
            segments,
            text: text.to_owned(),
            file_name: file_name.to_owned(),
            identity: identity(text),
        };
        let (count, duration) = (protocol.count(), protocol.duration_s());
        if count > SEGMENTS {
            let advice = "repeat less often";
            root.problem(
                "segments",
                format!("at most {SEGMENTS} segments, repeats counted"),
                count,
                advice,
            );
        }
        if duration > LONGEST_S {
            let found = format!("{duration} s");
            root.problem(
                "segments",
                format!("at most {LONGEST_S} s in all"),
                found,
                "split the protocol",
            );
        }
        root.finish();
        protocol
    }

    /// Number of segments that are played, repeats counted.
    pub fn count(&self) -> usize {
        self.segments.iter().map(|segment| segment.repeat as usize).sum::<usize>()
            * self.repeat as usize
    }

    /// Time that it takes, repeats counted (s).
    pub fn duration_s(&self) -> f64 {
        let once: f64 =
            self.segments.iter().map(|s| s.movement.duration_s() * f64::from(s.repeat)).sum();
        once * f64::from(self.repeat)
    }

    /// The segments as they are played, repeats written out, each with its index in the file.
    pub fn sequence(&self) -> impl Iterator<Item = (usize, &Segment)> {
        (0..self.repeat).flat_map(move |_| {
            self.segments
                .iter()
                .enumerate()
                .flat_map(|(index, segment)| (0..segment.repeat).map(move |_| (index, segment)))
        })
    }

    /// Holds the protocol against a machine: axes and units, positions and speeds within the
    /// limits.
    ///
    /// The speed of a movement depends on where it begins. At the protocol's start and after a rest
    /// that is unknown, and the farthest position that the limits allow is taken.
    ///
    /// # Errors
    /// [`ProtocolError::Invalid`] with every segment that does not fit, by line of the protocol's
    /// file.
    pub fn check_against(&self, rig: &RigFile) -> Result<(), ProtocolError> {
        let source = Source::new(&self.text, &self.file_name);
        let table = source.parse()?;
        // reading it again notes the lines of its keys
        Self::read(source.root(table.get_ref()), &self.text, &self.file_name);
        let mut misfits = vec![false; self.segments.len()];
        let mut ends: Vec<Option<f64>> = vec![None; rig.axes.len()];
        for (index, segment) in self.sequence() {
            let start = ends.get(segment.axis).copied().flatten();
            // repeats may begin elsewhere than the first turn, so each turn is checked; one
            // complaint is enough
            if !misfits[index] {
                misfits[index] = !segment.check(index, start, rig, &source)
                    || segment.companions.iter().any(|companion| {
                        let start = ends.get(companion.axis).copied().flatten();
                        !segment.of(companion).check(index, start, rig, &source)
                    });
            }
            if segment.movement.ends_anywhere() {
                ends.fill(None);
            } else {
                for (axis, movement) in segment.moves() {
                    if let Some(end) = ends.get_mut(axis) {
                        *end = movement.end(*end);
                    }
                }
            }
        }
        source.finish()
    }

    /// The text as it was read, overrides applied.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The name under which it was read.
    pub fn file_name(&self) -> &str {
        &self.file_name
    }

    /// Identity of the text ([`identity`]), as in `Setpoint::protocol`.
    pub fn identity(&self) -> u64 {
        self.identity
    }
}

impl Segment {
    fn read((index, section): (usize, Section<'_>)) -> Self {
        let (movement, unit) = Movement::read(&section);
        let (axis, movement, companions) = together::read(&section, movement);
        let segment = Self {
            label: section.text_or_none("label").unwrap_or_else(|| {
                format!("{} {}", movement.kind().name().replace('_', " "), index + 1)
            }),
            axis,
            unit,
            repeat: section.whole_or("repeat", 1, 1, 1000, "how often the segment is played")
                as u32,
            movement,
            companions,
        };
        section.finish();
        segment
    }

    /// Every axis that moves, with its movement.
    pub fn moves(&self) -> impl Iterator<Item = (usize, &Movement)> {
        let others = self.companions.iter().map(|companion| (companion.axis, &companion.movement));
        std::iter::once((self.axis, &self.movement)).chain(others)
    }

    /// The segment as one of its other axes sees it.
    fn of(&self, companion: &Companion) -> Self {
        let (axis, movement) = (companion.axis, companion.movement.clone());
        Self { axis, movement, companions: Vec::new(), ..self.clone() }
    }

    fn check(&self, index: usize, start: Option<f64>, rig: &RigFile, source: &Source<'_>) -> bool {
        let key = |name: &str| format!("segments.{index}.{name}");
        // the key that a person would change
        let place = || {
            let stems = ["amplitude", "amplitudes", "positions", "position"];
            let keys = stems
                .iter()
                .flat_map(|stem| [key(&format!("{stem}_deg")), key(&format!("{stem}_m"))]);
            keys.into_iter().find(|key| source.has(key)).unwrap_or_else(|| key("kind"))
        };
        let kind = self.movement.kind().name();
        let Some(axis) = rig.axes.get(self.axis) else {
            let expected =
                format!("an axis of the rig \"{}\" (0 to {})", rig.name, rig.axes.len() - 1);
            let place = if source.has(&key("axes")) { key("axes") } else { key("axis") };
            source.problem(&place, expected, self.axis, "move an axis that the rig has");
            return false;
        };
        if self.unit.is_some_and(|unit| unit != axis.unit) {
            let expected =
                format!("positions in the unit of axis \"{}\" ({})", axis.name, axis.unit.symbol());
            let advice = "keys end in _deg for axes in rad, in _m for axes in m";
            source.problem(&place(), expected, "the other unit", advice);
            return false;
        }
        let show = |si: f64| match axis.unit {
            AxisUnit::Radian => format!("{:.1}°", si.to_degrees()),
            AxisUnit::Metre => format!("{si:.4} m"),
        };
        let limits = &axis.limits;
        if let Movement::Free { field, .. } = &self.movement {
            return check_field(field, axis, key, show, source)
                && check_matrix(field, rig, key, source)
                && field_stability::check_stability(field, self.axis, rig, key, source);
        }
        if let Movement::Learn(learn) = &self.movement
            && !learn.check(axis, &rig.rates, key, source)
        {
            return false;
        }
        let range = match &self.movement {
            Movement::Rhythm(rhythm) => {
                if !check_field(&rhythm.field, axis, key, show, source)
                    || !field_stability::check_stability(&rhythm.field, self.axis, rig, key, source)
                {
                    return false;
                }
                Some(rhythm.range())
            }
            Movement::Initialise(own) if !own.check(axis, key, source) => return false,
            movement => movement.range(),
        };
        if let Some((least, most)) = range
            && (least < limits.position_min || most > limits.position_max)
        {
            let expected = format!(
                "positions from {} to {}",
                show(limits.position_min),
                show(limits.position_max)
            );
            let found = format!("a {kind} from {} to {}", show(least), show(most));
            source.problem(
                &place(),
                expected,
                found,
                "move less, or elsewhere; the limits are the rig file's",
            );
            return false;
        }
        if let Movement::Ramp(ramp) = &self.movement {
            let far = |end: f64| ramp.profile(end).moving_s;
            let needed = start.map_or(far(limits.position_min).max(far(limits.position_max)), far);
            if needed > ramp.duration_s {
                let expected = format!("at least {needed:.1} s, what the way takes at that speed");
                let advice = "take more time, move faster, or put a hold before it";
                source.problem(
                    &key("duration_s"),
                    expected,
                    format!("{} s", ramp.duration_s),
                    advice,
                );
                return false;
            }
        }
        let (from, start) = match start {
            Some(start) => (self.movement.peak_speed_from(start), "where the segment before ends"),
            None => {
                let far = |end: f64| self.movement.peak_speed_from(end);
                (
                    far(limits.position_min).max(far(limits.position_max)),
                    "any position within the limits",
                )
            }
        };
        if from > limits.speed_max {
            let expected = format!("speeds up to {}/s", show(limits.speed_max));
            let found = format!("a {kind} of up to {}/s, beginning at {start}", show(from));
            let advice = "take more time to rise or fade in, or put a slow hold before it";
            source.problem(&place(), expected, found, advice);
        }
        from <= limits.speed_max
    }
}

/// Whether the rig has the axes of a field's matrices, each with force control and a limit on the
/// torque that they keep.
fn check_matrix(
    field: &Field,
    rig: &RigFile,
    key: impl Fn(&str) -> String,
    source: &Source<'_>,
) -> bool {
    let Some(matrix) = &field.matrix else { return true };
    let key = matrix.keys().map(&key).find(|key| source.has(key)).unwrap_or_else(|| key("kind"));
    if matrix.axes > rig.axes.len() {
        let expected = format!(
            "at most {0} rows of {0}: the rig \"{1}\" has so many axes",
            rig.axes.len(),
            rig.name
        );
        let found = format!("{0} rows of {0}", matrix.axes);
        source.problem(
            &key,
            expected,
            found,
            "give one row an axis, or choose a rig with more axes",
        );
        return false;
    }
    for (index, axis) in rig.axes.iter().enumerate().take(matrix.axes) {
        let torque = matrix.largest_torque(index, |other| {
            let limits = &rig.axes[other].limits;
            (limits.position_min, limits.position_max)
        });
        let symbol = torque_symbol(axis.unit);
        match axis.limits.torque_max.filter(|_| axis.control.force.is_some()) {
            Some(most) if torque <= most => {}
            Some(most) => {
                let expected = format!(
                    "a field of at most {most} {symbol} on axis \"{}\" within the limits",
                    axis.name
                );
                let advice = "the watchdog would cut the power there; soften the field";
                source.problem(&key, expected, format!("{torque:.1} {symbol}"), advice);
                return false;
            }
            None => {
                let expected = format!(
                    "axes that measure the hand's torque, with a limit on it (axis \"{}\" does not)",
                    axis.name
                );
                source.problem(
                    &key,
                    expected,
                    "a matrix over it",
                    "add axes.torque to the rig file",
                );
                return false;
            }
        }
    }
    true
}

/// Whether an axis can give a hand this field: it measures the hand's torque, and the field stays
/// below the limit on it.
fn check_field(
    field: &Field,
    axis: &Axis,
    key: impl Fn(&str) -> String,
    show: impl Fn(f64) -> String,
    source: &Source<'_>,
) -> bool {
    let Some(most) = axis.limits.torque_max.filter(|_| axis.control.force.is_some()) else {
        let expected = format!(
            "an axis that measures the hand's torque, with a limit on it (axis \"{}\" does not)",
            axis.name
        );
        source.problem(
            &key("kind"),
            expected,
            "a free movement",
            "add axes.torque to the rig file, or use rest",
        );
        return false;
    };
    let (torque, at) = field.largest_torque(axis.limits.position_min, axis.limits.position_max);
    if torque.abs() > most {
        let symbol = torque_symbol(axis.unit);
        let found = format!("{:.1} {symbol} at {}", torque.abs(), show(at));
        let stems = ["spring", "position_table_deg", "position_table_m", "wall_stiffness"];
        let stem = stems.into_iter().find(|stem| source.has(&key(stem))).unwrap_or("kind");
        let advice =
            "the watchdog would cut the power there; soften the field, or move its centre or walls";
        source.problem(
            &key(stem),
            format!("a field of at most {most} {symbol} within the limits"),
            found,
            advice,
        );
        return false;
    }
    if let Some(table) = &field.velocity_table
        && table.largest() > most
    {
        let (symbol, stems) =
            (torque_symbol(axis.unit), ["velocity_table_deg_s", "velocity_table_m_s"]);
        let stem = stems.into_iter().find(|stem| source.has(&key(stem))).unwrap_or("kind");
        let found = format!("{:.1} {symbol}", table.largest());
        let advice = "the watchdog would cut the power there; lower the torques";
        source.problem(&key(stem), format!("torques of at most {most} {symbol}"), found, advice);
        return false;
    }
    true
}
