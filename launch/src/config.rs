//! What to launch.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::units::{Unit, UnitSet};

/// What to launch, and where.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Config {
    /// Name of the rig: the instance `%i` of every unit.
    pub rig_name: String,
    /// The rig's directory: sockets, status, logs. Made with mode 0700 if absent. Short: a socket's
    /// path has 107 bytes.
    pub run_dir: PathBuf,
    /// What stands for the first word of every `ExecStart=`; also the launcher's own executable.
    pub executable: PathBuf,
    /// Short names of the units to start; what they want is started as well.
    pub units: Vec<String>,
    /// Variables for every process, in place of `EnvironmentFile=`.
    pub environment: BTreeMap<String, String>,
    /// Where to read unit files; `None` for those compiled in.
    #[serde(default)]
    pub units_directory: Option<PathBuf>,
    /// Whether the launcher's own messages go to standard error as well as to `launcher.log`.
    #[serde(default)]
    pub foreground: bool,
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
            units_directory: None,
            foreground: false,
        }
    }

    /// Adds units by short name.
    #[must_use]
    pub fn with_units<S: Into<String>>(mut self, units: impl IntoIterator<Item = S>) -> Self {
        self.units.extend(units.into_iter().map(Into::into));
        self
    }

    /// Sets a variable for every process.
    #[must_use]
    pub fn with_environment(mut self, name: impl Into<String>, value: impl Into<String>) -> Self {
        self.environment.insert(name.into(), value.into());
        self
    }

    /// Checks names and paths, and makes the paths absolute.
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
        if let Some(directory) = &self.units_directory {
            self.units_directory = Some(absolute(directory)?);
        }
        Ok(self)
    }

    /// The units in the order in which they may be started.
    ///
    /// # Errors
    /// When a unit file is missing or has something that is not honoured.
    pub fn load_units(&self) -> Result<Vec<Unit>, Error> {
        let set = match &self.units_directory {
            None => UnitSet::embedded(),
            Some(directory) => UnitSet::from_directory(directory)?,
        };
        Ok(set.load(&self.units, &self.rig_name)?)
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
