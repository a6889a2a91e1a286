//! The protocol that the console plays, kept on disk: a console that was killed goes on with it.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// A protocol that is being played.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct RunState {
    /// Number of the client that it belongs to.
    pub(crate) client: u64,
    /// Whether the key 5 is a pulse of the scanner.
    pub(crate) takes_keys: bool,
    /// Text of the protocol.
    pub(crate) protocol: String,
    /// Code of the subject; may be empty.
    pub(crate) subject: String,
    /// Sessions that were over before it was continued; 0 for one that began anew.
    pub(crate) over_before: u32,
    /// The sessions' files, where there are to be some.
    pub(crate) files: Option<Files>,
    /// Set once it has ended: whether it ran to its end. What remains are the files.
    pub(crate) completed: Option<bool>,
}

impl RunState {
    /// The state in the text of a file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(crate) fn of(text: &[u8]) -> serde_json::Result<Self> {
        serde_json::from_slice(text)
    }
}

/// Files of the sessions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Files {
    /// Their name.
    pub(crate) name: PathBuf,
    /// The recording that they are made from.
    pub(crate) recording: PathBuf,
    /// Only sessions that began since then are the protocol's (ns, CLOCK_MONOTONIC).
    pub(crate) since_ns: u64,
}

/// The file of the state, in the run directory.
#[derive(Clone, Debug)]
pub(crate) struct RunStateFile(PathBuf);

impl RunStateFile {
    pub(crate) fn new(run_directory: &Path) -> Self {
        Self(run_directory.join("console.run.json"))
    }

    /// Writes the state, whole or not at all.
    ///
    /// # Errors
    /// The system's, with the file.
    pub(crate) fn save(&self, state: &RunState) -> anyhow::Result<()> {
        let text = serde_json::to_vec(state)?;
        files::replace(&self.0, text)
            .map_err(|error| anyhow::anyhow!("cannot write {}: {error}", self.0.display()))
    }

    /// The protocol that was being played when the console ended; `None` where there was none.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn load(&self) -> anyhow::Result<Option<RunState>> {
        match fs::read(&self.0) {
            Ok(text) => RunState::of(&text)
                .map(Some)
                .map_err(|error| anyhow::anyhow!("{}: {error}", self.0.display())),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(anyhow::anyhow!("cannot read {}: {error}", self.0.display())),
        }
    }

    /// The protocol has ended.
    pub(crate) fn remove(&self) {
        // Where it stays, the next console asks for a protocol that has ended, and is told so.
        let _removed = fs::remove_file(&self.0);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn a_state_is_read_back_and_a_damaged_one_is_an_error() {
        let directory = tempfile::tempdir().unwrap();
        let file = RunStateFile::new(directory.path());
        assert_eq!(file.load().unwrap(), None);
        let state = RunState {
            client: u64::MAX,
            takes_keys: true,
            protocol: "[protocol]\nname = \"Übung\"\n".to_owned(),
            subject: "S07".to_owned(),
            over_before: 1,
            files: Some(Files {
                name: "/data/S07_".into(),
                recording: "/data/run.mcap".into(),
                since_ns: 1 << 60,
            }),
            completed: Some(false),
        };
        file.save(&state).unwrap();
        assert_eq!(file.load().unwrap(), Some(state));
        fs::write(directory.path().join("console.run.json"), "{\"client\": 1").unwrap();
        assert!(file.load().unwrap_err().to_string().contains("console.run.json"));
        file.remove();
        assert_eq!(file.load().unwrap(), None);
    }
}
