//! The part of a unit file that governs its lifecycle.

use std::time::Duration;

use super::Exit;
use crate::units::{Restart, Unit};

/// The part of a unit file that governs its lifecycle; refers to other units by index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Policy {
    /// Units started before this one and stopped after it.
    pub after: Vec<usize>,
    /// Units without which this one is not started again.
    pub gates: Vec<usize>,
    /// Time allowed from start to ready.
    pub timeout_start: Duration,
    /// Time allowed from the request to stop to the end.
    pub timeout_stop: Duration,
    /// Longest silence.
    pub watchdog: Option<Duration>,
    /// When to start again.
    pub restart: Restart,
    /// Shortest pause before a restart.
    pub restart_delay: Duration,
    /// Exit codes after which there is no restart.
    pub restart_prevent_exit_status: Vec<i32>,
    /// Starts allowed within the interval; 0 for no limit.
    pub start_limit_burst: u32,
    /// That interval.
    pub start_limit_interval: Duration,
}

impl Policy {
    /// The policies of units, in the same order. Names of units that are not among them do not
    /// count.
    pub fn of(units: &[Unit]) -> Vec<Self> {
        let index = |name: &String| units.iter().position(|unit| unit.name == *name);
        units
            .iter()
            .map(|unit| Self {
                after: unit.after.iter().filter_map(index).collect(),
                gates: unit.gates().filter_map(index).collect(),
                timeout_start: unit.timeout_start,
                timeout_stop: unit.timeout_stop,
                watchdog: unit.watchdog,
                restart: unit.restart,
                restart_delay: unit.restart_delay,
                restart_prevent_exit_status: unit.restart_prevent_exit_status.clone(),
                start_limit_burst: unit.start_limit_burst,
                start_limit_interval: unit.start_limit_interval,
            })
            .collect()
    }

    /// Whether there is no restart after this end.
    pub(super) fn prevents(&self, exit: Exit) -> bool {
        matches!(exit, Exit::Code(code) if self.restart_prevent_exit_status.contains(&code))
    }
}
