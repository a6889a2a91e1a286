//! Locks on small files: the kernel releases them when a process dies, however it dies.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// An open lock file. Closing it releases the lock; a second lock replaces the first (`flock`).
#[derive(Debug)]
pub(crate) struct LockFile(File);

impl LockFile {
    /// Opens, or creates, a lock file (mode 0600).
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false).mode(0o600);
        options.open(path).map(Self)
    }

    /// Tries to be the only holder.
    pub(crate) fn try_exclusive(&self) -> io::Result<bool> {
        held(self.0.try_lock())
    }

    /// Tries to be one of several holders.
    pub(crate) fn try_shared(&self) -> io::Result<bool> {
        held(self.0.try_lock_shared())
    }
}

fn held(attempt: Result<(), TryLockError>) -> io::Result<bool> {
    match attempt {
        Ok(()) => Ok(true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(error)) => Err(error),
    }
}
