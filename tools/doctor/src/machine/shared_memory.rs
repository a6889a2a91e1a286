//! Shared memory: whether what a rig needs can be written there, and what is left then.

use std::io;
use std::path::Path;
use std::time::Instant;

use runtime::{SHARED_MEMORY, Verdict, shared_memory_room};
use rustix::fs::statfs;
use serde::Serialize;

use crate::bench::Bench;
use crate::outcome::Outcome;

/// Magic number of tmpfs (`TMPFS_MAGIC`, linux/magic.h).
const TMPFS: u64 = 0x0102_1994;
/// A rig beside this one, or a logger that is restarted, needs as much again.
const ROOM_FOR: u64 = 2;

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct SharedMemory {
    /// What a rig needs (bytes).
    needed_bytes: u64,
    /// What was free before (bytes).
    free_bytes: u64,
    /// Whether it lies in memory (tmpfs).
    in_memory: bool,
    /// Why the needed bytes could not be written; empty where they were.
    refused: String,
    /// How long that took (ms).
    took_ms: f64,
}

pub(crate) fn examine(_bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let (needed_bytes, free_bytes) = shared_memory_room()?;
    let in_memory = statfs(SHARED_MEMORY).is_ok_and(|found| found.f_type as u64 == TMPFS);
    let begun = Instant::now();
    // Where too little is free the file would fill what others need.
    let written = match free_bytes < needed_bytes {
        true => Ok(()),
        false => write(Path::new(SHARED_MEMORY), needed_bytes),
    };
    let found = SharedMemory {
        needed_bytes,
        free_bytes,
        in_memory,
        refused: written.err().map_or_else(String::new, |error| error.to_string()),
        took_ms: begun.elapsed().as_secs_f64() * 1e3,
    };
    Ok(judge(&found).measured(&found))
}

/// Writes a file of so many bytes, which is gone afterwards, and reads its last byte back by
/// another handle.
fn write(folder: &Path, bytes: u64) -> io::Result<()> {
    use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
    let mut file = tempfile::Builder::new().prefix("farreach-doctor-").tempfile_in(folder)?;
    let block = vec![0xa5_u8; 1 << 20];
    let mut left = bytes;
    while left > 0 {
        let part = left.min(block.len() as u64);
        file.write_all(&block[..part as usize])?;
        left -= part;
    }
    let mut again = file.reopen()?;
    let mut last = [0; 1];
    again.seek(SeekFrom::End(-1))?;
    again.read_exact(&mut last)?;
    if last == [0xa5] { Ok(()) } else { Err(io::Error::other("what was written is not there")) }
}

fn judge(found: &SharedMemory) -> Outcome {
    let SharedMemory { needed_bytes, free_bytes, in_memory, refused, .. } = found;
    let mebibytes = |bytes: u64| bytes >> 20;
    // A tmpfs without a limit.
    let free = match *free_bytes {
        u64::MAX => "unlimited memory".to_owned(),
        free_bytes => format!("{} MiB free", mebibytes(free_bytes)),
    };
    let text = format!("{} MiB of {free} in {SHARED_MEMORY}", mebibytes(*needed_bytes));
    if free_bytes < needed_bytes {
        return Outcome::new(Verdict::Fail, format!("a rig needs {text}"));
    }
    if !refused.is_empty() {
        let text = format!("{} MiB cannot be written: {refused}", mebibytes(*needed_bytes));
        return Outcome::new(Verdict::Fail, text)
            .remedy(format!("chmod 1777 {SHARED_MEMORY}, as it usually is"));
    }
    let text = format!("written {text}");
    if !in_memory {
        let remedy = format!("mount -t tmpfs tmpfs {SHARED_MEMORY}");
        return Outcome::new(Verdict::Fail, format!("{text}, which is no tmpfs")).remedy(remedy);
    }
    let verdict =
        if *free_bytes / ROOM_FOR < *needed_bytes { Verdict::Warn } else { Verdict::Pass };
    Outcome::new(verdict, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_for_two_rigs_passes() {
        let verdict = |free_bytes, in_memory, refused: &str| {
            judge(&SharedMemory {
                needed_bytes: 40 << 20,
                free_bytes,
                in_memory,
                refused: refused.to_owned(),
                took_ms: 1.0,
            })
            .verdict
        };
        assert_eq!(verdict(80 << 20, true, ""), Verdict::Pass);
        assert_eq!(verdict((80 << 20) - 1, true, ""), Verdict::Warn);
        assert_eq!(verdict(40 << 20, true, ""), Verdict::Warn);
        assert_eq!(verdict((40 << 20) - 1, true, ""), Verdict::Fail);
        assert_eq!(verdict(80 << 20, true, "Permission denied"), Verdict::Fail);
        assert_eq!(verdict(80 << 20, false, ""), Verdict::Fail);
    }

    #[test]
    fn a_file_is_written_and_gone_and_a_refusal_is_told() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), (1 << 20) + 7).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(write(&folder.path().join("absent"), 1).is_err());
    }
}
