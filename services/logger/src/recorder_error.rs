//! Why a request to the recorder was refused.

use std::path::PathBuf;
use std::time::Duration;

use ipc_types::Split;
use runtime::clock::SECOND_NS;

/// Shortest and smallest part that may be asked for, and shortest ring.
const SHORTEST_PART_NS: u64 = SECOND_NS;
const SMALLEST_PART: u64 = 1_000_000;

/// Why a request was refused.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// One recording at a time.
    #[error("already recording to {path}: stop that first")]
    Recording {
        /// The file.
        path: PathBuf,
    },
    /// There is none.
    #[error("nothing is being recorded")]
    NotRecording,
    /// A relative path would depend on the logger's working directory.
    #[error("{path}: expected an absolute path")]
    RelativePath {
        /// The path.
        path: PathBuf,
    },
    /// Parts that would be too short or too small.
    #[error(
        "split: expected parts of at least {} s and {SMALLEST_PART} bytes, found {found}",
        SHORTEST_PART_NS / SECOND_NS
    )]
    Split {
        /// What was asked for.
        found: String,
    },
    /// The thread cannot be started, or ended.
    #[error("the writer thread: {what}; restart the logger")]
    Thread {
        /// What is wrong.
        what: String,
    },
}

/// Refuses parts that are too short or too small, and rings that never begin a part.
pub(crate) fn check_split(split: Split) -> Result<(), RecorderError> {
    let Split { every_ns, every_bytes, keep_ns } = split;
    let seconds = |ns: u64| format!("{:?}", Duration::from_nanos(ns));
    let found = match (every_ns, every_bytes, keep_ns) {
        (Some(every), ..) if every < SHORTEST_PART_NS => seconds(every),
        (_, Some(every), _) if every < SMALLEST_PART => format!("{every} bytes"),
        (_, _, Some(keep)) if keep < SHORTEST_PART_NS => format!("a ring of {}", seconds(keep)),
        (None, None, Some(_)) => "a ring without parts".to_owned(),
        _ => return Ok(()),
    };
    Err(RecorderError::Split { found })
}
