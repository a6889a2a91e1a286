//! What to record, and the state file that holds it while it is being recorded, so that a logger
//! that was killed continues after its restart with the next part.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use ipc_types::Split;
use recording::mcap_write::Positions;
use serde::{Deserialize, Serialize};

/// Name of the file within the state directory.
pub const FILE: &str = "recording.json";

/// What to record.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StartRequest {
    /// Session of the rig that it belongs to; another session does not continue it.
    pub session: u64,
    /// The file of part 1, also for later parts.
    pub path: PathBuf,
    /// 1, or higher when continuing after a restart; the next free number is taken.
    pub part: u32,
    /// Metadata of the recording, see [`recording::mcap_write::key`].
    pub metadata: BTreeMap<String, String>,
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC` of part 1, kept for all parts (ns).
    pub realtime_offset_ns: i64,
    /// When part 1 began [ns, CLOCK_MONOTONIC]; 0 for a recording that begins now.
    #[serde(default)]
    pub began_ns: u64,
    /// The protocol that is being played; empty where none is.
    #[serde(default)]
    pub run: BTreeMap<String, String>,
    /// When to go on in the next part.
    #[serde(default)]
    pub split: Split,
    /// Of a ring: the number of each part that has ended and is there, and when it ended [ns,
    /// CLOCK_MONOTONIC]; 0 where that is not known.
    #[serde(default)]
    pub ring_parts: Vec<(u32, u64)>,
    /// The number of a part whose file was created while the one before it was still being ended;
    /// 0 at other times.
    #[serde(default)]
    pub created: u32,
    /// Where the part before ended; empty for part 1. The messages between are counted as lost.
    #[serde(skip)]
    pub continues: Positions,
}

impl StartRequest {
    /// The next part of a recording that was cut off when the logger died. `continues` is where the
    /// part before ended.
    #[must_use]
    pub fn next_part(self, continues: Positions) -> Self {
        let mut ring_parts = self.ring_parts;
        if self.split.keep_ns.is_some() {
            ring_parts.push((self.part, 0));
            ring_parts.extend(Some((self.created, 0)).filter(|(created, _)| *created > 0));
        }
        let part = self.part.max(self.created).saturating_add(1);
        Self { part, created: 0, continues, ring_parts, ..self }
    }
}

/// Why the state cannot be used or saved.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The file cannot be read or written.
    #[error("{path}: {source}; a recording would not continue after a restart of the logger")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file cannot be parsed. It was moved aside.
    #[error(
        "{path}: not a state file of the logger ({what}); moved to {aside}: start the recording \
         again"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// Where it is now.
        aside: PathBuf,
    },
}

/// Saves the state in `directory`, whole or not at all.
///
/// # Errors
/// [`StateError::Io`].
pub fn save(directory: &Path, state: &StartRequest) -> Result<(), StateError> {
    let path = directory.join(FILE);
    serde_json::to_vec_pretty(state)
        .map_err(io::Error::from)
        .and_then(|text| files::replace(&path, text))
        .map_err(|source| StateError::Io { path, source })
}

/// Removes the state: the recording was ended.
///
/// # Errors
/// [`StateError::Io`]; a missing file is no error.
pub fn clear(directory: &Path) -> Result<(), StateError> {
    let path = directory.join(FILE);
    match fs::remove_file(&path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(StateError::Io { path, source })
        }
        _ => Ok(()),
    }
}

/// The recording that was in progress when the logger died, if it belongs to this session.
///
/// # Errors
/// [`StateError::Io`]; [`StateError::Damaged`], after which the file is moved aside.
pub fn load(directory: &Path, session: u64) -> Result<Option<StartRequest>, StateError> {
    let path = directory.join(FILE);
    let bytes = match fs::read(&path) {
        Ok(bytes) => bytes,
        Err(source) if source.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(StateError::Io { path, source }),
    };
    match serde_json::from_slice::<StartRequest>(&bytes) {
        Ok(state) if state.session == session => Ok(Some(state)),
        Ok(_) => Ok(None),
        Err(error) => {
            let aside = directory.join("recording.json.damaged");
            fs::rename(&path, &aside)
                .map_err(|source| StateError::Io { path: path.clone(), source })?;
            Err(StateError::Damaged { path, what: error.to_string(), aside })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> StartRequest {
        StartRequest {
            session: 7,
            path: "/data/run.mcap".into(),
            part: 2,
            metadata: BTreeMap::from([("rig".to_owned(), "hydrostatic \"x\"\n".to_owned())]),
            realtime_offset_ns: -5,
            began_ns: 3,
            split: Split { every_bytes: Some(9), ..Split::default() },
            ..StartRequest::default()
        }
    }

    #[test]
    fn the_state_survives_and_is_bound_to_its_session() {
        let directory = tempfile::tempdir().unwrap();
        assert_eq!(load(directory.path(), 7).unwrap(), None);
        save(directory.path(), &state()).unwrap();
        assert_eq!(load(directory.path(), 7).unwrap(), Some(state()));
        assert_eq!(load(directory.path(), 8).unwrap(), None);
        clear(directory.path()).unwrap();
        clear(directory.path()).unwrap();
        assert_eq!(load(directory.path(), 7).unwrap(), None);
    }

    #[test]
    fn a_damaged_state_is_reported_once_and_moved_aside() {
        let directory = tempfile::tempdir().unwrap();
        save(directory.path(), &state()).unwrap();
        let path = directory.path().join(FILE);
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        let error = load(directory.path(), 7).unwrap_err();
        assert!(matches!(error, StateError::Damaged { .. }), "{error}");
        assert!(error.to_string().contains("recording.json.damaged"));
        assert_eq!(load(directory.path(), 7).unwrap(), None);
    }

    #[test]
    fn a_ring_of_a_build_that_kept_no_times_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let ring = StartRequest { ring_parts: vec![(1, 5), (2, 0)], ..state() };
        save(directory.path(), &ring).unwrap();
        assert_eq!(load(directory.path(), 7).unwrap(), Some(ring));
        let text = r#"{"session": 7, "path": "/data/ring.mcap", "part": 3, "metadata": {},
            "realtime_offset_ns": 0, "ring_parts": [1, 2]}"#;
        fs::write(directory.path().join(FILE), text).unwrap();
        let error = load(directory.path(), 7).unwrap_err();
        assert!(matches!(error, StateError::Damaged { .. }), "{error}");
        assert!(error.to_string().contains("start the recording again"), "{error}");
    }
}
