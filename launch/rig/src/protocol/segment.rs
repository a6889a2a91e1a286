//! A segment of a protocol, and its check against a rig.

use emg::Group;
use ipc_types::{Sound, TEXT};

use super::coupled_axes::{self, Companion};
use super::field_check::check_field;
use super::movement::Movement;
use super::segment_kind::Placement;
use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Keys, Section, Source};
use crate::rig_file::RigFile;

/// One timed movement of one axis, or of several coupled axes; the other axes stay where they are.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Name on screens and in events.
    pub label: String,
    /// The axis that moves.
    pub axis: usize,
    /// Unit of the positions in the file; `None` where it has none.
    pub unit: Option<AxisUnit>,
    /// Number of times that it is played.
    pub repeat: u32,
    /// What is done.
    pub movement: Movement,
    /// Movements of the coupled axes.
    pub companions: Vec<Companion>,
    /// Whether it is a session: sums of effort are kept over it, and it counts.
    pub session: bool,
    /// The muscles whose maximum it measures.
    pub contraction: Option<Group>,
    /// What the subject is told from its beginning on.
    pub instruction: Option<String>,
    /// A sound for the subject at its beginning.
    pub sound: Option<Sound>,
    /// The section of the file that it is from, for messages: `segments.0`.
    pub(super) section: String,
}

const KEYS: Keys = &[
    ("kind", "Kind of the segment; the sections below have the keys of each."),
    ("label", "Name on screens and in events; kind and number, if left out."),
    ("axis", "Index of the rig's axis that moves, from 0."),
    ("axes", "Indices of the coupled axes; instead of `axis`."),
    ("phases_deg", "Phase lead of each coupled axis, in degrees (guided_sine, multisine)."),
    ("scales", "Amplitude of each coupled axis as a part of the segment's; negative mirrors it."),
    ("repeat", "Number of times that the segment is played."),
    ("session", "Whether it is a session: sums of torque and muscle activity are kept over it."),
    ("contraction", "Measures the maximum of these muscles' activity, in a session; see [emg]."),
    ("instruction", "What the subject's page shows from its beginning on, at most 120 bytes."),
    ("sound", "A tone that the subject's page makes at its beginning."),
];

const SOUNDS: [Sound; 3] = [Sound::High, Sound::Middle, Sound::Low];

/// A contraction that is measured, which a session alone can be.
fn read_contraction(section: &Section<'_>) -> Option<Group> {
    let groups = &Group::ALL.map(|group| (group.word(), group));
    let group = section.word_or_none("contraction", groups)?;
    if !section.flag_or("session", false) {
        let (expected, advice) = ("session = true beside it", "add it, or take contraction out");
        section.problem("contraction", expected, "no session", advice);
    }
    Some(group)
}

/// A line that fits into an event whole.
fn read_instruction(section: &Section<'_>) -> Option<String> {
    let text = section.text_or_none("instruction")?;
    if text.len() <= TEXT && !text.chars().any(char::is_control) {
        return Some(text);
    }
    let expected = format!("a line of at most {TEXT} bytes");
    let found = format!("{} bytes, or a line break", text.len());
    section.problem("instruction", expected, found, "shorten it");
    None
}

