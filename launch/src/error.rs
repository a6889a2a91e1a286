//! Errors of this crate.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::identity::ProcessIdentity;
use crate::status::Leftover;

/// A unit that could not be brought up.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StartFailure {
    /// Short name of the unit.
    pub unit: String,
    /// What happened at the last attempt.
    pub reason: String,
    /// Number of attempts.
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

/// Why a rig did not come up; all that had been started was stopped.
#[derive(Clone, Debug, Serialize, Deserialize, thiserror::Error)]
pub enum StartError {
    /// A unit could not be brought up.
    #[error("{0}")]
    Unit(StartFailure),
    /// A signal or `stop` aborted the start.
    #[error("the start of rig {rig} was aborted: {cause}; all that had been started was stopped")]
    BrokenOff {
        /// The rig.
        rig: String,
        /// What aborted it.
        cause: String,
    },
    /// The launcher ended before the rig was up.
    #[error("the launcher ended before the rig was up: {0}")]
    Launcher(String),
}

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The rig's name cannot be an instance name or a directory.
    #[error(
        "rig name `{found}`: expected letters, digits, `-`, `_` and `.`, not beginning with a dot"
    )]
    RigName {
        /// The name found.
        found: String,
    },
    /// The rig is already up.
    #[error(
        "rig {rig} is already up (launcher {launcher}, {since}); bring it down first: farreach \
         down"
    )]
    AlreadyUp {
        /// The rig.
        rig: String,
        /// Its launcher: `pid 4711`.
        launcher: String,
        /// Since when: `since 2026-01-02T03:04:05Z`.
        since: String,
    },
    /// Processes of an earlier launch are alive and were started with other settings.
    #[error(
        "processes of rig {rig} outlived their launcher and run with other settings ({}); end them \
         first: farreach down",
        leftovers.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
    )]
    OtherSettings {
        /// The rig.
        rig: String,
        /// The processes.
        leftovers: Vec<Leftover>,
    },
    /// No rig is up in this directory.
    #[error("no rig is up in {run_dir}")]
    NotUp {
        /// The directory.
        run_dir: PathBuf,
    },
    /// The rig did not come up.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The launcher is alive but does not answer.
    #[error("launcher {launcher} did not {what} within {seconds} s")]
    Silent {
        /// Its identity.
        launcher: ProcessIdentity,
        /// What was expected.
        what: &'static str,
        /// How long it was waited for (s).
        seconds: u64,
    },
    /// The launcher refused a request.
    #[error("the launcher refused: {reason}")]
    Refused {
        /// Why.
        reason: String,
    },
    /// `systemctl` failed, or is not there.
    #[error("`{command}` failed: {message}")]
    Systemctl {
        /// The command.
        command: String,
        /// What it said.
        message: String,
    },
    /// systemd lets only root, or whom a rule of polkit or sudo names, start and stop units.
    #[error("systemd refused ({message}); as root: {command}")]
    NotPermitted {
        /// What root is to enter.
        command: String,
        /// What was said.
        message: String,
    },
    /// A socket's path does not fit into a socket address.
    #[error(
        "{path} has {length} bytes, and a socket's path has room for 107; choose a shorter run \
         directory"
    )]
    PathTooLong {
        /// The path.
        path: PathBuf,
        /// Its length, in bytes.
        length: usize,
    },
    /// The run directory belongs to another user, or others can write to it.
    #[error("{path}: {found}; expected a directory of your own with mode 0700")]
    RunDirectory {
        /// The directory.
        path: PathBuf,
        /// What is wrong.
        found: String,
    },
    /// A file of the run directory cannot be read back.
    #[error("{path}: {message}; if no process of the rig is left, remove it")]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        message: String,
    },
    /// The system refused.
    #[error("cannot {doing} {path}: {source}")]
    Io {
        /// The operation.
        doing: &'static str,
        /// Its file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The system refused an operation that has no path.
    #[error("cannot {doing}: {source}")]
    System {
        /// The operation.
        doing: &'static str,
        /// The system's error.
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
