//! Files that are in memory only, for parsers that open a path.

use std::fs::File;
use std::io::Write as _;
use std::os::fd::AsRawFd as _;
use std::path::{Path, PathBuf};

use rustix::fs::{MemfdFlags, memfd_create};

/// A file in memory; it goes with this value.
#[derive(Debug)]
pub struct MemoryFile {
    path: PathBuf,
    _file: File,
}

impl MemoryFile {
    /// With these contents.
    pub fn new(bytes: &[u8]) -> Self {
        let made = memfd_create("fuzz", MemfdFlags::CLOEXEC).expect("a file in memory");
        let mut file = File::from(made);
        file.write_all(bytes).expect("room in memory");
        Self { path: format!("/proc/self/fd/{}", file.as_raw_fd()).into(), _file: file }
    }

    /// Where it is opened.
    pub fn path(&self) -> &Path {
        &self.path
    }
}
