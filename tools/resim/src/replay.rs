//! All cores on the messages of a recording.

use std::collections::BTreeMap;

use control::law::LawConfig;
use ipc_types::{Message, Process};
use rig::RigFile;
use thiserror::Error;

use crate::control_replay::ControlReplay;
use crate::experiment_replay::ExperimentReplay;
use crate::gate_replay::GateReplay;
use crate::history::{Inputs, Recorded};
use crate::report::Report;
use crate::rigs::Rigs;
use crate::runs::Runs;
use crate::watchdog_replay::WatchdogReplay;

/// The other rig file is of another machine.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error(
    "{file}: expected a rig of {expected} axes, as the recording's, found {found}; gains can be \
     tried on the recording of their own machine only"
)]
pub struct OtherAxes {
    /// The other rig file.
    pub file: String,
    /// Axes of the recording's.
    pub expected: usize,
    /// Axes of the other one.
    pub found: usize,
}

/// Longest time from the start of a program to the logger's event about it (s): the logger looks
/// twenty times a second, and a host that stalls holds it up.
const TOLD_LATE_S: f64 = 0.5;

/// A stretch of time in which a program of somebody else's was started in place of a process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foreign {
    /// The process.
    pub process: Process,
    /// Since when (s since the recording began).
    pub from_s: f64,
    /// Until when (s since the recording began).
    pub until_s: f64,
}

impl Foreign {
    /// Whether a process whose first recorded message came at a time (s) is such a program;
    /// `begins` tells whether that message is its first of all. A program that was started in this
    /// stretch may have begun to publish before the recording was told.
    fn holds(&self, at_s: f64, begins: bool) -> bool {
        let told_late_s = if begins { TOLD_LATE_S } else { 0.0 };
        (self.from_s - told_late_s..self.until_s).contains(&at_s)
    }
}

/// Runs the cores again, message by message.
#[derive(Debug)]
pub struct Replay {
    rigs: Rigs,
    foreign: Vec<Foreign>,
    /// Whether a process is a program of somebody else's, by incarnation.
    known: BTreeMap<u64, bool>,
    inputs: Inputs,
    control: ControlReplay,
    gate: GateReplay,
    watchdog: WatchdogReplay,
    experiment: ExperimentReplay,
    /// Axes of the rig whose gains are tried.
    other_axes: Option<usize>,
}

impl Replay {
    /// On the recording of a rig that played these protocols; `other` is the rig file whose gains
    /// are tried, `foreign` where programs of somebody else's ran.
    ///
    /// # Errors
    /// [`OtherAxes`].
    pub fn new(
        rigs: Rigs,
        runs: Runs,
        other: Option<&RigFile>,
        foreign: Vec<Foreign>,
    ) -> Result<Self, OtherAxes> {
        let expected = rigs.at(0).map_or(0, |rig| rig.axes.len());
        if let Some(other) = other.filter(|other| other.axes.len() != expected) {
            let (file, found) = (other.file_name().to_owned(), other.axes.len());
            return Err(OtherAxes { file, expected, found });
        }
        Ok(Self {
            rigs,
            foreign,
            known: BTreeMap::new(),
            inputs: Inputs::new(),
            control: ControlReplay::new(other.map(LawConfig::of_rig)),
            gate: GateReplay::new(),
            watchdog: WatchdogReplay::new(),
            experiment: ExperimentReplay::new(runs),
            other_axes: other.map(|other| other.axes.len()),
        })
    }

    /// Takes a recorded message; messages come in the order of publishing.
    pub fn take(&mut self, message: Recorded<'_>) {
        match message {
            Recorded::Sample(sample) if self.is_foreign(Process::Acquisition, sample) => {
                self.gate.skip(sample);
            }
            Recorded::Sample(sample) => self.gate.see(sample, &self.inputs, &self.rigs),
            Recorded::Command(command) if self.is_foreign(Process::Control, command) => {
                self.control.skip(command);
            }
            Recorded::Command(command) => self.control.see(command, &self.inputs, &self.rigs),
            Recorded::Token(token) if self.is_foreign(Process::Watchdog, token) => {
                self.watchdog.skip(token);
            }
            Recorded::Token(token) => self.watchdog.see(token, &self.inputs, &self.rigs),
            Recorded::Line(line) if self.is_foreign(Process::Watchdog, line) => {
                self.watchdog.skip_line();
            }
            Recorded::Line(line) => self.watchdog.see_line(line, &self.inputs, &self.rigs),
            Recorded::Setpoint(setpoint) if self.is_foreign(Process::Experiment, setpoint) => {
                self.experiment.skip(setpoint);
            }
            Recorded::Setpoint(setpoint) => {
                self.experiment.see(setpoint, &self.inputs, &self.rigs);
            }
            Recorded::Pulse(_) | Recorded::Key(_) => {}
        }
        self.inputs.take(&message);
    }

    /// Whether the sender of a message is a program of somebody else's: by when it published first.
    fn is_foreign(&mut self, process: Process, message: &impl Message) -> bool {
        let at_s = self.rigs.seconds(message.time_ns());
        let begins = message.sequence() == 0;
        let foreign = &self.foreign;
        let known = || foreign.iter().any(|it| it.process == process && it.holds(at_s, begins));
        *self.known.entry(message.incarnation()).or_insert_with(known)
    }

    /// What was found.
    pub fn report(self) -> Report {
        let other = &self.control.compared_with_other;
        let other_gains = self.other_axes.map(|axes| other.result(axes));
        Report {
            cores: vec![
                self.control.report,
                self.gate.report,
                self.watchdog.report,
                self.watchdog.lines,
                self.experiment.report,
            ],
            trips: self.watchdog.trips,
            other_gains,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_began_shortly_before_it_was_told_of_is_foreign() {
        let foreign = Foreign { process: Process::Control, from_s: 1.0, until_s: 2.0 };
        assert!(foreign.holds(0.9, true) && foreign.holds(1.5, true));
        // It ran long before that: the one that was replaced.
        assert!(!foreign.holds(0.9, false) && foreign.holds(1.5, false));
        assert!(!foreign.holds(0.4, true) && !foreign.holds(2.0, true));
    }
}
