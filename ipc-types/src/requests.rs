//! Requests and answers of the command plane (request-response, encoded with bincode by `runtime`).

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::codes::codes;
use crate::pulse_source::PulseSource;

codes! {
    /// The operator's verbs. Their words are those of the command line.
    Verb {
        /// Clears a fault that is no longer active.
        Reset = 0, "reset";
        /// Makes ready; only a person does this.
        Arm = 1, "arm";
        /// Powers the motor.
        Enable = 2, "enable";
        /// Takes power and readiness away in good order.
        Disarm = 3, "disarm";
        /// Cuts power and latches.
        Estop = 4, "estop";
        /// Makes ready a real card without a doctor's report that allows it; recorded as an event.
        ArmUnchecked = 5, "arm --unchecked";
    }
}

impl Verb {
    /// What a token says of the verb that was executed in its cycle ([`crate::EnableToken::verb`]).
    pub const fn executed_code(executed: Option<Self>) -> u8 {
        match executed {
            Some(verb) => verb.code() + 1,
            None => 0,
        }
    }

    /// The verb that a token says was executed; `None` for none, or one that this build does not
    /// know.
    pub const fn from_executed_code(code: u8) -> Option<Self> {
        match code.checked_sub(1) {
            Some(code) => Self::from_code(code),
            None => None,
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
        /// When to go on in another file.
        split: Split,
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
    /// Begins the next part of a ring now; answered when the part before is whole.
    NextPart,
    /// Puts a note into the recording in progress: an event of the logger. Refused where nothing
    /// is being recorded, or where an event cannot hold both whole.
    Tag {
        /// Who gives it.
        author: String,
        /// What it says.
        text: String,
    },
}

/// When a recording goes on in its next part: at whichever comes first, or, by default, never; and
/// whether the parts before stay.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Split {
    /// Length of a part (ns).
    pub every_ns: Option<u64>,
    /// Size of a part (bytes), which the end of the file is added to.
    pub every_bytes: Option<u64>,
    /// Of a ring: how much of the past is kept (ns). Parts that ended before are removed, once
    /// another [`Split::every_ns`] has passed. `None`: all of them stay.
    pub keep_ns: Option<u64>,
}

/// A ring: a recording of which the newest parts are kept.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RingStatus {
    /// The file of part 1, by which the others are called (`recording::part_path`).
    pub first: String,
    /// Numbers of the parts that are there, the present one last.
    pub parts: Vec<u32>,
    /// How much of the past is kept (ns).
    pub keep_ns: u64,
    /// Size of the parts, as far as they are written (bytes).
    pub bytes: u64,
    /// Parts that were removed.
    pub removed: u64,
    /// Parts that could not be removed: they stay.
    pub not_removed: u64,
}

/// Answer of the logger.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoggerAnswer {
    /// Present recording, if any.
    pub recording: Option<String>,
    /// Messages written to it.
    pub written: u64,
    /// Messages lost on the way (gaps, full queue, refused by the disk).
    pub lost: u64,
    /// Its parts, if the recording is a ring.
    pub ring: Option<RingStatus>,
    /// What went wrong; empty if nothing.
    pub error: String,
}

/// Request to the simulated card.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SimulatorRequest {
    /// Changes the simulated machine while it moves, to that of the rig file with these effects.
    Effects {
        /// Each `ID[@SITE][=SIZE]`.
        effects: Vec<String>,
    },
    /// Puts a fault into the card or the machine.
    Fault {
        /// `KIND[@PLACE][=SIZE]`.
        fault: String,
        /// Name or number of the axis; `None`: the first.
        axis: Option<String>,
        /// How long (s); `None`: until it is cleared.
        for_s: Option<f64>,
    },
    /// Ends faults.
    ClearFaults {
        /// `KIND[@PLACE]`: those alone; `None`: all.
        fault: Option<String>,
        /// Name or number of the axis; `None`: every axis.
        axis: Option<String>,
    },
    /// Which effects and faults has it?
    Status,
}

/// Answer of the simulated card.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SimulatorAnswer {
    /// Effects of the simulated machine, beside those of the rig file.
    pub effects: Vec<String>,
    /// Faults in force; in the answer to a request that begins or ends faults, those alone.
    pub faults: Vec<InjectedFault>,
    /// Why nothing was changed; empty otherwise.
    pub error: String,
}

/// A fault of the simulated card or machine.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct InjectedFault {
    /// `KIND[@PLACE][=SIZE]`.
    pub fault: String,
    /// Name of its axis.
    pub axis: String,
    /// Tick of the first scan with it.
    pub begun_tick: u64,
    /// Tick at which it ends by itself; `None`: it stays until it is cleared.
    pub until_tick: Option<u64>,
    /// Tick of the first scan without it; `None` while it is in force.
    pub ended_tick: Option<u64>,
}

impl fmt::Display for InjectedFault {
    /// `encoder_stuck@master on handle since tick 123456`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { fault, axis, begun_tick, until_tick, ended_tick } = self;
        write!(f, "{fault} on {axis} since tick {begun_tick}")?;
        match (ended_tick, until_tick) {
            (Some(tick), _) => write!(f, ", over at tick {tick}"),
            (None, Some(tick)) => write!(f, ", until tick {tick}"),
            (None, None) => Ok(()),
        }
    }
}

