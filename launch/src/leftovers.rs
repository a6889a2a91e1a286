//! What a dead launcher left running.

use serde::{Deserialize, Serialize};

use crate::{Error, ProcessIdentity, RunDir, process};

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

/// Processes of the rig that outlived its launcher. Meant for when there is no launcher.
pub(crate) fn of(run_dir: &RunDir) -> Result<Vec<Leftover>, Error> {
    let mut found: Vec<Leftover> = Vec::new();
    for unit in run_dir.last_status()?.into_iter().flat_map(|status| status.units) {
        if let Some(process) = unit.process.filter(ProcessIdentity::is_alive) {
            found.push(Leftover { unit: unit.name, process });
        }
    }
    for (unit, process) in process::find(run_dir) {
        if !found.iter().any(|leftover| leftover.process == process) {
            found.push(Leftover { unit, process });
        }
    }
    Ok(found)
}
