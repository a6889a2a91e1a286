//! Whether the counters have counted since an earlier process read them.
//!
//! A comedi card does not tell when it was powered up. A file in the rig's run directory says with
//! which boot of the computer, attachment of the card and wiring the counters were started: as long
//! as all three are the same, and the counters count, the encoders were followed without a break.

use std::collections::hash_map::DefaultHasher;
use std::fs;
use std::hash::{Hash, Hasher};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use files::Format;
use runtime::clock::realtime_ns;
use serde::{Deserialize, Serialize};

const FORMAT: Format = Format { what: "power-up of the card", mark: *b"FRPU", version: 1 };
/// Name of the file in the rig's run directory.
const FILE: &str = "acquisition.power-up";

/// What the counters were started with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Started {
    boot: String,
    /// Inode of each device in sysfs: another one with each attachment. None where the system does
    /// not tell; nothing is then the same.
    attachments: Option<Vec<u64>>,
    wiring: u64,
}

#[derive(Debug, Serialize, Deserialize)]
struct Kept {
    started: Started,
    number: u64,
}

impl Started {
    /// Now, for these device nodes and this wiring.
    pub(super) fn now<'a>(nodes: impl Iterator<Item = &'a str>, wiring: impl Hash) -> Self {
        let mut hasher = DefaultHasher::new();
        wiring.hash(&mut hasher);
        let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
        Self { boot, attachments: nodes.map(attachment).collect(), wiring: hasher.finish() }
    }

    /// Number of the power-up during which an earlier process started the counters in the same
    /// way; `None` where they must be started.
    pub(super) fn kept(&self, directory: Option<&Path>) -> Option<u64> {
        let bytes = fs::read(directory?.join(FILE)).ok()?;
        let kept: Kept = FORMAT.decode(&bytes).ok()?;
        let same = self.attachments.is_some() && kept.started == *self;
        same.then_some(kept.number)
    }

    /// A new number, kept for the next process. One that cannot be kept costs the next process its
    /// zeros.
    pub(super) fn keep(self, directory: Option<&Path>) -> u64 {
        let number = realtime_ns();
        if let Some(path) = directory.map(|directory| directory.join(FILE)) {
            let bytes = FORMAT.encode(&Kept { started: self, number });
            let written = bytes
                .map_err(|error| error.to_string())
                .and_then(|bytes| files::replace(&path, bytes).map_err(|error| error.to_string()));
            if let Err(error) = written {
                eprintln!("farreach acquisition: {}: {error}", path.display());
            }
        }
        number
    }
}

fn attachment(node: &str) -> Option<u64> {
    let node: PathBuf = fs::canonicalize(node).ok()?;
    let class = Path::new("/sys/class/comedi").join(node.file_name()?);
    Some(fs::metadata(class).ok()?.ino())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_number_is_kept_while_boot_attachment_and_wiring_are_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let directory = Some(folder.path());
        let started = |boot: &str, attachments: Option<Vec<u64>>, wiring| Started {
            boot: boot.to_owned(),
            attachments,
            wiring,
        };
        let first = started("a", Some(vec![5]), 1);
        assert_eq!(first.kept(directory), None);
        let number = first.clone().keep(directory);
        assert_eq!(first.kept(directory), Some(number));
        for other in [
            started("b", Some(vec![5]), 1),
            started("a", Some(vec![6]), 1),
            started("a", Some(vec![5]), 2),
            started("a", None, 1),
        ] {
            assert_eq!(other.kept(directory), None, "{other:?}");
        }
        // What the system does not tell is never the same.
        let untold = started("a", None, 1);
        untold.clone().keep(directory);
        assert_eq!(untold.kept(directory), None);
        fs::write(folder.path().join(FILE), "damaged").unwrap();
        assert_eq!(first.kept(directory), None);
        assert_eq!(first.kept(None), None);
    }
}
