//! The rig's run directory: its files, and the lock that the launcher holds.

use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::status::Status;
use crate::{Config, Error, boot_id};

/// Paths within the rig's directory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunDir(PathBuf);

impl RunDir {
    /// Names the directory; it need not exist.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self(path.into())
    }

    /// The directory itself.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Locked by the launcher as long as it lives: if it can be locked, there is no launcher.
    pub fn lock_file(&self) -> PathBuf {
        self.0.join("launcher.lock")
    }

    /// Pid and start time of the launcher, separated by a space.
    pub fn launcher_pid(&self) -> PathBuf {
        self.0.join("launcher.pid")
    }

    /// The launcher's own log.
    pub fn launcher_log(&self) -> PathBuf {
        self.0.join("launcher.log")
    }

    /// The [`Config`] of the launch.
    pub fn launch_json(&self) -> PathBuf {
        self.0.join("launch.json")
    }

    /// The [`Status`], replaced atomically.
    pub fn status_json(&self) -> PathBuf {
        self.0.join("status.json")
    }

    /// Why the launcher ended before the rig was up; read and removed by `start`.
    pub fn failure_json(&self) -> PathBuf {
        self.0.join("failure.json")
    }

    /// `NOTIFY_SOCKET` of every process.
    pub fn notify_socket(&self) -> PathBuf {
        self.0.join("notify.sock")
    }

    /// Socket for `stop`, `restart` and `status`.
    pub fn control_socket(&self) -> PathBuf {
        self.0.join("control.sock")
    }

    /// Log of one unit.
    pub fn log(&self, unit: &str) -> PathBuf {
        self.0.join(format!("{unit}.log"))
    }

    /// Creates the directory with mode 0700, or checks that it is private to this user.
    pub(crate) fn create(&self) -> Result<(), Error> {
        for socket in [self.notify_socket(), self.control_socket()] {
            let length = socket.as_os_str().len();
            if length > 107 {
                return Err(Error::PathTooLong { path: socket, length });
            }
        }
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&self.0)
            .map_err(|source| Error::io("make the run directory", &self.0, source))?;
        let metadata = fs::metadata(&self.0)
            .map_err(|source| Error::io("read the mode of", &self.0, source))?;
        let wrong = |found| Error::RunDirectory { path: self.0.clone(), found };
        let own = rustix::process::geteuid().as_raw();
        if metadata.uid() != own {
            return Err(wrong(format!("owned by uid {}, and this is uid {own}", metadata.uid())));
        }
        if metadata.mode() & 0o077 != 0 {
            return Err(wrong(format!("its mode is {:04o}", metadata.mode() & 0o7777)));
        }
        Ok(())
    }

    /// Takes the launcher's lock; `None` if a launcher holds it.
    pub(crate) fn lock(&self) -> Result<Option<File>, Error> {
        let path = self.lock_file();
        // `is_held` locks it for a moment: only a lasting lock is a launcher's.
        let mut tries_left = 10;
        loop {
            let file = OpenOptions::new()
                .create(true)
                .truncate(false)
                .write(true)
                .mode(0o600)
                .open(&path)
                .map_err(|source| Error::io("open", &path, source))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) if tries_left > 0 => {
                    tries_left -= 1;
                    std::thread::sleep(std::time::Duration::from_millis(10));
                    continue;
                }
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(source)) => return Err(Error::io("lock", &path, source)),
            }
            // A launcher removes the file at its end while it holds the lock: the locked file may
            // no longer be the one in the directory.
            if self.is_lock_file(&file)? {
                return Ok(Some(file));
            }
        }
    }

    /// Takes over the lock that `start` holds and passes on as standard input, so that no other
    /// launcher can take it in between.
    pub(crate) fn inherited_lock(&self) -> Result<Option<OwnedFd>, Error> {
        let stdin = io::stdin();
        let handle = stdin
            .as_fd()
            .try_clone_to_owned()
            .map_err(|source| Error::system("read standard input", source))?;
        let file = File::from(handle);
        if !self.is_lock_file(&file)? {
            return Ok(None);
        }
        Ok(file.try_lock().is_ok().then(|| file.into()))
    }

    fn is_lock_file(&self, file: &File) -> Result<bool, Error> {
        let path = self.lock_file();
        let held = file.metadata().map_err(|source| Error::io("read", &path, source))?;
        match fs::metadata(&path) {
            Ok(there) => Ok((held.dev(), held.ino()) == (there.dev(), there.ino())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(source) => Err(Error::io("read", &path, source)),
        }
    }

    /// Whether a launcher holds this directory.
    ///
    /// # Errors
    /// If the lock file can be neither opened nor locked.
    pub fn is_held(&self) -> Result<bool, Error> {
        let path = self.lock_file();
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
            Err(source) => return Err(Error::io("open", &path, source)),
        };
        // Shared, so that two callers do not take each other for a launcher.
        match file.try_lock_shared() {
            Ok(()) => Ok(false),
            Err(TryLockError::WouldBlock) => Ok(true),
            Err(TryLockError::Error(source)) => Err(Error::io("lock", &path, source)),
        }
    }

    /// Replaces a file atomically.
    pub(crate) fn write_json<T: Serialize>(&self, path: &Path, value: &T) -> Result<(), Error> {
        let text = serde_json::to_vec_pretty(value).map_err(|error| Error::File {
            path: path.to_path_buf(),
            message: error.to_string(),
        })?;
        self.write(path, &text)
    }

    pub(crate) fn write(&self, path: &Path, text: &[u8]) -> Result<(), Error> {
        files::replace(path, text).map_err(|source| Error::io("write", path, source))
    }

    /// Reads a JSON file; `None` if it does not exist.
    pub(crate) fn read_json<T: DeserializeOwned>(&self, path: &Path) -> Result<Option<T>, Error> {
        match fs::read(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(Error::io("read", path, source)),
            Ok(text) => serde_json::from_slice(&text).map(Some).map_err(|error| Error::File {
                path: path.to_path_buf(),
                message: error.to_string(),
            }),
        }
    }

    pub(crate) fn config(&self) -> Result<Option<Config>, Error> {
        self.read_json(&self.launch_json())
    }

    /// The last status written in this boot of the computer; its processes may have died since.
    pub(crate) fn last_status(&self) -> Result<Option<Status>, Error> {
        let status: Option<Status> = self.read_json(&self.status_json())?;
        Ok(status.filter(|status| status.boot_id == boot_id()))
    }

    /// The error that a launcher holds this directory.
    pub(crate) fn already_up(&self, rig: &str) -> Error {
        let status = self.last_status().ok().flatten();
        let pid = fs::read_to_string(self.launcher_pid()).unwrap_or_default();
        Error::AlreadyUp {
            rig: status.as_ref().map_or_else(|| rig.to_owned(), |status| status.rig_name.clone()),
            launcher: format!("pid {}", pid.split_whitespace().next().unwrap_or("not yet known")),
            since: status.map_or_else(
                || "just starting".to_owned(),
                |status| format!("since {}", crate::status::utc(status.since_unix_ms)),
            ),
        }
    }

    /// Removes all but the logs (and `failure.json`, which `start` reads). Call with the lock held.
    pub(crate) fn clean(&self) {
        let files = [
            self.notify_socket(),
            self.control_socket(),
            self.status_json(),
            self.launch_json(),
            self.launcher_pid(),
            self.lock_file(),
        ];
        for file in files {
            // A file that cannot be removed is recognised as stale by the next start.
            let _ = fs::remove_file(file);
        }
    }
}
