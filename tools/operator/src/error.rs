//! Errors of this crate, and the exit codes of the commands.

use std::path::PathBuf;

use ipc_types::{Verb, WatchdogState};
use rig::FileError;
use runtime::{DomainError, PortError, RequestError};

/// Exit code: done.
pub const DONE: i32 = 0;
/// Exit code: failed.
pub const FAILED: i32 = 1;
/// Exit code: wrong usage; nothing was tried.
pub const USAGE: i32 = 2;
/// Exit code: done, but data was lost.
pub const DATA_LOST: i32 = 3;

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// None of `--simulate`, `--replay` and `--card`, and no `card` in the rig file.
    #[error(
        "no card was chosen; use the simulated card (--simulate), replay a measured record \
         (--replay RECORD), or name a card (--card NAME, or `card = \"NAME\"` in the rig file: {})",
        acquisition::DRIVERS.iter().map(|driver| driver.kind.text()).collect::<Vec<_>>().join(", ")
    )]
    NoCard,
    /// The rig file or the protocol is invalid.
    #[error(transparent)]
    File(#[from] FileError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] recording::mcap_read::ReadError),
    /// No protocol was played while the recording ran.
    #[error("{}: no protocol was played in this recording: none to repeat", .0.display())]
    NothingPlayed(PathBuf),
    /// The simulated card cannot be built: an unknown effect, or a model that cannot be simulated.
    #[error(transparent)]
    Simulator(#[from] simulator::CardError),
    /// The simulated card refused a fault.
    #[error("{0}")]
    Fault(String),
    /// The rig has no simulated card.
    #[error(
        "rig {rig} has no simulated card that answers: faults and effects are put into the \
         simulated card and machine only, never into a real one (farreach up --simulate)"
    )]
    NoSimulatedCard {
        /// Its name.
        rig: String,
    },
    /// The machine that is to be simulated has other axes or rates than the rig.
    #[error(
        "{file}: expected a machine with {expected}, as the rig file has them; found {found}; \
         give a rig file with the same"
    )]
    Machine {
        /// Its rig file.
        file: String,
        /// Axes and rates of the rig.
        expected: String,
        /// Its own.
        found: String,
    },
    /// The rates cannot keep the timeouts of the profile that the rig is to have.
    #[error(
        "{file}: {missed}; raise the rate, or bring a simulated card up in the profile best-effort \
         (--profile best-effort)"
    )]
    TooSlow {
        /// The rig file.
        file: String,
        /// What they miss.
        missed: rig::MissedTimeout,
    },
    /// How late loops wake could not be measured.
    #[error("how late loops wake on this computer cannot be measured: {0}")]
    Lateness(String),
    /// The rig file differs from that of the running rig in what cannot change while it is up.
    #[error(
        "{file}: differs in `{part}` from the file with which the rig was brought up, and only \
         gains, options of the control and the model may change while it is up; bring it down, and \
         up again with this file"
    )]
    RigFileDiffers {
        /// The file.
        file: String,
        /// The part.
        part: &'static str,
    },
    /// The motor is enabled, and would lose its power.
    #[error(
        "the motor is enabled, and {process} cuts its power while it is away; disarm first, or \
         say --force"
    )]
    MotorEnabled {
        /// Name of the process.
        process: String,
    },
    /// The program that is to replace a process cannot be run.
    #[error("{program}: expected an executable file, in PATH where it has no `/`; found none")]
    Program {
        /// As it was given.
        program: String,
    },
    /// The keeper holds the rig's shared memory.
    #[error("the keeper founds and holds the rig's shared memory; it is not replaced")]
    KeeperStays,
    /// Processes that were started again are not ready.
    #[error(
        "of the processes {units}, started again, one is not ready; see \
        `farreach status` and its log"
    )]
    NotRestarted {
        /// All that were started again.
        units: String,
    },
    /// The card cannot be opened.
    #[error(transparent)]
    Card(#[from] acquisition::CardError),
    /// The path is not UTF-8 and cannot be passed in an environment variable.
    #[error("{}: expected a path in UTF-8", .0.display())]
    Path(PathBuf),
    /// The system refused.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// The operation.
        doing: &'static str,
        /// Its file or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The launcher failed.
    #[error(transparent)]
    Launch(#[from] launch::Error),
    /// The shared memory could not be created or joined.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// A topic could not be subscribed to.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A process did not answer.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// systemd refused to stop the rig.
    #[error(
        "{}: {refusal}",
        if *disarmed {
            "the watchdog disarmed, so that the motor is off, and all processes go on"
        } else {
            "nothing was done"
        }
    )]
    NotStopped {
        /// Whether the watchdog disarmed before.
        disarmed: bool,
        /// What was refused.
        refusal: launch::Error,
    },
    /// A variable of the unit files is missing.
    #[error("{name} is not set; /etc/farreach/RIG/environment sets it (launch/README.md)")]
    NoVariable {
        /// The variable.
        name: &'static str,
    },
    /// The rig belongs to another user, whom this one may not become.
    #[error(
        "rig {rig} is run by systemd as another user (uid {user}), and only that user reaches its \
         shared memory: {reason}. Join the group farreach (root: `adduser NAME farreach`; then log \
         in anew), or run the command as root"
    )]
    NotItsUser {
        /// Its name.
        rig: String,
        /// Its user.
        user: u32,
        /// Why not.
        reason: String,
    },
    /// No process of the rig runs.
    #[error("rig {0} is not up; bring it up first: farreach up")]
    NotUp(String),
    /// The rig has no console.
    #[error("rig {rig} has no console; bring it up with one: farreach up --console")]
    NoConsole {
        /// Its name.
        rig: String,
    },
    /// A file written by `up` cannot be read back.
    #[error("{}: {reason}; bring the rig down and up again", path.display())]
    Launched {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The watchdog refused.
    #[error("{} refused: {reason}", verb.text())]
    Refused {
        /// The request.
        verb: Verb,
        /// Why it was refused.
        reason: String,
        /// Its state.
        state: WatchdogState,
    },
    /// No program takes an emergency stop away, whatever a person has agreed to before.
    #[error(
        "the rig was stopped by `estop`; a person who knows why must reset it (farreach reset)"
    )]
    EmergencyStopped,
    /// `run` enables only a rig that a person has armed.
    #[error(
        "the rig is {state}{}; a person must {}",
        if cause.is_empty() { String::new() } else { format!(" ({cause})") },
        if *state == WatchdogState::Disarmed {
            "arm it (farreach arm)"
        } else {
            "reset and arm it (farreach reset, farreach arm)"
        }
    )]
    NotArmed {
        /// State of the watchdog.
        state: WatchdogState,
        /// Cause and active faults, as text.
        cause: String,
    },
    /// The watchdog is silent.
    #[error("no message from the watchdog for {0} ms; is it running? (farreach status)")]
    NoWatchdog(u64),
    /// The experiment process refused the protocol or could not continue it.
    #[error("the experiment process reports: {0}")]
    Experiment(String),
    /// The logger refused or could not write.
    #[error("the logger reports: {0}")]
    Logger(String),
    /// Another protocol is being played.
    #[error(
        "protocol {name} is running (segment {segment} of {segments}); wait for its end, or stop \
         it with `farreach stop`"
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
