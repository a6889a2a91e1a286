//! Why a domain cannot be had, and what to do about it.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use thiserror::Error;

use crate::shared_memory::{MEBIBYTE, SHARED_MEMORY};

/// Why a domain could not be founded or joined.
#[derive(Debug, Error)]
pub enum DomainError {
    /// The name breaks the rules.
    #[error(
        "rig name {0:?}: expected 1 to 32 lower-case letters, digits or '-', beginning with a \
         letter"
    )]
    Name(String),
    /// A file operation failed.
    #[error("{action} {path}: {source}{}", hint(.source))]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which path.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The directory is not ours alone.
    #[error(
        "{path} is not a directory of this user with mode 0700 ({found}); remove it or choose \
         another rig name"
    )]
    NotOurs {
        /// The directory.
        path: PathBuf,
        /// What was found instead.
        found: String,
    },
    /// A keeper of that rig runs.
    #[error("rig {0} has a keeper already; is it up? (`farreach status`, `farreach down`)")]
    AlreadyKept(String),
    /// No keeper.
    #[error("rig {0} has no keeper: start it first (`farreach up`, or `farreach service keeper`)")]
    NoKeeper(String),
    /// The keeper did not get ready in time.
    #[error("the keeper of rig {0} did not get ready within {1:?}")]
    KeeperNotReady(String, Duration),
    /// Processes live on in a domain whose founding never ended.
    #[error(
        "rig {0}: processes of a broken start are still alive; stop them (`farreach down`) and \
         start again"
    )]
    BrokenStart(String),
    /// The file with the session cannot be read.
    #[error("{path}: {reason}; stop the rig (`farreach down`) and start it again")]
    Session {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// This process already belongs to another rig.
    #[error("this process already belongs to the domain {found}, not to {wanted}")]
    OtherRig {
        /// The domain it belongs to.
        found: String,
        /// The one that was asked for.
        wanted: String,
    },
    /// Too little is free. A page that cannot be had later on kills the process that touches it
    /// (SIGBUS).
    #[error(
        "shared memory is full: a rig needs {} MiB in {SHARED_MEMORY}, found {} MiB free; remove \
         what is not needed there (`ls -l {SHARED_MEMORY}`) or make it larger (containers: \
         --shm-size)",
        needed.div_ceil(MEBIBYTE),
        found / MEBIBYTE
    )]
    NoRoom {
        /// What a rig needs (bytes).
        needed: u64,
        /// What is free (bytes).
        found: u64,
    },
    /// iceoryx2 refused.
    #[error("shared memory: {action}: {reason}")]
    Library {
        /// What was tried.
        action: String,
        /// What the library said.
        reason: String,
    },
}

fn hint(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull => {
            "; shared memory is full: free space in /dev/shm (`df -h /dev/shm`)"
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "; is /dev/shm writable for this user?"
        }
        _ => "",
    }
}

pub(crate) fn at(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DomainError {
    move |source| DomainError::Io { action, path: path.to_path_buf(), source }
}

pub(super) fn library(action: impl Into<String>) -> impl FnOnce(String) -> DomainError {
    let action = action.into();
    move |reason| DomainError::Library { action, reason }
}
