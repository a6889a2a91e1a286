//! All units of one rig: those asked for, those that they want, in the order of `After=`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::{Unit, UnitError, parse_service, parse_target};

/// The unit files that come with the binary, so that it works wherever it is put.
const EMBEDDED: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/units.rs"));

/// Unit files as text, by file name; embedded or from a directory.
#[derive(Clone, Debug)]
pub struct UnitSet {
    directory: PathBuf,
    files: BTreeMap<String, String>,
}

impl UnitSet {
    /// Those compiled into this binary.
    pub fn embedded() -> Self {
        Self {
            directory: PathBuf::from("<embedded>"),
            files: EMBEDDED
                .iter()
                .map(|(name, text)| ((*name).to_owned(), (*text).to_owned()))
                .collect(),
        }
    }

    /// Every `farreach-*@.service` and `farreach@.target` of a directory.
    ///
    /// # Errors
    /// When the directory or one of the files cannot be read.
    pub fn from_directory(directory: &Path) -> Result<Self, UnitError> {
        let read = |path: &Path, error: std::io::Error| UnitError::Read {
            path: path.to_path_buf(),
            message: error.to_string(),
        };
        let mut files = BTreeMap::new();
        for entry in std::fs::read_dir(directory).map_err(|error| read(directory, error))? {
            let entry = entry.map_err(|error| read(directory, error))?;
            let Ok(name) = entry.file_name().into_string() else { continue };
            if name == "farreach@.target"
                || (name.starts_with("farreach-") && name.ends_with("@.service"))
            {
                let text = std::fs::read_to_string(entry.path())
                    .map_err(|error| read(&entry.path(), error))?;
                files.insert(name, text);
            }
        }
        Ok(Self { directory: directory.to_path_buf(), files })
    }

    /// File names and texts.
    pub fn files(&self) -> impl Iterator<Item = (&str, &str)> {
        self.files.iter().map(|(name, text)| (name.as_str(), text.as_str()))
    }

    /// Short names of the services.
    pub fn names(&self) -> Vec<String> {
        self.files
            .keys()
            .filter_map(|file| file.strip_prefix("farreach-")?.strip_suffix("@.service"))
            .map(str::to_owned)
            .collect()
    }

    /// What the rig's target wants: the services of a rig with a card.
    ///
    /// # Errors
    /// When the target is missing or has something that is not honoured.
    pub fn target(&self, instance: &str) -> Result<Vec<String>, UnitError> {
        let name = "farreach@.target";
        let text = self.files.get(name).ok_or_else(|| UnitError::Unknown {
            name: "the target".to_owned(),
            file: name.to_owned(),
            known: self.names().join(", "),
        })?;
        parse_target(&self.directory.join(name), text, instance)
    }

    /// Parses one service.
    ///
    /// # Errors
    /// When there is no such file, or it has something that is not honoured.
    pub fn unit(&self, name: &str, instance: &str) -> Result<Unit, UnitError> {
        let file = format!("farreach-{name}@.service");
        let Some(text) = self.files.get(&file) else {
            return Err(UnitError::Unknown {
                name: name.to_owned(),
                file,
                known: self.names().join(", "),
            });
        };
        parse_service(&self.directory.join(&file), name, text, instance)
    }

    /// Parses the services asked for and all that they want, in the order in which they may be
    /// started.
    ///
    /// # Errors
    /// As [`UnitSet::unit`]; and when `After=` runs in a ring.
    pub fn load(&self, wanted: &[String], instance: &str) -> Result<Vec<Unit>, UnitError> {
        let mut pending: Vec<String> = wanted.to_vec();
        let mut units: BTreeMap<String, Unit> = BTreeMap::new();
        while let Some(name) = pending.pop() {
            if units.contains_key(&name) {
                continue;
            }
            let unit = self.unit(&name, instance)?;
            pending.extend(unit.wants.iter().cloned());
            units.insert(name, unit);
        }
        in_order(units)
    }
}

/// Sorts by `After=`; names that are not in the set do not count. Ties go by name, so the order is
/// always the same.
fn in_order(mut units: BTreeMap<String, Unit>) -> Result<Vec<Unit>, UnitError> {
    let mut sorted = Vec::with_capacity(units.len());
    while !units.is_empty() {
        let next =
            units.values().find(|unit| !unit.after.iter().any(|name| units.contains_key(name)));
        let Some(name) = next.map(|unit| unit.name.clone()) else {
            return Err(UnitError::Ring(units.keys().cloned().collect::<Vec<_>>().join(", ")));
        };
        sorted.extend(units.remove(&name));
    }
    Ok(sorted)
}
