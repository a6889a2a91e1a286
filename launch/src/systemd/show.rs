//! What `systemctl show` prints, read.

use std::collections::BTreeMap;

use crate::lifecycle::Exit;
use crate::status::UnitState;

/// The properties that are read.
pub(crate) const PROPERTIES: &str = "Id,ActiveState,SubState,MainPID,NRestarts,ExecMainCode,\
    ExecMainStatus,StatusText,StateChangeTimestampMonotonic";

/// What systemd says of a unit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Shown {
    active: String,
    sub: String,
    /// How the main process ended: `CLD_EXITED`, `CLD_KILLED`, `CLD_DUMPED`; 0 while it runs.
    exit_code: i32,
    /// With which code, or by which signal.
    exit_status: i32,
    /// Its main process; 0 if there is none.
    pub(crate) pid: i32,
    /// Starts after the first.
    pub(crate) restarts: u32,
    /// `STATUS=` of the process.
    pub(crate) status_text: Option<String>,
    /// When it entered this state (µs, `CLOCK_MONOTONIC`).
    pub(crate) changed_us: u64,
}

impl Shown {
    /// The state in the launcher's words.
    pub(crate) fn state(&self) -> UnitState {
        match (self.active.as_str(), self.sub.as_str()) {
            ("active" | "reloading", _) => UnitState::Ready,
            ("activating", "auto-restart" | "auto-restart-queued") => UnitState::BackOff,
            ("activating", _) => UnitState::Starting,
            ("deactivating", "stop-watchdog" | "stop-sigkill" | "final-sigkill") => {
                UnitState::Killing
            }
            ("deactivating", _) => UnitState::Stopping,
            ("failed", _) => UnitState::Failed,
            _ => UnitState::Inactive,
        }
    }

    /// How its last process ended, in the launcher's words; `None` while one runs.
    pub(crate) fn exit(&self) -> Option<String> {
        let exit = match self.exit_code {
            libc::CLD_EXITED => Exit::Code(self.exit_status),
            libc::CLD_KILLED | libc::CLD_DUMPED => Exit::Signal(self.exit_status),
            _ => return None,
        };
        Some(exit.to_string())
    }

    fn set(&mut self, key: &str, value: &str) {
        let number = || value.parse::<u64>().unwrap_or(0);
        match key {
            "ActiveState" => value.clone_into(&mut self.active),
            "SubState" => value.clone_into(&mut self.sub),
            "MainPID" => self.pid = value.parse().unwrap_or(0),
            "ExecMainCode" => self.exit_code = value.parse().unwrap_or(0),
            "ExecMainStatus" => self.exit_status = value.parse().unwrap_or(0),
            "NRestarts" => self.restarts = value.parse().unwrap_or(0),
            "StatusText" => self.status_text = Some(value.to_owned()).filter(|it| !it.is_empty()),
            "StateChangeTimestampMonotonic" => self.changed_us = number(),
            _ => {}
        }
    }
}

/// The blocks of the output, by `Id`; they are parted by empty lines.
pub(crate) fn parse(text: &str) -> BTreeMap<String, Shown> {
    let block = |text: &str| {
        let pairs = || text.lines().filter_map(|line| line.split_once('='));
        let (_, id) = pairs().find(|(key, _)| *key == "Id")?;
        let mut shown = Shown::default();
        pairs().for_each(|(key, value)| shown.set(key, value));
        Some((id.to_owned(), shown))
    };
    text.split("\n\n").filter_map(block).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
Id=farreach@bench.target
ActiveState=active
SubState=active
StateChangeTimestampMonotonic=1000

MainPID=4711
NRestarts=2
ExecMainCode=0
ExecMainStatus=0
StatusText=realtime
Id=farreach-control@bench.service
ActiveState=active
SubState=running
StateChangeTimestampMonotonic=2000

MainPID=0
ExecMainCode=2
ExecMainStatus=9
StatusText=
Id=farreach-logger@bench.service
ActiveState=activating
SubState=auto-restart
StateChangeTimestampMonotonic=3000
";

    #[test]
    fn blocks_are_read_by_their_ids() {
        let shown = parse(TEXT);
        assert_eq!(shown.len(), 3);
        assert_eq!(shown["farreach@bench.target"].state(), UnitState::Ready);
        let control = &shown["farreach-control@bench.service"];
        assert_eq!((control.state(), control.pid, control.restarts), (UnitState::Ready, 4711, 2));
        assert_eq!((control.exit(), control.changed_us), (None, 2000));
        assert_eq!(control.status_text.as_deref(), Some("realtime"));
        let logger = &shown["farreach-logger@bench.service"];
        assert_eq!((logger.state(), logger.changed_us), (UnitState::BackOff, 3000));
        assert_eq!(logger.exit().as_deref(), Some("signal 9 (SIGKILL)"));
        assert_eq!(logger.status_text, None);
    }

    #[test]
    fn what_systemd_does_not_know_is_inactive() {
        assert!(parse("").is_empty() && parse("Failed to connect to bus\n").is_empty());
        assert_eq!(Shown::default().state(), UnitState::Inactive);
        let of = |active: &str, sub: &str| {
            Shown { active: active.to_owned(), sub: sub.to_owned(), ..Shown::default() }.state()
        };
        assert_eq!(of("activating", "start"), UnitState::Starting);
        assert_eq!(of("deactivating", "stop-sigterm"), UnitState::Stopping);
        assert_eq!(of("deactivating", "stop-watchdog"), UnitState::Killing);
        assert_eq!(of("failed", "failed"), UnitState::Failed);
    }
}
