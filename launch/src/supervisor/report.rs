//! The launcher's reports: the status while it runs, and the report of the stop.

use super::Supervisor;
use crate::status::{StopReport, UnitStop, unix_ms};
use crate::{Error, StartError, StartFailure, log};

/// Lines of a unit's log in the report of a failed start.
const TAIL_LINES: usize = 20;

impl Supervisor {
    /// Updates the states of the units; `true` if one changed.
    pub(super) fn follow_states(&mut self) -> bool {
        let mut changed = false;
        for (index, unit) in self.status.units.iter_mut().enumerate() {
            let state = self.lifecycle.state(index);
            if state != unit.state {
                unit.state = state;
                unit.since_unix_ms = unix_ms();
                changed = true;
            }
        }
        changed
    }

    /// Takes over what the lifecycle and the processes say.
    pub(super) fn refresh_status(&mut self) {
        self.status.state = self.lifecycle.phase();
        self.status.updated_unix_ms = unix_ms();
        for (index, unit) in self.status.units.iter_mut().enumerate() {
            unit.process = self.processes[index].as_ref().map(|process| process.identity);
            unit.restarts = self.lifecycle.restarts(index);
            unit.restart_reason = self.lifecycle.reason(index).map(str::to_owned);
        }
    }

    /// Replaces `status.json`. A full disk does not end the launcher: it is logged once.
    pub(super) fn write_status(&mut self) {
        self.written = Some(self.now());
        self.refresh_status();
        let written = self.run_dir.write_json(&self.run_dir.status_json(), &self.status);
        if let (Err(error), false) = (&written, self.status_unwritten) {
            self.journal.say(&error.to_string());
        }
        self.status_unwritten = written.is_err();
    }

    /// Reports the completed stop to the clients that requested it; leaves nothing but the logs.
    pub(super) fn finish(mut self) -> Result<StopReport, Error> {
        self.end_strays();
        let failure = self.lifecycle.failure().map(|failure| {
            let unit = &self.config.units[failure.unit].name;
            let log = self.run_dir.log(unit);
            StartFailure {
                unit: unit.clone(),
                reason: failure.reason.clone(),
                attempts: failure.attempts,
                log_tail: log::tail(&log, TAIL_LINES),
                log,
            }
        });
        let cause = match (&failure, &self.status.cause) {
            (Some(failure), _) => format!("{} could not be brought up", failure.unit),
            (None, Some(cause)) => cause.clone(),
            (None, None) => "no unit is left".to_owned(),
        };
        let mut units = std::mem::take(&mut self.stopped);
        for unit in &self.config.units {
            if !units.iter().any(|stop| stop.name == unit.name) {
                let name = unit.name.clone();
                units.push(UnitStop { name, exit: None, killed: false, took_ms: 0 });
            }
        }
        let report = StopReport {
            rig_name: self.config.rig_name.clone(),
            cause: cause.clone(),
            units,
            strays: std::mem::take(&mut self.strays),
        };
        self.journal.say(&format!("all stopped: {cause}"));
        self.run_dir.clean();
        self.control.report(&report);
        match failure {
            Some(failure) => Err(StartError::Unit(failure).into()),
            None if self.aborted => {
                Err(StartError::BrokenOff { rig: report.rig_name, cause }.into())
            }
            None => Ok(report),
        }
    }
}
