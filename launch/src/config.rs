//! What to launch.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ipc_types::ProcessEntry;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::supervision::Supervision;
use crate::units::{Unit, in_order};

/// What to launch, and where.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Config {
    /// Name of the rig.
    pub rig_name: String,
    /// The rig's directory: sockets, status, logs. Made with mode 0700 if absent. Short: a socket's
    /// path has 107 bytes.
    pub run_dir: PathBuf,
    /// Executable of every process, and of the launcher.
    pub executable: PathBuf,
    /// The units to start.
    pub units: Vec<Unit>,
    /// Variables for every process.
    pub environment: BTreeMap<String, String>,
    /// Whether the launcher's own messages go to standard error as well as to `launcher.log`.
    #[serde(default)]
    pub foreground: bool,
    /// Who supervises the rig.
    #[serde(default)]
    pub supervision: Supervision,
    /// Program and arguments of the units that run a program of others in place of farreach's. The
    /// logger reads it, and [`Self::supervision`], in `launch.json`.
    #[serde(default)]
    pub replaced: BTreeMap<String, Vec<String>>,
}

impl Config {
    /// A configuration with no units and no variables yet.
    pub fn new(
        rig_name: impl Into<String>,
        run_dir: impl Into<PathBuf>,
        executable: impl Into<PathBuf>,
    ) -> Self {
        Self {
            rig_name: rig_name.into(),
            run_dir: run_dir.into(),
            executable: executable.into(),
            units: Vec::new(),
            environment: BTreeMap::new(),
            foreground: false,
            supervision: Supervision::Launcher,
            replaced: BTreeMap::new(),
        }
    }

    /// Adds the units of processes.
    #[must_use]
    pub fn with_processes<'p>(
        mut self,
        processes: impl IntoIterator<Item = &'p ProcessEntry>,
    ) -> Self {
        self.units.extend(processes.into_iter().map(Unit::of));
        self
    }

    /// Sets a variable for every process.
    #[must_use]
    pub fn with_environment(mut self, name: impl Into<String>, value: impl Into<String>) -> Self {
        self.environment.insert(name.into(), value.into());
        self
    }

    /// Whether a unit of that name is among those to start.
    pub fn has_unit(&self, name: &str) -> bool {
        self.units.iter().any(|unit| unit.name == name)
    }

    /// Program and arguments of a unit.
    pub(crate) fn command(&self, unit: &str) -> (PathBuf, Vec<String>) {
        match self.replaced.get(unit).and_then(|command| command.split_first()) {
            Some((program, arguments)) => (program.into(), arguments.to_vec()),
            None => (self.executable.clone(), vec!["service".to_owned(), unit.to_owned()]),
        }
    }

    /// Checks names and paths, makes the paths absolute, and puts the units in the order of start.
    pub(crate) fn checked(mut self) -> Result<Self, Error> {
        let allowed =
            |character: char| character.is_ascii_alphanumeric() || "-_.".contains(character);
        if self.rig_name.is_empty()
            || self.rig_name.starts_with('.')
            || !self.rig_name.chars().all(allowed)
        {
            return Err(Error::RigName { found: self.rig_name });
        }
        self.run_dir = absolute(&self.run_dir)?;
        self.executable = absolute(&self.executable)?;
        self.units = in_order(self.units);
        Ok(self)
    }

    /// Whether processes started with `other` do what this configuration asks for.
    pub(crate) fn same_processes(&self, other: &Self) -> bool {
        let plain = |config: &Self| Self { foreground: false, ..config.clone() };
        plain(self) == plain(other)
    }
}

fn absolute(path: &Path) -> Result<PathBuf, Error> {
    std::path::absolute(path).map_err(|source| Error::io("make absolute", path, source))
}