impl Segment {
    pub(super) fn read((index, section): (usize, Section<'_>)) -> Self {
        section.document("[[segments]]", KEYS);
        let (movement, unit) = Movement::read(&section);
        let (axis, movement, companions) = coupled_axes::read(&section, movement);
        Self {
            label: section
                .text_or_none("label")
                .unwrap_or_else(|| format!("{} {}", movement.kind().replace('_', " "), index + 1)),
            axis,
            unit,
            repeat: section.whole_or("repeat", 1, 1, 1000, "how often the segment is played")
                as u32,
            movement,
            companions,
            session: section.flag_or("session", false),
            contraction: read_contraction(&section),
            instruction: read_instruction(&section),
            sound: section.word_or_none("sound", &SOUNDS.map(|sound| (sound.text(), sound))),
            section: format!("segments.{index}"),
        }
    }

    /// Whether it ends with a pulse of the scanner.
    pub const fn waits_for_scanner(&self) -> bool {
        matches!(self.movement, Movement::WaitForScanner(_))
    }

    /// Every axis that moves, with its movement.
    pub fn moves(&self) -> impl Iterator<Item = (usize, &Movement)> {
        let others = self.companions.iter().map(|companion| (companion.axis, &companion.movement));
        std::iter::once((self.axis, &self.movement)).chain(others)
    }

    /// Checks the movement of every axis; `starts` are the axes' positions at its start, where
    /// known. Reports the first problem only, and returns false where there is one.
    pub(super) fn check(&self, starts: &[Option<f64>], rig: &RigFile, source: &Source<'_>) -> bool {
        self.moves().all(|(index, movement)| {
            let Some(axis) = rig.axes.get(index) else {
                let key = |name: &str| format!("{}.{name}", self.section);
                let key = if source.has(&key("axes")) { key("axes") } else { key("axis") };
                let last = rig.axes.len() - 1;
                let expected = format!("an axis of the rig \"{}\" (0 to {last})", rig.name);
                return source.problem(&key, expected, index, "move an axis that the rig has");
            };
            let start = starts.get(index).copied().flatten();
            let section = &self.section;
            self.check_movement(movement, &Placement { rig, axis, index, section, start, source })
        })
    }

    fn check_movement(&self, movement: &Movement, placed: &Placement<'_>) -> bool {
        let (axis, kind) = (placed.axis, movement.kind());
        let (limits, source) = (&axis.limits, placed.source);
        let (lowest, highest) = axis.movement_range();
        let stems = ["amplitude", "amplitudes", "positions", "position"];
        let keys: Vec<_> =
            stems.iter().flat_map(|stem| [format!("{stem}_deg"), format!("{stem}_m")]).collect();
        let key = placed.first_key(keys.iter().map(String::as_str));
        if self.unit.is_some_and(|unit| unit != axis.unit) {
            let expected =
                format!("positions in the unit of axis \"{}\" ({})", axis.name, axis.unit.symbol());
            let advice = "keys end in _deg for axes in rad, in _m for axes in m";
            return source.problem(&key, expected, "the other unit", advice);
        }
        if let Some((least, most)) = movement.range()
            && (least < lowest || most > highest)
        {
            return refuse_range(placed, &key, kind, (least, most));
        }
        let field_fits = || movement.field().is_none_or(|field| check_field(field, placed));
        if !movement.check(placed) || !field_fits() {
            return false;
        }
        let speed = placed.worst_start(|start| movement.peak_speed_from(start));
        if speed > limits.speed_max {
            let start = match placed.start {
                Some(_) => "where the previous segment ends",
                None => "any position within the limits",
            };
            let expected = format!("speeds up to {}/s", placed.show(limits.speed_max));
            let found = format!("a {kind} of up to {}/s, beginning at {start}", placed.show(speed));
            let advice = "take more time to rise or fade in, or put a slow hold before it";
            source.problem(&key, expected, found, advice);
        }
        speed <= limits.speed_max
    }
}

/// Reports a movement beyond the range that its axis may move in; returns false.
fn refuse_range(placed: &Placement<'_>, key: &str, kind: &str, reached: (f64, f64)) -> bool {
    let (axis, index) = (placed.axis, placed.index);
    let shown = |(least, most): (f64, f64)| {
        let [least, most] = [least, most].map(|position| placed.show(position));
        format!("from {least} to {most}")
    };
    let (whose, advice) = match axis.range_of_motion {
        Some(_) => (
            format!(", the range of motion of axis {index} (\"{}\")", axis.name),
            format!("the range is axes.{index}.range_of_motion of the rig file"),
        ),
        None => (String::new(), "the limits are the rig file's".to_owned()),
    };
    let expected = format!("positions {}{whose}", shown(axis.movement_range()));
    let found = format!("a {kind} {}", shown(reached));
    placed.source.problem(key, expected, found, format!("move less, or elsewhere; {advice}"))
}
