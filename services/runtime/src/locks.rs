//! Locks on small files: the kernel releases them when a process dies, however it dies.

use std::fs::{File, OpenOptions, TryLockError};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;

use crate::domain::{DomainError, at};

/// An open lock file. Closing it releases the lock; a second lock replaces the first (`flock`).
#[derive(Debug)]
pub(crate) struct LockFile {
    file: File,
    path: PathBuf,
}

impl LockFile {
    /// Opens, or creates, a lock file (mode 0600).
    pub(crate) fn open(path: PathBuf) -> Result<Self, DomainError> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false).mode(0o600);
        let file = options.open(&path).map_err(at("opening", &path))?;
        Ok(Self { file, path })
    }

    /// Tries to be the only holder.
    pub(crate) fn try_exclusive(&self) -> Result<bool, DomainError> {
        self.held(self.file.try_lock())
    }

    /// Tries to be one of several holders.
    pub(crate) fn try_shared(&self) -> Result<bool, DomainError> {
        self.held(self.file.try_lock_shared())
    }

    fn held(&self, attempt: Result<(), TryLockError>) -> Result<bool, DomainError> {
        match attempt {
            Ok(()) => Ok(true),
            Err(TryLockError::WouldBlock) => Ok(false),
            Err(TryLockError::Error(error)) => Err(at("locking", &self.path)(error)),
        }
    }
}
