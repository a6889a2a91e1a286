//! The file that carries the zeros of the encoders over a restart of acquisition. A thread writes
//! it, since the loop never waits for a disk.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crossbeam_queue::ArrayQueue;
use files::{Format, FormatError};
use runtime::Worker;

use crate::homing::HomingState;

const FORMAT: Format = Format { what: "zeros of the encoders", mark: *b"FRHZ", version: 1 };
/// Name of the file in the rig's run directory.
const FILE: &str = "acquisition.homing";
/// How often the thread looks for a new state.
const PERIOD: Duration = Duration::from_millis(2);

/// The file, and the thread that writes it.
#[derive(Debug)]
pub(crate) struct HomingFile {
    newest: Arc<ArrayQueue<HomingState>>,
    failed: Arc<AtomicBool>,
    _thread: Worker,
}

/// Reads the state that an earlier process kept; `None` where there is none.
///
/// # Errors
/// Why it cannot be used, and what to do. The file is then moved aside, so that this is told once.
pub(crate) fn read(directory: &Path) -> Result<Option<HomingState>, String> {
    let path = directory.join(FILE);
    let bytes = match fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(format!("the zeros of the encoders cannot be read: {error}")),
    };
    HomingState::decode(&bytes).map(Some).map_err(|error| {
        // Where even that fails, the next start tells it again.
        let _ = fs::rename(&path, path.with_extension("damaged"));
        format!("{error}; run `initialise`")
    })
}

impl HomingState {
    /// The bytes of the file.
    ///
    /// # Errors
    /// [`FormatError::Coding`] if the encoder fails.
    pub fn encode(&self) -> Result<Vec<u8>, FormatError> {
        FORMAT.encode(self)
    }

    /// The state in the bytes of a file.
    ///
    /// # Errors
    /// Each [`FormatError`]: a damaged file never yields a state, nor does one of another version.
    pub fn decode(bytes: &[u8]) -> Result<Self, FormatError> {
        FORMAT.decode(bytes)
    }
}

impl HomingFile {
    /// Starts the thread.
    ///
    /// # Errors
    /// The operating system's, where it grants no thread.
    pub(crate) fn open(directory: PathBuf, fifo: bool) -> io::Result<Self> {
        let newest = Arc::new(ArrayQueue::new(1));
        let failed = Arc::new(AtomicBool::new(false));
        let (queue, flag) = (Arc::clone(&newest), Arc::clone(&failed));
        let path = directory.join(FILE);
        let thread = Worker::spawn("homing-file", move |ending| {
            runtime::realtime::request_helper(fifo);
            loop {
                // Looked at before the queue, so that nothing is left in it at the end.
                let ends = ending.load(Ordering::Relaxed);
                while let Some(state) = queue.pop() {
                    if let Err(error) = write(&path, &state) {
                        eprintln!("farreach acquisition: {}: {error}", path.display());
                        flag.store(true, Ordering::Relaxed);
                    }
                }
                if ends {
                    return;
                }
                std::thread::sleep(PERIOD);
            }
        })?;
        Ok(Self { newest, failed, _thread: thread })
    }

    /// Hands the newest state to the thread; one that is still waiting is replaced. Waits for
    /// nothing.
    pub(crate) fn keep(&self, state: HomingState) {
        let _replaced = self.newest.force_push(state);
    }

    /// Whether a write has failed since the last call.
    pub(crate) fn take_failure(&self) -> bool {
        self.failed.swap(false, Ordering::Relaxed)
    }
}

fn write(path: &Path, state: &HomingState) -> Result<(), String> {
    let bytes = state.encode().map_err(|error| error.to_string())?;
    files::replace(path, bytes).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use ipc_types::Zeros;

    use super::*;

    #[test]
    fn the_newest_state_is_read_back_and_a_damaged_one_is_refused_once() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(read(folder.path()), Ok(None));
        let state = |sequence| HomingState {
            session: 7,
            power_up: 8,
            zeros: Zeros { master: [-4, 5, 6], homed: 1, sequence, ..Zeros::default() },
        };
        let file = HomingFile::open(folder.path().to_owned(), false).unwrap();
        for sequence in 1..=50 {
            file.keep(state(sequence));
        }
        drop(file);
        assert_eq!(read(folder.path()), Ok(Some(state(50))));
        let path = folder.path().join(FILE);
        let mut bytes = fs::read(&path).unwrap();
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        fs::write(&path, bytes).unwrap();
        assert!(read(folder.path()).unwrap_err().contains("checksum"));
        assert_eq!(read(folder.path()), Ok(None));
    }
}
