//! Unit files: the parser of exactly the subset that the launcher honours.
//!
//! systemd and the launcher read the same files. The launcher ignores nothing: an unknown section,
//! key or value is an error that names file, line, key and what is supported ([`SUPPORTED`]).
//! Specifiers are `%i` (the rig's name) and `%%`.
//!
//! Three values say where things are on an installed machine; the launcher puts its own in their
//! place:
//!
//! | in the file | the launcher's |
//! |---|---|
//! | first word of `ExecStart=` | [`Config::executable`](crate::Config::executable) |
//! | `EnvironmentFile=` | [`Config::environment`](crate::Config::environment) |
//! | `RuntimeDirectory=`, also where `Environment=` names it | [`Config::run_dir`] |
//!
//! [`Config::run_dir`]: crate::Config::run_dir

mod parse;
mod set;
mod value;

use std::time::Duration;

use serde::{Deserialize, Serialize};

pub use parse::{SUPPORTED, UnitError, parse_service, parse_target};
pub use set::UnitSet;

/// One service unit, with `%i` already replaced.
#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// Name between `farreach-` and `@`, such as `control`.
    pub name: String,
    /// `Description=`.
    pub description: String,
    /// Short names from `Wants=`: started along with this unit.
    pub wants: Vec<String>,
    /// Short names from `After=`: started before this unit, stopped after it.
    pub after: Vec<String>,
    /// Longest window in which starts are counted.
    pub start_limit_interval: Duration,
    /// Starts allowed in that window; 0 for no limit.
    pub start_limit_burst: u32,
    /// `ExecStart=`, split at blanks; the first word is replaced by the launcher.
    pub exec_start: Vec<String>,
    /// `Environment=`, in the order of the file.
    pub environment: Vec<(String, String)>,
    /// `RuntimeDirectory=`, relative to `/run`.
    pub runtime_directory: Option<String>,
    /// When to start the process again.
    pub restart: Restart,
    /// Shortest time between an end and the next start.
    pub restart_delay: Duration,
    /// Exit codes after which there is no restart.
    pub restart_prevent_exit_status: Vec<i32>,
    /// Time allowed from start to `READY=1`.
    pub timeout_start: Duration,
    /// Time allowed from the first signal to the end.
    pub timeout_stop: Duration,
    /// Longest time between two `WATCHDOG=1`; `None` when nothing is watched.
    pub watchdog: Option<Duration>,
    /// Signal that asks the process to stop.
    pub kill_signal: StopSignal,
    /// Scheduling class and priority.
    pub scheduling: SchedulingPolicy,
    /// Cores; empty for all.
    pub cpu_affinity: Vec<usize>,
    /// `LimitMEMLOCK=`.
    pub limit_memlock: Option<Limit>,
    /// `LimitRTPRIO=`.
    pub limit_rtprio: Option<Limit>,
    /// `OOMScoreAdjust=`, -1000 to 1000.
    pub oom_score_adjust: Option<i32>,
}

impl Unit {
    /// Units without which this one must not start: those that it both wants and comes after.
    ///
    /// With systemd, a start job of this unit pulls in and waits for theirs; the launcher waits
    /// until they are ready.
    pub fn gates(&self) -> impl Iterator<Item = &String> {
        self.wants.iter().filter(|name| self.after.contains(name))
    }
}

/// `Restart=`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restart {
    /// Never.
    No,
    /// After everything but exit code 0 and the signals that ask politely (HUP, INT, TERM, PIPE).
    OnFailure,
    /// After every end that was not asked for.
    Always,
}

/// `KillSignal=`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopSignal {
    /// `SIGTERM`.
    Terminate,
    /// `SIGINT`.
    Interrupt,
}

/// `CPUSchedulingPolicy=` and `CPUSchedulingPriority=`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "policy", content = "priority")]
pub enum SchedulingPolicy {
    /// Ordinary time sharing.
    Other,
    /// `SCHED_FIFO` at this priority, 1 to 99.
    Fifo(i32),
    /// `SCHED_RR` at this priority, 1 to 99.
    Rr(i32),
}

impl SchedulingPolicy {
    /// Whether it is one of the real-time classes.
    pub fn is_realtime(self) -> bool {
        self.rank() > 0
    }

    /// The priority; 0 for ordinary time sharing, before which all others go.
    pub fn rank(self) -> i32 {
        match self {
            Self::Other => 0,
            Self::Fifo(priority) | Self::Rr(priority) => priority,
        }
    }
}

impl std::fmt::Display for SchedulingPolicy {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Other => write!(formatter, "other"),
            Self::Fifo(priority) => write!(formatter, "fifo {priority}"),
            Self::Rr(priority) => write!(formatter, "rr {priority}"),
        }
    }
}

/// A resource limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// `infinity`.
    Infinity,
    /// Bytes, or the priority.
    Value(u64),
}
