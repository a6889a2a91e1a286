//! The launcher's reports: the status while it runs, and the report of the stop.

use super::Supervisor;
use crate::lifecycle::Phase;
use crate::status::{RigState, Status, StopReport, UnitStatus, UnitStop, unix_ms};
use crate::{Error, StartFailure, log};

/// Lines of a unit's log in the report of a failed start.
const TAIL_LINES: usize = 20;

impl Supervisor {
    /// Updates the states of the units; `true` if one changed.
    pub(super) fn follow_states(&mut self) -> bool {
        let mut changed = false;
        for (index, supervised) in self.units.iter_mut().enumerate() {
            let state = self.lifecycle.state(index);
            if state != supervised.state {
                supervised.state = state;
                supervised.since_unix_ms = unix_ms();
                changed = true;
            }
        }
        changed
    }

    pub(super) fn status(&self) -> Status {
        Status {
            rig_name: self.config.rig_name.clone(),
            state: match self.lifecycle.phase() {
                Phase::BringUp => RigState::Starting,
                Phase::Up => RigState::Up,
                Phase::Stopping => RigState::Stopping,
                Phase::Down => RigState::Down,
            },
            cause: self.cause.clone(),
            launcher: self.identity,
            boot_id: self.boot_id.clone(),
            since_unix_ms: self.since_unix_ms,
            updated_unix_ms: unix_ms(),
            units: self
                .units
                .iter()
                .enumerate()
                .map(|(index, supervised)| UnitStatus {
                    name: supervised.unit.name.clone(),
                    state: supervised.state,
                    process: supervised.process.as_ref().map(|process| process.identity),
                    adopted: supervised.adopted && supervised.process.is_some(),
                    since_unix_ms: supervised.since_unix_ms,
                    restarts: self.lifecycle.restarts(index),
                    last_exit: supervised.last_exit.map(|exit| exit.to_string()),
                    restart_reason: self.lifecycle.reason(index).map(str::to_owned),
                    scheduling: supervised.scheduling.clone(),
                    status_text: supervised.status_text.clone(),
                    log: self.run_dir.log(&supervised.unit.name),
                })
                .collect(),
        }
    }

    /// Replaces `status.json`. A full disk does not end the launcher: it is logged once.
    pub(super) fn write_status(&mut self) {
        self.written = Some(self.now());
        if let Err(error) = self.run_dir.write_json(&self.run_dir.status_json(), &self.status()) {
            if !self.status_unwritten {
                self.journal.say(&error.to_string());
            }
            self.status_unwritten = true;
        } else {
            self.status_unwritten = false;
        }
    }

    /// Reports the completed stop to the clients that requested it; leaves nothing but the logs.
    pub(super) fn finish(mut self) -> Result<StopReport, Error> {
        self.end_strays();
        let failure = self.lifecycle.failure().map(|failure| {
            let unit = &self.units[failure.unit].unit.name;
            let log = self.run_dir.log(unit);
            StartFailure {
                unit: unit.clone(),
                reason: failure.reason.clone(),
                attempts: failure.attempts,
                log_tail: log::tail(&log, TAIL_LINES),
                log,
            }
        });
        let cause = match (&failure, &self.cause) {
            (Some(failure), _) => format!("{} could not be brought up", failure.unit),
            (None, Some(cause)) => cause.clone(),
            (None, None) => "no unit is left".to_owned(),
        };
        let mut units = std::mem::take(&mut self.stopped);
        for supervised in &self.units {
            if !units.iter().any(|stop| stop.name == supervised.unit.name) {
                units.push(UnitStop {
                    name: supervised.unit.name.clone(),
                    exit: None,
                    killed: false,
                    took_ms: 0,
                });
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
            Some(failure) => Err(Error::Start(failure)),
            None if self.aborted => Err(Error::BrokenOff { rig: report.rig_name, cause }),
            None => Ok(report),
        }
    }
}
