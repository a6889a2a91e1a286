//! The part of a unit that governs its lifecycle.

use std::time::Duration;

use crate::units::Unit;

/// Starts allowed within [`super::START_LIMIT_INTERVAL`] (`StartLimitBurst=`).
pub const START_LIMIT: u32 = 10;

/// The part of a unit that governs its lifecycle; refers to other units by index.
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
    /// Longest silence; `None` where nothing is watched.
    pub watchdog: Option<Duration>,
    /// Starts allowed within [`super::START_LIMIT_INTERVAL`].
    pub start_limit: u32,
}

impl Policy {
    /// The policies of units, in the same order. Names of units that are not among them do not
    /// count.
    pub fn of(units: &[Unit]) -> Vec<Self> {
        let indices = |names: &[String]| {
            names
                .iter()
                .filter_map(|name| units.iter().position(|unit| unit.name == *name))
                .collect()
        };
        units
            .iter()
            .map(|unit| Self {
                after: indices(&unit.after),
                gates: indices(&unit.gates),
                timeout_start: unit.timeout_start,
                timeout_stop: unit.timeout_stop,
                watchdog: Some(unit.watchdog),
                start_limit: START_LIMIT,
            })
            .collect()
    }
}
