//! The metadata of a recording, and their keys.

use std::collections::BTreeMap;

/// Name of the metadata record at the start of a recording.
pub const START_RECORD: &str = "farreach";
/// Name of the metadata record at the end of a recording with a clean end.
pub const END_RECORD: &str = "farreach.end";
/// Name of a metadata record whose checksum was wrong, in a recording that was recovered; its entry
/// `record` has its former name.
pub const DAMAGED_RECORD: &str = "farreach.damaged";
/// Name of the metadata record that says where the part before this one ended, topic by topic.
pub const CONTINUES_RECORD: &str = "farreach.continues";

/// Keys of the metadata records.
pub mod key {
    /// Layout of the metadata themselves: `2`; records of layout `1` had no checksum.
    pub const FORMAT: &str = "format";
    /// CRC-32 of the record that it stands in (eight hexadecimal digits): what reads a rig file or
    /// a protocol out of a recording notices by it that they were damaged.
    pub const CHECKSUM: &str = "checksum";
    /// Git revision of the build.
    pub const REVISION: &str = "revision";
    /// Version of farreach.
    pub const VERSION: &str = "farreach_version";
    /// Operating system of the computer: name, release and version of its kernel.
    pub const KERNEL: &str = "kernel";
    /// Name of the rig.
    pub const RIG: &str = "rig";
    /// Text of the rig file.
    pub const RIG_FILE: &str = "rig_file";
    /// Timing profile, `realtime` or `best-effort`.
    pub const PROFILE: &str = "profile";
    /// Name of the rig's domain (`--rig-name`).
    pub const RIG_NAME: &str = "rig_name";
    /// Session of the rig: drawn at each cold start.
    pub const SESSION: &str = "session";
    /// Code of the subject.
    pub const SUBJECT: &str = "subject";
    /// `CLOCK_MONOTONIC` when a run was begun (ns).
    pub const TIME_NS: &str = "time_ns";
    /// Longest stall of the host measured before the rig came up.
    pub const HOST_STALL: &str = "host_stall";
    /// The newest report of `farreach doctor` in one line, with its age when the recording began.
    pub const DOCTOR: &str = "doctor";
    /// That report as JSON; absent where there was none.
    pub const DOCTOR_REPORT: &str = "doctor_report";
    /// Processes in whose place programs of others run when the recording begins, see
    /// [`crate::replaced::Replaced`]; absent in recordings of older builds.
    pub const REPLACED: &str = "replaced";
    /// Processor of each loop; absent where the loops are not placed.
    pub const PLACEMENT: &str = "placement";
    /// Name of the protocol.
    pub const PROTOCOL: &str = "protocol";
    /// Text of the protocol.
    pub const PROTOCOL_FILE: &str = "protocol_file";
    /// Where the pulses of the scanner came from in a run; absent for its trigger line.
    pub const SCANNER_PULSES: &str = "scanner_pulses";
    /// Command line that started the recording.
    pub const COMMAND_LINE: &str = "command_line";
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC`, fixed for the file (ns).
    pub const REALTIME_OFFSET_NS: &str = "realtime_offset_ns";
    /// `CLOCK_MONOTONIC` when the file was begun (ns).
    pub const STARTED_NS: &str = "started_ns";
    /// Number of the part: 1, or higher after a restart of the logger.
    pub const PART: &str = "part";
    /// Of a ring, how much of the past is kept: `30 s`; absent where all parts stay.
    pub const RING: &str = "ring";
    /// `true` in the end record.
    pub const CLEAN_END: &str = "clean_end";
}

/// Name of the metadata record of a protocol that was played: one for each run.
pub const RUN_RECORD: &str = "farreach.run";

/// Where a topic stands in its sender's sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// Incarnation of the sender.
    pub incarnation: u64,
    /// Sequence number expected next.
    pub next: u64,
}

/// Positions by name of the topic.
pub type Positions = BTreeMap<String, Position>;

/// The content of a [`CONTINUES_RECORD`]: `TOPIC = "INCARNATION NEXT"`.
pub(super) fn continues_record(positions: &Positions) -> BTreeMap<String, String> {
    positions
        .iter()
        .map(|(topic, at)| (topic.clone(), format!("{} {}", at.incarnation, at.next)))
        .collect()
}

/// Reads it back; entries that cannot be read are left out.
pub(crate) fn parse_continues(record: &BTreeMap<String, String>) -> Positions {
    let parse = |text: &str| {
        let (incarnation, next) = text.split_once(' ')?;
        Some(Position { incarnation: incarnation.parse().ok()?, next: next.parse().ok()? })
    };
    record.iter().filter_map(|(topic, text)| Some((topic.clone(), parse(text)?))).collect()
}

/// Metadata at the start of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Start {
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC` at the start (ns).
    pub realtime_offset_ns: i64,
    /// Key and value pairs, see [`key`]. The writer adds the offset, the start time, the format
    /// and, where the caller gave none, the part.
    pub metadata: BTreeMap<String, String>,
    /// Where the part before ended; empty for part 1. Readers count the messages between the two
    /// parts as lost.
    pub continues: Positions,
    /// The protocol that is being played (`RUN_RECORD`); empty where none is.
    pub run: BTreeMap<String, String>,
}

impl Start {
    /// Adds an entry.
    #[must_use]
    pub fn with(mut self, key: &str, value: &str) -> Self {
        self.metadata.insert(key.to_owned(), value.to_owned());
        self
    }
}
