//! What is being recorded, on disk, so that a logger that was killed goes on after its restart, in
//! the next part.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// Name of the file within the state directory.
pub const FILE: &str = "recording.json";

/// The recording that runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct State {
    /// Session of the rig that it belongs to; another session does not go on with it.
    pub session: u64,
    /// The path that was asked for: that of part 1.
    pub path: PathBuf,
    /// The newest part.
    pub part: u32,
    /// What the recording says about itself.
    pub metadata: BTreeMap<String, String>,
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC` of part 1, kept for all parts (ns).
    pub realtime_offset_ns: i64,
}

/// Why the state cannot be used or kept.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The file cannot be read or written.
    #[error("{}: {source}; a recording would not go on after a restart of the logger", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file makes no sense. It was moved aside.
    #[error("{}: expected the logger's state, found something else ({what}); moved it to {}: start the recording again", path.display(), aside.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// Where it is now.
        aside: PathBuf,
    },
}

/// Keeps the state in `directory`, whole or not at all.
///
/// # Errors
/// [`StateError::Io`].
pub fn save(directory: &Path, state: &State) -> Result<(), StateError> {
    let path = directory.join(FILE);
    let fresh = directory.join("recording.json.new");
    let write = || -> io::Result<()> {
        let mut file = File::create(&fresh)?;
        file.write_all(&serde_json::to_vec_pretty(state)?)?;
        file.sync_all()?;
        fs::rename(&fresh, &path)
    };
    write().map_err(|source| StateError::Io { path: path.clone(), source })
}

/// Forgets it: the recording was ended.
///
/// # Errors
/// [`StateError::Io`]; that there was none is no error.
pub fn clear(directory: &Path) -> Result<(), StateError> {
    let path = directory.join(FILE);
    match fs::remove_file(&path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(StateError::Io { path, source })
        }
        _ => Ok(()),
    }
}

/// The recording that ran when the logger died, if it belongs to this session.
///
/// # Errors
/// [`StateError::Io`]; [`StateError::Damaged`], after which the file is out of the way.
pub fn load(directory: &Path, session: u64) -> Result<Option<State>, StateError> {
    let path = directory.join(FILE);
    let bytes = match fs::read(&path) {
        Ok(bytes) => bytes,
        Err(source) if source.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(StateError::Io { path, source }),
    };
    match serde_json::from_slice::<State>(&bytes) {
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

/// The file of a part: `run.mcap`, `run.part2.mcap`, ...
pub fn part_path(path: &Path, part: u32) -> PathBuf {
    if part <= 1 {
        return path.to_owned();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = match path.extension() {
        Some(extension) => format!("{stem}.part{part}.{}", extension.to_string_lossy()),
        None => format!("{stem}.part{part}"),
    };
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> State {
        State {
            session: 7,
            path: "/data/run.mcap".into(),
            part: 2,
            metadata: BTreeMap::from([("rig".to_owned(), "hydrostatic \"x\"\n".to_owned())]),
            realtime_offset_ns: -5,
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
    fn a_damaged_state_is_named_once_and_then_out_of_the_way() {
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
    fn parts_are_numbered_before_the_extension() {
        assert_eq!(part_path(Path::new("/d/run.mcap"), 1), Path::new("/d/run.mcap"));
        assert_eq!(part_path(Path::new("/d/run.mcap"), 3), Path::new("/d/run.part3.mcap"));
        assert_eq!(part_path(Path::new("run"), 2), Path::new("run.part2"));
    }
}
