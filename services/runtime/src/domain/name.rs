//! A rig's name, and the places on this machine that it stands for.

use std::fs;
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use rustix::process::geteuid;

use super::capacity::check_capacity;
use super::error::at;
use super::{ALIVE_LOCK, DomainError, KEEPER_LOCK, RUN};
use crate::locks::LockFile;
use crate::shared_memory::SHARED_MEMORY;
use crate::stale_cleanup;

/// The name of a rig: 1 to 32 lower-case letters, digits or '-', beginning with a letter.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct RigName(String);

impl FromStr for RigName {
    type Err = DomainError;

    fn from_str(name: &str) -> Result<Self, DomainError> {
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        if (1..=32).contains(&name.len())
            && name.starts_with(|c: char| c.is_ascii_lowercase())
            && name.chars().all(allowed)
        {
            Ok(Self(name.to_owned()))
        } else {
            Err(DomainError::Name(name.to_owned()))
        }
    }
}

impl RigName {
    /// As text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The rig's directory on tmpfs.
    pub fn directory(&self) -> PathBuf {
        self.directory_of(geteuid().as_raw())
    }

    /// The directory of another user's rig of that name.
    pub fn directory_of(&self, user: u32) -> PathBuf {
        Path::new(SHARED_MEMORY).join(format!("farreach-{user}-{}", self.0))
    }

    /// Where the launcher keeps its files (pid, status, logs).
    pub fn run_directory(&self) -> PathBuf {
        self.directory().join(RUN)
    }

    /// What the names of all of the rig's segments begin with. A '.' ends it: no rig name holds
    /// one.
    pub(crate) fn segment_prefix(&self) -> String {
        let user = geteuid().as_raw();
        format!("farreach-{user}-{}.", self.0)
    }

    /// Makes the rig's directory, or checks that an existing one is ours alone.
    pub fn make_directory(&self) -> Result<PathBuf, DomainError> {
        let path = self.directory();
        if !path.exists() {
            check_capacity()?;
        }
        match fs::DirBuilder::new().mode(0o700).create(&path) {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(at("making", &path)(error)),
        }
        let found = fs::symlink_metadata(&path).map_err(at("looking at", &path))?;
        let own = found.uid() == geteuid().as_raw();
        if !found.is_dir() || !own || found.permissions().mode() & 0o077 != 0 {
            let found = format!("mode {:o}, owner {}", found.permissions().mode(), found.uid());
            return Err(DomainError::NotOurs { path, found });
        }
        Ok(path)
    }

    /// The run directory, made where it is missing (mode 0700).
    pub fn make_run_directory(&self) -> Result<PathBuf, DomainError> {
        let path = self.run_directory();
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&path)
            .map_err(at("making", &path))?;
        Ok(path)
    }

    /// Removes everything of the rig if nothing of it is alive. Returns whether it did.
    pub fn remove(&self) -> Result<bool, DomainError> {
        let directory = self.directory();
        if !directory.exists() {
            return stale_cleanup::segments(&self.segment_prefix())
                .map(|()| true)
                .map_err(at("cleaning", &directory));
        }
        let keeper = LockFile::open(directory.join(KEEPER_LOCK))?;
        let alive = LockFile::open(directory.join(ALIVE_LOCK))?;
        let free = keeper.try_exclusive()? && alive.try_exclusive()?;
        if free {
            stale_cleanup::segments(&self.segment_prefix()).map_err(at("cleaning", &directory))?;
            self.remove_directory().map_err(at("removing", &directory))?;
        }
        Ok(free)
    }

    /// Removes the directory. It first gets another name: whoever looks for the rig meanwhile (an
    /// open probe) opens lock files by path, which would make a directory that is being emptied
    /// non-empty again.
    fn remove_directory(&self) -> io::Result<()> {
        let aside = Path::new(SHARED_MEMORY).join(self.segment_prefix() + "removed");
        // Of a process that was killed here.
        stale_cleanup::ignore_missing(fs::remove_dir_all(&aside))?;
        fs::rename(self.directory(), &aside)?;
        fs::remove_dir_all(&aside)
    }
}

impl std::fmt::Display for RigName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;
    use std::sync::atomic::Ordering::Relaxed;

    use super::*;

    #[test]
    fn names() {
        for good in ["demo", "a", "rig-2", "x234567890123456789012345678901"] {
            assert!(good.parse::<RigName>().is_ok(), "{good}");
        }
        for bad in
            ["", "2rig", "Demo", "a_b", "a.b", "../x", "x2345678901234567890123456789012345", "a b"]
        {
            assert!(matches!(bad.parse::<RigName>(), Err(DomainError::Name(_))), "{bad}");
        }
    }

    #[test]
    fn a_directory_is_removed_while_others_open_files_in_it() {
        let name: RigName = format!("removed-{}", std::process::id()).parse().unwrap();
        let alive = name.directory().join(ALIVE_LOCK);
        let ended = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !ended.load(Relaxed) {
                    let _opened = LockFile::open(alive.clone());
                }
            });
            let outcomes: Vec<_> = (0..300)
                .map(|_| {
                    name.make_directory()?;
                    name.remove_directory().map_err(at("removing", &name.directory()))
                })
                .collect();
            ended.store(true, Relaxed);
            for outcome in outcomes {
                outcome.unwrap();
            }
        });
        assert!(!name.directory().exists());
    }

    #[test]
    fn a_directory_that_others_can_read_is_refused() {
        let name: RigName = format!("open-{}", std::process::id()).parse().unwrap();
        fs::create_dir(name.directory()).unwrap();
        fs::set_permissions(name.directory(), fs::Permissions::from_mode(0o755)).unwrap();
        let error = name.make_directory().unwrap_err();
        fs::remove_dir(name.directory()).unwrap();
        assert!(matches!(error, DomainError::NotOurs { .. }), "{error}");
    }
}
