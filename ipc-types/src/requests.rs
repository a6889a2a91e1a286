//! Requests and answers of the command plane (request-response, encoded with bincode by `runtime`).

use serde::{Deserialize, Serialize};

/// The operator's verbs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verb {
    /// Clears a fault that no longer stands.
    Reset,
    /// Makes ready; only a person does this.
    Arm,
    /// Powers the motor.
    Enable,
    /// Takes power and readiness away in good order.
    Disarm,
    /// Cuts power and latches.
    Estop,
}

impl Verb {
    /// The verb on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Reset => "reset",
            Self::Arm => "arm",
            Self::Enable => "enable",
            Self::Disarm => "disarm",
            Self::Estop => "estop",
        }
    }
}

/// Answer of the watchdog to a [`Verb`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct VerbAnswer {
    /// Whether it was done.
    pub done: bool,
    /// State afterwards.
    pub state: crate::WatchdogState,
    /// Why not, in words a person can act on; empty when done.
    pub reason: String,
}

/// Request to the logger.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LoggerRequest {
    /// Begin a recording at this absolute path, with these metadata.
    Start {
        /// Where to.
        path: String,
        /// Key and value pairs for the file's metadata record.
        metadata: Vec<(String, String)>,
    },
    /// End it; answered when everything is on disk.
    Stop,
    /// What is being recorded?
    Status,
    /// A protocol begins to be played: goes into the recording in progress, and into one that is
    /// begun or continued before the protocol's last event.
    Run {
        /// Key and value pairs, see `recording::mcap_write::key`: protocol, its text, subject.
        metadata: Vec<(String, String)>,
    },
}

/// Answer of the logger.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoggerAnswer {
    /// Present recording, if any.
    pub recording: Option<String>,
    /// Messages written to it.
    pub written: u64,
    /// Messages lost on the way (gaps, full queue, refused by the disk).
    pub lost: u64,
    /// What went wrong; empty if nothing.
    pub error: String,
}

/// Request to the experiment runner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ExperimentRequest {
    /// Play this protocol.
    Run {
        /// Its text, already checked by the sender and checked again by the runner.
        protocol: String,
        /// File name, for messages.
        name: String,
    },
    /// Stop playing: the handle comes to rest, is held for a moment, and the volts go to 0.
    Stop,
    /// How far is it?
    Status,
}

/// Answer of the experiment runner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExperimentAnswer {
    /// A protocol is being played.
    pub running: bool,
    /// Index of the segment.
    pub segment: u32,
    /// Number of segments.
    pub segments: u32,
    /// Time played (s).
    pub elapsed_s: f64,
    /// Whole duration (s).
    pub duration_s: f64,
    /// The last protocol came to its end.
    pub completed: bool,
    /// What went wrong; empty if nothing.
    pub error: String,
}
