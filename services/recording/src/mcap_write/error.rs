//! Errors of writing a recording.

use std::io;
use std::path::{Path, PathBuf};

/// Why a recording cannot be written, or no longer.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A file of that name exists.
    #[error(
        "{path}: a file of that name exists; recordings are never overwritten: choose another name \
         or move it away"
    )]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The file could not be created.
    #[error(
        "{path}: cannot create the recording: {source}; check that the directory exists and is \
         writable"
    )]
    Create {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The disk is full. The writer takes no more messages.
    #[error(
        "{path}: the disk is full; {refused} messages refused; what was flushed before stays \
         readable: free some space and start a new recording"
    )]
    DiskFull {
        /// The file.
        path: PathBuf,
        /// Messages that are not in the file, or came after the last flush that held.
        refused: u64,
    },
    /// The disk failed. The writer takes no more messages.
    #[error(
        "{path}: cannot write: {source}; {refused} messages refused; what was flushed before stays \
         readable: start a new recording on another disk"
    )]
    Disk {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
        /// Messages that are not in the file, or came after the last flush that held.
        refused: u64,
    },
    /// An earlier error ended this recording.
    #[error(
        "{path}: the recording ended with an error ({cause}); {refused} messages refused since: \
         start a new recording"
    )]
    Poisoned {
        /// The file.
        path: PathBuf,
        /// What happened.
        cause: String,
        /// Messages that are not in the file, or came after the last flush that held.
        refused: u64,
    },
    /// No such topic.
    #[error("topic {topic}: expected one of the table of topics")]
    Topic {
        /// Index or name.
        topic: String,
    },
    /// A message of the wrong size.
    #[error("{topic}: expected {expected} bytes, found {found}: the sender is of another build")]
    Length {
        /// Name of the topic.
        topic: &'static str,
        /// Size by the table of topics (bytes).
        expected: usize,
        /// Size received (bytes).
        found: usize,
    },
    /// The MCAP library refused.
    #[error("{path}: {source}")]
    Format {
        /// The file.
        path: PathBuf,
        /// The library's error.
        source: mcap::McapError,
    },
}

pub(super) fn disk_error(path: &Path, source: mcap::McapError, refused: u64) -> WriteError {
    let path = path.to_owned();
    match source {
        mcap::McapError::Io(source)
            if matches!(
                source.kind(),
                io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded
            ) =>
        {
            WriteError::DiskFull { path, refused }
        }
        mcap::McapError::Io(source) => WriteError::Disk { path, source, refused },
        source => WriteError::Format { path, source },
    }
}
