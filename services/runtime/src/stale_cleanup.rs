//! Removing what the dead left behind in shared memory.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use crate::clock::{SECOND_NS, now_ns};
use crate::shared_memory::SHARED_MEMORY;

fn ignore_missing(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

fn each_segment(
    prefix: &str,
    mut action: impl FnMut(&Path, &str) -> io::Result<()>,
) -> io::Result<()> {
    for entry in fs::read_dir(SHARED_MEMORY)? {
        let entry = entry?;
        if let Some(name) = entry.file_name().to_str()
            && name.starts_with(prefix)
            && entry.file_type().is_ok_and(|kind| kind.is_file())
        {
            action(&entry.path(), name)?;
        }
    }
    Ok(())
}

/// Removes every segment whose name begins with `prefix`.
pub(crate) fn segments(prefix: &str) -> io::Result<()> {
    each_segment(prefix, |path, _| ignore_missing(fs::remove_file(path)))
}

/// Removes the library's directory and all segments of a domain.
pub(crate) fn domain(library_root: &Path, prefix: &str) -> io::Result<()> {
    ignore_missing(fs::remove_dir_all(library_root))?;
    segments(prefix)
}

/// Takes away every right of others on the segments of a domain.
pub(crate) fn close_to_others(prefix: &str) -> io::Result<()> {
    each_segment(prefix, |path, _| {
        let mode = match fs::metadata(path) {
            Ok(found) => found.permissions().mode(),
            Err(_) => return Ok(()),
        };
        if mode & 0o077 != 0 {
            return ignore_missing(fs::set_permissions(
                path,
                fs::Permissions::from_mode(mode & 0o700),
            ));
        }
        Ok(())
    })
}

/// The process id inside one of the library's identifiers (seconds, nanoseconds, pid, counter: 32
/// bits each).
fn pid_of(identifier: u128) -> u32 {
    (identifier >> 64) as u32
}

fn is_dead(pid: u32) -> bool {
    // SAFETY: signal 0 only asks whether the process exists.
    let found = unsafe { libc::kill(pid as libc::pid_t, 0) } == 0;
    !found && io::Error::last_os_error().raw_os_error() == Some(libc::ESRCH)
}

/// Process ids in a file name: every run of digits, of the length of an identifier, after the
/// prefix.
fn pids_in(name: &str) -> Vec<u32> {
    name.split(|c: char| !c.is_ascii_digit())
        .filter(|digits| digits.len() >= 20)
        .filter_map(|digits| digits.parse::<u128>().ok())
        .map(pid_of)
        .collect()
}

/// Watches for remains that the library itself does not clean up: files of a node that died while
/// it was being made (some of them empty, which the library's lister skips for ever), and segments
/// of its ports. They are removed a good while after their process is known to be dead.
#[derive(Debug)]
pub(crate) struct Orphans {
    nodes: PathBuf,
    prefix: String,
    swept_at_ns: u64,
    seen_dead_ns: HashMap<u32, u64>,
}

impl Orphans {
    /// The library has this long to clean up by itself.
    const PATIENCE_NS: u64 = 3 * SECOND_NS;

    pub(crate) fn new(library_root: &Path, prefix: &str) -> Self {
        Self {
            nodes: library_root.join("nodes"),
            prefix: prefix.to_owned(),
            swept_at_ns: 0,
            seen_dead_ns: HashMap::new(),
        }
    }

    /// Looks once a second. What cannot be removed now is tried again the next time.
    pub(crate) fn clean(&mut self) {
        let now = now_ns();
        if now < self.swept_at_ns + SECOND_NS {
            return;
        }
        self.swept_at_ns = now;
        let mut remains: Vec<(PathBuf, Vec<u32>)> = Vec::new();
        if let Ok(entries) = fs::read_dir(&self.nodes) {
            for entry in entries.flatten() {
                let name = entry.file_name().to_string_lossy().into_owned();
                remains.push((
                    entry.path(),
                    pids_in(name.strip_prefix(self.prefix.as_str()).unwrap_or(&name)),
                ));
            }
        }
        let prefix = self.prefix.clone();
        // Only segments of ports: a service's own segment outlives the process that happened to
        // make it.
        let listed = each_segment(&prefix, |path, name| {
            if name.ends_with(".data") || name.ends_with(".connection") {
                remains.push((path.to_path_buf(), pids_in(&name[prefix.len()..])));
            }
            Ok(())
        });
        if listed.is_err() {
            return;
        }
        let dead: HashSet<u32> = remains
            .iter()
            .flat_map(|(_, pids)| pids.iter().copied())
            .filter(|pid| is_dead(*pid))
            .collect();
        self.seen_dead_ns.retain(|pid, _| dead.contains(pid));
        for pid in &dead {
            self.seen_dead_ns.entry(*pid).or_insert(now);
        }
        let long_dead = |pid: &u32| {
            self.seen_dead_ns.get(pid).is_some_and(|since| now >= since + Self::PATIENCE_NS)
        };
        for (path, pids) in &remains {
            if !pids.is_empty() && pids.iter().all(long_dead) {
                let _gone =
                    if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn process_ids_are_found_in_file_names() {
        // counter 1, pid 0x24c4, nanoseconds 0x07c76118, seconds 0x495
        let identifier: u128 = 79_228_336_135_580_082_782_181_786_773;
        assert_eq!(pid_of(identifier), 0x24c4);
        let name = format!("0354a209029e7d094a819e2d4030ea331e6caaf0_{identifier}.data");
        assert_eq!(pids_in(&name), [0x24c4]);
        assert!(is_dead(u32::MAX >> 2));
        assert!(!is_dead(std::process::id()));
    }

    #[test]
    fn remains_of_the_dead_go_and_those_of_the_living_stay() {
        let root = tempfile::tempdir().unwrap();
        let nodes = root.path().join("nodes");
        let dead = u128::from(u32::MAX >> 2) << 64 | 7;
        let living = u128::from(std::process::id()) << 64 | 7;
        for id in [dead, living] {
            fs::create_dir_all(nodes.join(id.to_string())).unwrap();
            fs::write(nodes.join(id.to_string()).join("p_node.details"), "").unwrap();
            fs::write(nodes.join(format!("p_{id}.node_monitor")), "").unwrap();
        }
        let mut orphans = Orphans::new(root.path(), "p_");
        orphans.clean();
        assert!(nodes.join(dead.to_string()).exists(), "the library gets its time first");
        orphans.swept_at_ns = 0;
        orphans.seen_dead_ns.values_mut().for_each(|since| *since -= Orphans::PATIENCE_NS);
        orphans.clean();
        assert!(!nodes.join(dead.to_string()).exists());
        assert!(!nodes.join(format!("p_{dead}.node_monitor")).exists());
        assert!(nodes.join(living.to_string()).exists());
        assert!(nodes.join(format!("p_{living}.node_monitor")).exists());
    }
}
