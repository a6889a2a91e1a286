//! Protocols: an experiment as a list of timed movements.
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
//! A protocol is independent of a rig; [`Protocol::check_against`] checks it against a rig's axes
//! and limits.

mod coupled_axes;
mod entries;
mod field;
mod field_check;
mod field_stability;
mod matching;
mod matrix;
mod maxima;
mod movement;
mod overrides;
mod scan;
mod segment;
mod segment_kind;
mod sines;
mod spline;
mod stop_search_check;
mod torque_table;
pub mod trajectory;
mod unit_keys;

use std::borrow::Cow;
use std::path::Path;

pub use coupled_axes::Companion;
pub use entries::{Entry, entries};
pub use field::Field;
pub use matching::{Matching, Signal};
pub use matrix::{MATRIX_AXES, Matrix};
pub use maxima::MuscleMaxima;
pub use movement::*;
pub use overrides::with_overrides;
pub use scan::Scan;
pub use segment::Segment;
pub use segment_kind::{Placement, SegmentKind};
pub use sines::{Envelope, Line};
pub use spline::Spline;
pub use torque_table::{POINTS, TorqueTable};

use crate::checked_toml::{Keys, Section, Source};
use crate::content_hash::identity;
use crate::error::ProtocolError;
use crate::rig_file::RigFile;
use matching::corner;
use stop_search_check::check_stop_search;

/// Largest number of segments, repeats included.
const SEGMENTS: usize = 10_000;
/// Least start-up time of a wait for the scanner before a session (s).
const LEAST_START_UP_S: f64 = 0.2;
/// Longest protocol (s).
const LONGEST_S: f64 = 86_400.0;

/// A checked protocol.
#[derive(Clone, Debug, PartialEq)]
pub struct Protocol {
    /// Name.
    pub name: String,
    /// Description for people.
    pub description: String,
    /// Number of times that the whole list is played.
    pub repeat: u32,
    /// Whether it goes on after a restart of the process that plays it, with the beginning of the
    /// segment; otherwise it ends.
    pub resumes: bool,
    /// The segments, as in the file; those of `[matching]` with the corner at 0, see
    /// [`Protocol::segments_on`].
    pub segments: Vec<Segment>,
    /// The matching experiment, where the file has one in place of segments.
    pub matching: Option<Matching>,
    /// What is expected of the scan; `None` for a protocol that counts no volumes.
    pub scan: Option<Scan>,
    /// Maxima of the muscles' activity, measured or used.
    pub maxima: MuscleMaxima,
    text: String,
    file_name: String,
    identity: u64,
}

const FILE_KEYS: Keys = &[
    ("protocol", "Name and description."),
    ("segments", "The segments, in the order of playing; at least one, or `[matching]`."),
    ("matching", "A force- or EMG-matching experiment, in place of segments."),
    ("scanner", "What is expected of the scan, for a protocol that runs in a scanner."),
    ("emg", "Maxima of the muscles' activity, to be measured or used."),
];

const KEYS: Keys = &[
    ("name", "Name of the protocol."),
    ("description", "Description for people."),
    ("repeat", "Number of times that the whole list is played."),
    (
        "after_restart",
        "What is done when the process that plays it is started again in between, or was held up \
         for longer than 100 ms.",
    ),
];

