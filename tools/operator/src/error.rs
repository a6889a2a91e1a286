//! What can go wrong, in words a person can act on.

use std::path::PathBuf;

use ipc_types::{Verb, WatchdogState};
use rig::FileError;
use runtime::{DomainError, PortError, RequestError};

/// Exit code: everything was done.
pub const DONE: i32 = 0;
/// Exit code: it was tried and failed.
pub const FAILED: i32 = 1;
/// Exit code: it cannot be done as it was asked; nothing was tried.
pub const USAGE: i32 = 2;
/// Exit code: done, but data was lost.
pub const DATA_LOST: i32 = 3;

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Neither `--simulate` nor `--replay`.
    #[error(
        "this build has no driver for a real card; put the simulated one behind the rig (--simulate), \
         or a measured record (--replay RECORD)"
    )]
    NoCard,
    /// The rig file, or the protocol, is wrong.
    #[error(transparent)]
    File(#[from] FileError),
    /// The simulated card cannot be made: an effect that does not exist, a model that cannot be
    /// simulated.
    #[error(transparent)]
    Card(#[from] simulator::CardError),
    /// The record cannot be replayed on this rig.
    #[error(transparent)]
    Replay(#[from] acquisition::ReplayError),
    /// A path that is no text cannot be handed on in a variable of the environment.
    #[error("{}: expected a path in UTF-8", .0.display())]
    Path(PathBuf),
    /// The system refused.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// What was to be done.
        doing: &'static str,
        /// With what.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// The launcher could not do it.
    #[error(transparent)]
    Launch(#[from] launch::Error),
    /// The shared memory could not be made or joined.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// A topic could not be subscribed to.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A process did not answer.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// Nothing of that rig runs.
    #[error("rig {0} is not up; bring it up first: farreach up")]
    NotUp(String),
    /// A file that `up` left behind does not read back.
    #[error("{}: {reason}; bring the rig down and up again", path.display())]
    Launched {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The watchdog said no.
    #[error("{} refused: {reason}", verb.name())]
    Refused {
        /// What was asked.
        verb: Verb,
        /// Why not.
        reason: String,
        /// Its state.
        state: WatchdogState,
    },
    /// `run` only enables what a person armed.
    #[error(
        "the rig is {state}{}; nothing but a person arms: farreach {}",
        if cause.is_empty() { String::new() } else { format!(" ({cause})") },
        if *state == WatchdogState::Disarmed { "arm" } else { "reset, then farreach arm" }
    )]
    NotArmed {
        /// State of the watchdog.
        state: WatchdogState,
        /// Cause and standing faults, in words.
        cause: String,
    },
    /// The watchdog does not say anything.
    #[error("no word from the watchdog for {0} ms: is it running? (farreach status)")]
    NoWatchdog(u64),
    /// The runner refused the protocol, or could not go on.
    #[error("the experiment process reports: {0}")]
    Experiment(String),
    /// The logger refused, or could not write.
    #[error("the logger reports: {0}")]
    Logger(String),
    /// Another protocol is being played.
    #[error(
        "protocol {name} is running (segment {segment} of {segments}); wait for its end, or stop it with \
         `farreach stop`"
    )]
    Busy {
        /// Its name.
        name: String,
        /// Segment, from 1.
        segment: u32,
        /// How many.
        segments: u32,
    },
}

impl Error {
    /// The exit code of a command that ends with it.
    pub fn exit_code(&self) -> i32 {
        match self {
            Self::NoCard
            | Self::File(FileError::NotShipped { .. })
            | Self::Domain(DomainError::Name(_)) => USAGE,
            _ => FAILED,
        }
    }
}
