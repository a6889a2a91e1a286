//! What can go wrong, in words a person can act on.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::identity::ProcessIdentity;
use crate::status::Leftover;
use crate::units::UnitError;

/// A unit that could not be brought up.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StartFailure {
    /// Short name of the unit.
    pub unit: String,
    /// What happened at the last attempt.
    pub reason: String,
    /// How often it was tried.
    pub attempts: u32,
    /// Its log file.
    pub log: PathBuf,
    /// The last lines of it.
    pub log_tail: String,
}

impl std::fmt::Display for StartFailure {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { unit, reason, attempts, log, log_tail } = self;
        write!(formatter, "{unit} could not be brought up in {attempts} attempts: {reason}. ")?;
        if log_tail.is_empty() {
            write!(formatter, "It wrote nothing to {}", log.display())
        } else {
            write!(formatter, "Last lines of {}:\n{log_tail}", log.display())
        }
    }
}

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A unit file has something that is not honoured.
    #[error(transparent)]
    Unit(#[from] UnitError),
    /// The rig's name cannot be an instance name or a directory.
    #[error(
        "rig name `{found}`: expected letters, digits, `-`, `_` and `.`, not beginning with a dot"
    )]
    RigName {
        /// The name found.
        found: String,
    },
    /// The rig is up.
    #[error(
        "rig {rig} is already up (launcher {launcher}, {since}); bring it down first: farreach down"
    )]
    AlreadyUp {
        /// The rig.
        rig: String,
        /// Its launcher: `pid 4711`.
        launcher: String,
        /// Since when: `since 2026-01-02T03:04:05Z`.
        since: String,
    },
    /// Processes of an earlier launch live on, and were started with other settings.
    #[error(
        "processes of rig {rig} outlived their launcher and run with other settings ({}); end them first: farreach down",
        leftovers.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
    )]
    OtherSettings {
        /// The rig.
        rig: String,
        /// The living.
        leftovers: Vec<Leftover>,
    },
    /// Nothing of a rig in this directory.
    #[error("no rig is up in {}", run_dir.display())]
    NotUp {
        /// The directory.
        run_dir: PathBuf,
    },
    /// A unit could not be brought up; all that had been started was stopped.
    #[error("{0}")]
    Start(StartFailure),
    /// The launcher ended before the rig was up.
    #[error("the launcher ended before the rig was up: {message}")]
    Launcher {
        /// Its own words, or the tail of its log.
        message: String,
    },
    /// Bringing up was ended by a signal or by `stop`.
    #[error("bringing up rig {rig} was broken off: {cause}; all that had been started was stopped")]
    BrokenOff {
        /// The rig.
        rig: String,
        /// By what.
        cause: String,
    },
    /// The launcher lives, but does not answer.
    #[error("launcher {launcher} did not {what} within {seconds} s")]
    Silent {
        /// Its identity.
        launcher: ProcessIdentity,
        /// What was expected.
        what: &'static str,
        /// How long that was waited for, in s.
        seconds: u64,
    },
    /// The launcher refused a request.
    #[error("the launcher refused: {reason}")]
    Refused {
        /// Its words.
        reason: String,
    },
    /// A socket's path would not fit into a socket address.
    #[error("{} has {length} bytes, and a socket's path has room for 107; choose a shorter run directory", path.display())]
    PathTooLong {
        /// The path.
        path: PathBuf,
        /// Its length, in bytes.
        length: usize,
    },
    /// The run directory is someone else's, or others can write to it.
    #[error("{}: {found}; expected a directory of your own with mode 0700", path.display())]
    RunDirectory {
        /// The directory.
        path: PathBuf,
        /// What is wrong.
        found: String,
    },
    /// A file of the run directory does not read back.
    #[error("{}: {message}; if no process of the rig is left, remove it", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        message: String,
    },
    /// The system refused.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// What was to be done.
        doing: &'static str,
        /// With what.
        path: PathBuf,
        /// The system's words.
        source: io::Error,
    },
    /// The system refused something that has no path.
    #[error("cannot {doing}: {source}")]
    System {
        /// What was to be done.
        doing: &'static str,
        /// The system's words.
        source: io::Error,
    },
}

impl Error {
    pub(crate) fn io(doing: &'static str, path: &Path, source: impl Into<io::Error>) -> Self {
        Self::Io { doing, path: path.to_path_buf(), source: source.into() }
    }

    pub(crate) fn system(doing: &'static str, source: impl Into<io::Error>) -> Self {
        Self::System { doing, source: source.into() }
    }
}
