//! Status of a rig (`status.json`) and report of a stop.

use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::supervision::Supervision;
use crate::{ProcessIdentity, Scheduling};

/// State of the whole rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RigState {
    /// Units are being started for the first time.
    Starting,
    /// All units have been ready; a process that ends is restarted.
    Up,
    /// Units are being stopped.
    Stopping,
    /// All are stopped.
    Down,
    /// The launcher is dead; some units are alive.
    Abandoned,
}

/// State of one unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UnitState {
    /// Not started, or exited cleanly.
    Inactive,
    /// Started; `READY=1` not yet received.
    Starting,
    /// Ready.
    Ready,
    /// Killed by the launcher; has not ended yet.
    Killing,
    /// Waiting for its next start.
    BackOff,
    /// Waiting until a unit that it needs is ready again.
    Gated,
    /// Asked to stop.
    Stopping,
    /// Given up; `restart` tries again.
    Failed,
    /// Alive, but its launcher is dead (only in the answer of [`crate::status`]).
    Unsupervised,
}

impl UnitState {
    /// Whether there is, or may be, a process.
    pub fn has_process(self) -> bool {
        matches!(
            self,
            Self::Starting | Self::Ready | Self::Killing | Self::Stopping | Self::Unsupervised
        )
    }
}

/// One unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnitStatus {
    /// Short name.
    pub name: String,
    /// State.
    pub state: UnitState,
    /// Its process, if it has one.
    pub process: Option<ProcessIdentity>,
    /// Whether the process was adopted from a launcher that died.
    pub adopted: bool,
    /// When it entered this state (ms since 1970, UTC).
    pub since_unix_ms: u64,
    /// Starts after the first.
    pub restarts: u32,
    /// How its predecessor ended: `exit code 1`, `signal 9 (SIGKILL)`.
    pub last_exit: Option<String>,
    /// Why it was or will be restarted.
    pub restart_reason: Option<String>,
    /// Scheduling requested and granted.
    pub scheduling: Option<Scheduling>,
    /// The program that runs in place of farreach's own.
    #[serde(default)]
    pub replaced_by: Option<String>,
    /// The process's own status (`STATUS=`).
    pub status_text: Option<String>,
    /// Its log file; empty under systemd, where the journal has it.
    pub log: PathBuf,
}

/// The rig: what `status.json` holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Name of the rig.
    pub rig_name: String,
    /// Who supervises it.
    #[serde(default)]
    pub supervision: Supervision,
    /// State.
    pub state: RigState,
    /// Why it is stopping or was aborted.
    pub cause: Option<String>,
    /// The launcher's process; that of systemd is number 1.
    pub launcher: ProcessIdentity,
    /// Boot of the computer in which the start times are valid.
    pub boot_id: String,
    /// When the launcher started, in ms since 1970 (UTC).
    pub since_unix_ms: u64,
    /// When this was written, in ms since 1970 (UTC); at least each 200 ms.
    pub updated_unix_ms: u64,
    /// The units in the order of their start.
    pub units: Vec<UnitStatus>,
}

impl Status {
    /// The unit of this name.
    pub fn unit(&self, name: &str) -> Option<&UnitStatus> {
        self.units.iter().find(|unit| unit.name == name)
    }
}

/// How one unit was stopped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnitStop {
    /// Short name.
    pub name: String,
    /// How its process ended; `None` if there was none.
    pub exit: Option<String>,
    /// Whether it had to be killed: it did not end within `TimeoutStopSec=`.
    pub killed: bool,
    /// From the first signal to its end, in ms; under systemd, from the request to stop the rig.
    pub took_ms: u64,
}

/// What a stop did, in the order in which the units ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StopReport {
    /// Name of the rig.
    pub rig_name: String,
    /// What requested it.
    pub cause: String,
    /// The units.
    pub units: Vec<UnitStop>,
    /// Processes of the rig in no status (their launcher died while starting them), killed as well.
    pub strays: Vec<ProcessIdentity>,
}

/// A living process of a rig whose launcher is dead.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Leftover {
    /// Short name of its unit.
    pub unit: String,
    /// The process.
    pub process: ProcessIdentity,
}

impl std::fmt::Display for Leftover {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} {}", self.unit, self.process)
    }
}

/// Wall clock, in ms since 1970 (UTC).
pub(crate) fn unix_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

/// Last ms of the year 9999: later times have no date to be written.
const LAST_MS: u64 = 253_402_300_799_999;

/// `2026-01-02T03:04:05Z` from ms since 1970; the end of the year 9999 for later ones.
pub(crate) fn utc(unix_ms: u64) -> String {
    let unix_ms = unix_ms.min(LAST_MS);
    humantime::format_rfc3339_seconds(UNIX_EPOCH + Duration::from_millis(unix_ms)).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_time_has_a_date() {
        assert_eq!(utc(1_767_323_045_999), "2026-01-02T03:04:05Z");
        assert_eq!(utc(u64::MAX), "9999-12-31T23:59:59Z");
    }
}
