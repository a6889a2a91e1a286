//! Bounded log files.
//!
//! A process writes its log file itself, through a descriptor opened for appending: a pipe to the
//! launcher would kill it when the launcher dies. A log that is too long is therefore copied and
//! truncated in place; lines written between the two are lost.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use crate::Error;

/// Longest log (bytes); the part before is kept as `NAME.log.1`.
pub(crate) const LIMIT: u64 = 1 << 20;

/// Opens a log for appending.
pub(crate) fn open(path: &Path) -> Result<File, Error> {
    OpenOptions::new()
        .create(true)
        .append(true)
        .mode(0o600)
        .open(path)
        .map_err(|source| Error::io("open the log", path, source))
}

/// Copies a log longer than `limit` to `NAME.log.1` and truncates it.
pub(crate) fn rotate(path: &Path, limit: u64) -> io::Result<bool> {
    if fs::metadata(path).map(|metadata| metadata.len()).unwrap_or(0) <= limit {
        return Ok(false);
    }
    fs::copy(path, earlier(path))?;
    OpenOptions::new().write(true).open(path)?.set_len(0)?;
    Ok(true)
}

fn earlier(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".1");
    PathBuf::from(name)
}

/// The last lines of a log, at most `lines` and 8 KiB; empty if there is none.
pub(crate) fn tail(path: &Path, lines: usize) -> String {
    let read = || -> io::Result<Vec<u8>> {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(8192)))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    let text = String::from_utf8_lossy(&read().unwrap_or_default()).into_owned();
    let all: Vec<&str> = text.trim_end().lines().collect();
    all[all.len().saturating_sub(lines)..].join("\n")
}

/// The launcher's own log: lines with the time, to `launcher.log` and optionally standard error.
pub(crate) struct Journal {
    path: PathBuf,
    file: Option<File>,
    echo: bool,
}

impl Journal {
    pub(crate) fn new(path: PathBuf, echo: bool) -> Result<Self, Error> {
        let file = Some(open(&path)?);
        Ok(Self { path, file, echo })
    }

    pub(crate) fn say(&mut self, message: &str) {
        let line = format!("{} {message}\n", crate::status::utc(crate::status::unix_ms()));
        if self.echo {
            // A closed terminal must not stop the launcher.
            let _ = io::stderr().write_all(line.as_bytes());
        }
        if let Some(file) = &mut self.file
            && file.write_all(line.as_bytes()).is_err()
        {
            // Most likely the disk is full: the rig continues without this log.
            self.file = None;
        }
        let _ = rotate(&self.path, LIMIT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_log_is_cut_and_its_writer_goes_on() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.log");
        let mut writer = open(&path).unwrap();
        writer.write_all(b"first\nsecond\n").unwrap();
        assert!(!rotate(&path, 13).unwrap());
        assert!(rotate(&path, 12).unwrap());
        writer.write_all(b"third\n").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "third\n");
        assert_eq!(fs::read_to_string(earlier(&path)).unwrap(), "first\nsecond\n");
    }

    #[test]
    fn tails() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.log");
        assert_eq!(tail(&path, 3), "");
        fs::write(&path, "1\n2\n3\n4\n").unwrap();
        assert_eq!(tail(&path, 2), "3\n4");
        assert_eq!(tail(&path, 9), "1\n2\n3\n4");
    }
}