/// Request to the experiment runner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ExperimentRequest {
    /// Asks whether a protocol could be played now, but for the motor's power: read, fit for the
    /// rig, all axes homed that it needs.
    Check {
        /// Text of the protocol.
        protocol: String,
        /// File name, for messages.
        name: String,
        /// As in [`ExperimentRequest::Run`].
        pulses: PulseSource,
    },
    /// Plays a protocol for as long as its client renews the lease.
    Run {
        /// Text of the protocol; the sender has checked it, and the runner checks it again.
        protocol: String,
        /// File name, for messages.
        name: String,
        /// Number that the client chose for itself.
        client: u64,
        /// Where the scanner's pulses come from.
        pulses: PulseSource,
    },
    /// A pulse of the scanner, typed as the key 5. Refused where the protocol takes its pulses from
    /// elsewhere, and where another client's protocol is running.
    Pulse {
        /// Number from [`ExperimentRequest::Run`].
        client: u64,
        /// When the key was pressed [ns, CLOCK_MONOTONIC].
        at_ns: u64,
    },
    /// Renews the client's lease on its protocol, and asks for the status. Refused where another
    /// client's protocol is running.
    Renew {
        /// Number from [`ExperimentRequest::Run`].
        client: u64,
    },
    /// Asks which protocol was interrupted, and why it could not be continued now, if so.
    Interrupted,
    /// Plays the protocol that was interrupted, from the beginning of the segment in which it was,
    /// as [`ExperimentRequest::Run`] does.
    Continue {
        /// Number that the client chose for itself.
        client: u64,
        /// Identity of the protocol's text, and the segment: refused where another one was
        /// interrupted meanwhile.
        protocol: u64,
        /// Index of the segment in which it was interrupted.
        segment: u32,
    },
    /// Ends the protocol: the handle comes to rest and is held for a moment, then the volts go to
    /// 0.
    Stop {
        /// The protocol of this client only; `None`: whoever started it.
        client: Option<u64>,
    },
    /// Asks for the status; renews no lease.
    Status,
}

/// Answer of the experiment runner.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExperimentAnswer {
    /// Whether a protocol is running.
    pub running: bool,
    /// Name of the protocol that is running, or ran last; empty before the first.
    pub name: String,
    /// Index of the segment.
    pub segment: u32,
    /// Name of the segment.
    pub label: String,
    /// Number of segments.
    pub segments: u32,
    /// Time played (s).
    pub elapsed_s: f64,
    /// Whole duration (s).
    pub duration_s: f64,
    /// Whether the last protocol ran to its end.
    pub completed: bool,
    /// Whether the last protocol ended because of a trip, an emergency stop or a disarm.
    pub permission_lost: bool,
    /// The volumes of the scan so far; `None` for a protocol that counts none.
    pub scan: Option<ScanProgress>,
    /// The sessions so far; `None` for a protocol without.
    pub sessions: Option<SessionProgress>,
    /// The protocol that was interrupted; in the answer to [`ExperimentRequest::Interrupted`] only.
    pub interrupted: Option<InterruptedRun>,
    /// What went wrong; empty where nothing did.
    pub error: String,
}

/// A protocol with sessions that did not run to its end.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InterruptedRun {
    /// Its name, as it was run.
    pub name: String,
    /// Its text.
    pub protocol: String,
    /// Index of the segment in which it was interrupted.
    pub segment: u32,
    /// Sessions that ran to their end.
    pub sessions_over: u32,
    /// Where its scanner's pulses come from.
    pub pulses: PulseSource,
}

/// The sessions of a protocol so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SessionProgress {
    /// Sessions that ran to their end.
    pub over: u32,
    /// Sessions planned.
    pub sessions: u32,
    /// What the next one has to match: mean torque (N·m or N), or mean activity of agonists and
    /// antagonists; 0 before the first is over. `None` where they match nothing.
    pub target: Option<Vec<f64>>,
}

impl fmt::Display for SessionProgress {
    /// `2 of 4 sessions, target 0.213`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {} sessions", self.over, self.sessions)?;
        if let Some(target) = self.target.as_ref().filter(|_| self.over > 0) {
            write!(f, ", target")?;
            for (at, target) in target.iter().enumerate() {
                write!(f, "{} {target:.3}", if at > 0 { " and" } else { "" })?;
            }
        }
        Ok(())
    }
}

/// The volumes of a scan so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ScanProgress {
    /// Volumes with a pulse.
    pub volumes: u64,
    /// Volumes expected; 0 where the protocol does not say.
    pub expected: u64,
    /// Volumes without a pulse, between two that have one.
    pub missed: u64,
    /// Pulses that belong to no volume.
    pub spurious: u64,
    /// Pulses after the last volume.
    pub surplus: u64,
    /// Volumes that are due and have had no pulse yet.
    pub overdue: u64,
}

impl fmt::Display for ScanProgress {
    /// `12 of 300 volumes, 2 without a pulse`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.volumes + self.missed)?;
        if self.expected > 0 {
            write!(f, " of {}", self.expected)?;
        }
        write!(f, " volumes")?;
        for (count, what) in [
            (self.missed, "without a pulse"),
            (self.spurious, "spurious pulses"),
            (self.surplus, "pulses after the last volume"),
            (self.overdue, "OVERDUE"),
        ] {
            if count > 0 {
                write!(f, ", {count} {what}")?;
            }
        }
        Ok(())
    }
}
