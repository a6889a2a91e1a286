//! `flock` on small files: the kernel lets go of them when a process dies, however it dies.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

/// An open lock file. Closing it releases the lock.
#[derive(Debug)]
pub(crate) struct LockFile(File);

impl LockFile {
    /// Opens, or creates, a lock file (mode 0600).
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(path)
            .map(Self)
    }

    fn attempt(&self, operation: FlockOperation) -> io::Result<bool> {
        match flock(&self.0, operation) {
            Ok(()) => Ok(true),
            Err(Errno::WOULDBLOCK) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Tries to be the only holder.
    pub(crate) fn try_exclusive(&self) -> io::Result<bool> {
        self.attempt(FlockOperation::NonBlockingLockExclusive)
    }

    /// Tries to be one of several holders.
    pub(crate) fn try_shared(&self) -> io::Result<bool> {
        self.attempt(FlockOperation::NonBlockingLockShared)
    }
}
