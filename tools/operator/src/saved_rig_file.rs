//! The rig file that a rig runs with.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use launch::RunDir;
use rig::RigFile;
use runtime::RigName;

use crate::Error;

/// Variable with the rig file of all processes.
pub(crate) const RIG: &str = "FARREACH_RIG";
/// Variable with that of the machine that is simulated; empty where it is the same.
pub(crate) const MACHINE: &str = "FARREACH_MACHINE";

/// Puts the text of a rig file into the run directory. All processes read that copy, also those
/// that are started again hours later, so that a rig runs with one file however its original is
/// edited. Its identity stands in its name: a rig file with other contents is another setting,
/// which the launcher sees.
pub(crate) fn keep_copy(run_dir: &Path, asked: &Path, rig: &RigFile) -> Result<PathBuf, Error> {
    let stem = asked.file_stem().and_then(|stem| stem.to_str()).unwrap_or("rig");
    let path = run_dir.join(format!("{stem}.{:016x}.toml", rig.identity()));
    match files::replace(&path, rig.text()) {
        Ok(()) => Ok(path),
        Err(source) => Err(Error::Io { doing: "write", path, source }),
    }
}

/// What a rig that is up was started with.
///
/// # Errors
/// [`Error::NotUp`] where there is none.
pub fn running(name: &RigName) -> Result<launch::Config, Error> {
    let path = RunDir::new(name.run_directory()).launch_json();
    let text = match fs::read(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Err(Error::NotUp(name.to_string()));
        }
        Err(source) => return Err(Error::Io { doing: "read", path, source }),
    };
    serde_json::from_slice(&text)
        .map_err(|error| Error::Launched { path, reason: error.to_string() })
}

/// The rig file of a rig that is up.
///
/// # Errors
/// [`Error::NotUp`], or what is wrong with the file.
pub fn rig_of(name: &RigName) -> Result<RigFile, Error> {
    let environment: BTreeMap<String, String> = running(name)?.environment;
    match environment.get(RIG) {
        Some(path) => Ok(RigFile::load(path)?),
        None => Err(Error::Launched {
            path: RunDir::new(name.run_directory()).launch_json(),
            reason: format!("expected {RIG} among the variables"),
        }),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn a_copy_is_named_after_its_contents() {
        let directory = tempfile::tempdir().unwrap();
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let path = keep_copy(directory.path(), Path::new("/somewhere/bench.toml"), &rig).unwrap();
        assert!(path.file_name().unwrap().to_str().unwrap().starts_with("bench."));
        assert_eq!(RigFile::load(&path).unwrap().identity(), rig.identity());
        let text = rig.text().replace("10 m line", "11 m line");
        let other = RigFile::parse(&text, "bench.toml").unwrap();
        assert_ne!(keep_copy(directory.path(), Path::new("bench.toml"), &other).unwrap(), path);
    }
}
