//! A recording with all of its parts, read as one.

use std::collections::BTreeMap;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use recording::mcap_edit::{check_related, rewrite};
use recording::mcap_read::{ReadError, Recording};
use recording::parts_of;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tempfile::TempDir;

/// A recording; where it has several parts, a copy of them in one file, which goes with it.
pub(crate) struct AllParts {
    recording: Recording,
    _copy: Option<TempDir>,
}

impl AllParts {
    /// Opens a recording, which any of its parts may name.
    ///
    /// # Errors
    /// Where a part cannot be read, or the copy not be written.
    pub(crate) fn open(file: &Path) -> anyhow::Result<Self> {
        let parts = parts_of(file);
        let [_, _, ..] = parts.as_slice() else {
            return Ok(Self { recording: Recording::open(file)?, _copy: None });
        };
        let recordings = open_all(&parts)?;
        let sources: Vec<&Recording> = recordings.iter().collect();
        // A file that only bears such a name is no part.
        if check_related(&sources).is_err() {
            return Ok(Self { recording: Recording::open(file)?, _copy: None });
        }
        let copy = TempDir::with_prefix("farreach-parts-")?;
        let path = copy.path().join("all.mcap");
        rewrite(&sources, None, None, &BTreeMap::new(), &path)?;
        Ok(Self { recording: Recording::open(&path)?, _copy: Some(copy) })
    }
}

impl Deref for AllParts {
    type Target = Recording;

    fn deref(&self) -> &Recording {
        &self.recording
    }
}

/// Opens recordings, however many, each of which keeps its file open.
///
/// # Errors
/// Where one cannot be read.
pub(crate) fn open_all(files: &[PathBuf]) -> Result<Vec<Recording>, ReadError> {
    let limit = getrlimit(Resource::Nofile);
    // Where it is refused, or is not enough, opening tells which file is one too many.
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit });
    files.iter().map(|file| Recording::open(file)).collect()
}
