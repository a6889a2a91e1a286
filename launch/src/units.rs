//! The units: the processes that the launcher starts, and how, from the table of processes.
//!
//! `units/` has the same for systemd, generated from the table. Names of settings are systemd's.

use std::time::Duration;

use ipc_types::{Process, ProcessEntry};
use serde::{Deserialize, Serialize};

/// Time allowed from start to `READY=1`, for every unit of the table.
pub const TIMEOUT_START: Duration = Duration::from_secs(10);
/// Priority of a real-time process during its start: above everything outside the rig, below every
/// loop. The process raises itself when it enters its loop.
pub const START_PRIORITY: i32 = 10;
/// Highest priority to which it may raise itself (`LimitRTPRIO=`).
pub const PRIORITY_LIMIT: u64 = 90;

/// One process of a rig.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Unit {
    /// Its name; it is run as `EXECUTABLE service NAME`.
    pub name: String,
    /// Units started before this one, and stopped after it.
    pub after: Vec<String>,
    /// Those of them without which it must not start, at a restart as well.
    pub gates: Vec<String>,
    /// Time allowed from start to `READY=1`.
    pub timeout_start: Duration,
    /// Time allowed from the first signal to the end.
    pub timeout_stop: Duration,
    /// Longest time between two `WATCHDOG=1`.
    pub watchdog: Duration,
    /// Scheduling class and priority.
    pub scheduling: SchedulingPolicy,
    /// `LimitRTPRIO=`.
    pub limit_rtprio: Option<u64>,
    /// Whether it may lock memory without limit (`LimitMEMLOCK=infinity`).
    pub locks_memory: bool,
    /// `OOMScoreAdjust=`, -1000 to 1000.
    pub oom_score_adjust: Option<i32>,
}

impl Unit {
    /// The unit of a process.
    pub fn of(entry: &ProcessEntry) -> Self {
        let real_time = entry.real_time.is_some();
        let keeper = Process::Keeper;
        Self {
            name: entry.name().to_owned(),
            after: entry.after.iter().map(|process| process.text().to_owned()).collect(),
            gates: entry
                .after
                .contains(&keeper)
                .then(|| keeper.text().to_owned())
                .into_iter()
                .collect(),
            timeout_start: TIMEOUT_START,
            timeout_stop: Duration::from_secs(entry.stop_s.into()),
            watchdog: Duration::from_secs(entry.silence_s.into()),
            scheduling: if real_time {
                SchedulingPolicy::Fifo(START_PRIORITY)
            } else {
                SchedulingPolicy::Other
            },
            // The keeper tries whether real-time scheduling is granted to the rig.
            limit_rtprio: (real_time || entry.process == keeper).then_some(PRIORITY_LIMIT),
            locks_memory: true,
            oom_score_adjust: Some(entry.oom_score),
        }
    }
}

/// Sorts by [`Unit::after`]; names that are not in the list do not count. Ties go by name, so the
/// order is always the same.
pub(crate) fn in_order(mut units: Vec<Unit>) -> Vec<Unit> {
    units.sort_by(|a, b| a.name.cmp(&b.name));
    let mut sorted = Vec::with_capacity(units.len());
    while !units.is_empty() {
        let is_left = |name: &String| units.iter().any(|unit| unit.name == *name);
        let next = units.iter().position(|unit| !unit.after.iter().any(is_left));
        // Where all wait for each other, which the table of processes rules out, the first.
        sorted.push(units.remove(next.unwrap_or_default()));
    }
    sorted
}

/// `CPUSchedulingPolicy=` and `CPUSchedulingPriority=`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "policy", content = "priority")]
pub enum SchedulingPolicy {
    /// Ordinary time sharing.
    Other,
    /// `SCHED_FIFO` at this priority, 1 to 99.
    Fifo(i32),
    /// `SCHED_RR` at this priority, 1 to 99; no unit asks for it.
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
