//! What a recording says about itself, and under which names.

use std::collections::BTreeMap;

/// Name of the metadata record at the start of a recording.
pub const START_RECORD: &str = "farreach";
/// Name of the metadata record at the end of a recording that was ended in good order.
pub const END_RECORD: &str = "farreach.end";

/// Keys of the metadata records.
pub mod key {
    /// Layout of the metadata themselves: `1`.
    pub const FORMAT: &str = "format";
    /// Git revision of the build.
    pub const REVISION: &str = "revision";
    /// Version of farreach.
    pub const VERSION: &str = "farreach_version";
    /// Name of the rig.
    pub const RIG: &str = "rig";
    /// Text of the rig file.
    pub const RIG_FILE: &str = "rig_file";
    /// Timing profile, `realtime` or `best-effort`.
    pub const PROFILE: &str = "profile";
    /// Name of the protocol.
    pub const PROTOCOL: &str = "protocol";
    /// Text of the protocol.
    pub const PROTOCOL_FILE: &str = "protocol_file";
    /// Command line that started the recording.
    pub const COMMAND_LINE: &str = "command_line";
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC`, fixed for the file (ns).
    pub const REALTIME_OFFSET_NS: &str = "realtime_offset_ns";
    /// `CLOCK_MONOTONIC` when the file was begun (ns).
    pub const STARTED_NS: &str = "started_ns";
    /// Number of the part: 1, or higher after a restart of the logger.
    pub const PART: &str = "part";
    /// `true` in the end record.
    pub const CLEAN_END: &str = "clean_end";
}

/// What a recording says about itself from the start.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Start {
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC` at the start (ns).
    pub realtime_offset_ns: i64,
    /// Key and value pairs, see [`key`]. The writer adds the offset, the start time, the format
    /// and, where the caller gave none, the part.
    pub metadata: BTreeMap<String, String>,
}

impl Start {
    /// With one more pair.
    #[must_use]
    pub fn with(mut self, key: &str, value: &str) -> Self {
        self.metadata.insert(key.to_owned(), value.to_owned());
        self
    }
}