impl Protocol {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// [`ProtocolError::Unreadable`] where there is no such file or it is not UTF-8, else as
    /// [`Protocol::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ProtocolError> {
        Self::load_with::<&str>(path, &[])
    }

    /// Reads the file, applies overrides (`segments.0.amplitude_deg=20`) and checks the result.
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
        Self::parse(
            &movement::embed_tables(&text, path.parent().unwrap_or(Path::new("")))?,
            &file_name,
        )
    }

    /// Checks the text of a protocol; `file_name` appears in messages only.
    ///
    /// # Errors
    /// [`ProtocolError::Invalid`] with every problem found.
    pub fn parse(text: &str, file_name: &str) -> Result<Self, ProtocolError> {
        let source = Source::new(text, file_name);
        let table = source.parse()?;
        let protocol = Self::read(source.root(table.get_ref()), text, file_name);
        source.finish()?;
        Ok(protocol)
    }

    pub(crate) fn read(root: Section<'_>, text: &str, file_name: &str) -> Self {
        root.document("The file", FILE_KEYS);
        let head = root.section("protocol");
        head.document("[protocol]", KEYS);
        let name = head.text("name");
        let description = head.text_or_none("description").unwrap_or_default();
        let repeat =
            head.whole_or("repeat", 1, 1, 1000, "how often the whole list is played") as u32;
        let restart = &[("resume", true), ("abort", false)];
        let resumes = head.word_or("after_restart", restart, true);
        // Before the segments, as on the generated page.
        let scan = Scan::read(root.section("scanner"));
        let matching = Matching::read(root.section("matching"));
        let maxima = MuscleMaxima::read(root.section("emg"));
        let mut segments: Vec<_> =
            root.sections("segments").into_iter().enumerate().map(Segment::read).collect();
        if matching.is_some() && repeat > 1 {
            let (expected, advice) = ("1, with [matching]", "raise matching.sets");
            head.problem("repeat", expected, repeat, advice);
        }
        match matching {
            Some(matching) if segments.is_empty() => segments = matching.segments(0.0),
            Some(_) => {
                let (expected, found) = ("either segments or [matching]", "both");
                root.problem("segments", expected, found, "take one of them out");
            }
            None if segments.is_empty() => {
                let advice = "write each as [[segments]]";
                root.problem("segments", "at least one segment", "none", advice);
            }
            None => {}
        }
        let protocol = Self {
            name,
            description,
            repeat,
            resumes,
            segments,
            matching,
            scan,
            maxima,
            text: text.to_owned(),
            file_name: file_name.to_owned(),
            identity: identity(text),
        };
        let (count, duration) = (protocol.count(), protocol.duration_s());
        // Where there are too many, the sequence is not gone through.
        if count <= SEGMENTS {
            protocol.check_start_up(&root);
        } else {
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
            let advice = "split the protocol";
            root.problem("segments", format!("at most {LONGEST_S} s in all"), found, advice);
        }
        protocol
    }

    /// Checks that no session begins before its beginning can be known: a pulse is known some scans
    /// after it came, that of a gate after its least width.
    fn check_start_up(&self, root: &Section<'_>) {
        let next = self.sequence().skip(1).map(|(_, segment)| segment);
        let early = self.sequence().zip(next).find(|((_, segment), next)| {
            matches!(&segment.movement, Movement::WaitForScanner(wait)
                if next.session && wait.start_up_s < LEAST_START_UP_S)
        });
        if let Some(((index, segment), _)) = early {
            let expected = format!("at least {LEAST_START_UP_S} s before a session");
            let found = format!("less in segment {index} (\"{}\")", segment.label);
            root.problem("segments", format!("a start_up_s of {expected}"), found, "raise it");
        }
    }

    /// Number of segments played, repeats included.
    pub fn count(&self) -> usize {
        self.segments.iter().map(|segment| segment.repeat as usize).sum::<usize>()
            * self.repeat as usize
    }

    /// Duration, repeats included (s).
    pub fn duration_s(&self) -> f64 {
        let once: f64 =
            self.segments.iter().map(|s| s.movement.duration_s() * f64::from(s.repeat)).sum();
        once * f64::from(self.repeat)
    }

    /// The segments in the order of playing, repeats included, each with its index in the file.
    pub fn sequence(&self) -> impl Iterator<Item = (usize, &Segment)> {
        self.sequence_of(&self.segments)
    }

    /// As [`Protocol::sequence`], of the segments for a rig.
    pub fn sequence_of<'a>(
        &self,
        segments: &'a [Segment],
    ) -> impl Iterator<Item = (usize, &'a Segment)> {
        (0..self.repeat).flat_map(move |_| {
            segments
                .iter()
                .enumerate()
                .flat_map(|(index, segment)| (0..segment.repeat).map(move |_| (index, segment)))
        })
    }

    /// The segments for a rig: those of the file, or those of `[matching]` with the centre counted
    /// from the corner of the rig's axis.
    pub fn segments_on(&self, rig: &RigFile) -> Cow<'_, [Segment]> {
        match self.matching.and_then(|matching| Some((matching, rig.axes.get(matching.axis)?))) {
            Some((matching, axis)) => matching.segments(corner(axis)).into(),
            None => self.segments.as_slice().into(),
        }
    }

    /// Checks the protocol against a rig: axes and units, positions and speeds within the limits,
    /// positions also within the range of motion of an axis that has one.
    ///
    /// The speed of a movement depends on its start position. At the protocol's start and after a
    /// rest that is unknown, and the worst position within the limits is assumed.
    ///
    /// # Errors
    /// [`ProtocolError::Invalid`] with every segment that does not fit, by line of the protocol's
    /// file.
    pub fn check_against(&self, rig: &RigFile) -> Result<(), ProtocolError> {
        let source = Source::new(&self.text, &self.file_name);
        let table = source.parse()?;
        // Reading it again records the lines of its keys.
        Self::read(source.root(table.get_ref()), &self.text, &self.file_name);
        let segments = self.segments_on(rig);
        if let Some(matching) = &self.matching {
            matching.check(rig, &source);
        }
        self.maxima.check(&segments, rig, &source);
        check_stop_search(&segments, rig, &source);
        let mut failed = vec![false; segments.len()];
        let mut ends: Vec<Option<f64>> = vec![None; rig.axes.len()];
        for (index, segment) in self.sequence_of(&segments) {
            // A repeat may begin elsewhere, so each is checked; one message per segment is enough.
            if !failed[index] {
                failed[index] = !segment.check(&ends, rig, &source);
            }
            if segment.movement.end_is_unknown() {
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

    /// The text as read, with overrides applied and tables embedded.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The name under which the file was read.
    pub fn file_name(&self) -> &str {
        &self.file_name
    }

    /// Identity of the text ([`identity`]), as in `Setpoint::protocol`.
    pub fn identity(&self) -> u64 {
        self.identity
    }
}
