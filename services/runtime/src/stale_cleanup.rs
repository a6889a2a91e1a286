//! Removing what the dead left behind in shared memory.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use rustix::io::Errno;
use rustix::process::{Pid, test_kill_process};

use crate::clock::{MILLISECOND_NS, SECOND_NS, now_ns};
use crate::shared_memory::SHARED_MEMORY;

pub(crate) fn ignore_missing(result: io::Result<()>) -> io::Result<()> {
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
    let pid = i32::try_from(pid).ok().and_then(Pid::from_raw);
    pid.is_some_and(|pid| test_kill_process(pid) == Err(Errno::SRCH))
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

/// Something that processes have in the domain, and their ids by its name.
pub(crate) type Remains = (PathBuf, Vec<u32>);

/// The folder in which the library keeps the nodes of a domain.
#[derive(Debug)]
pub(crate) struct NodeFolder {
    pub(crate) path: PathBuf,
    prefix: String,
}

impl NodeFolder {
    pub(crate) fn new(library_root: &Path, prefix: &str) -> Self {
        Self { path: library_root.join("nodes"), prefix: prefix.to_owned() }
    }

    /// What stands in it now.
    pub(crate) fn list(&self) -> io::Result<Vec<Remains>> {
        let listed = fs::read_dir(&self.path)?.flatten().map(|entry| {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            (entry.path(), pids_in(name.strip_prefix(&self.prefix).unwrap_or(&name)))
        });
        Ok(listed.collect())
    }
}

/// When the clean-up runs: at once after a change, then every 30 ms for 300 ms, since what a
/// process leaves half made or half removed goes at a later attempt only; otherwise every second,
/// for what nothing gave notice of.
#[derive(Debug)]
pub(crate) struct CleanupSchedule {
    frequent_until_ns: u64,
    last_ns: u64,
}

impl CleanupSchedule {
    const FREQUENT_NS: u64 = 30 * MILLISECOND_NS;
    const FREQUENT_FOR_NS: u64 = 300 * MILLISECOND_NS;
    const IDLE_NS: u64 = SECOND_NS;

    /// Begins as after a change: processes may have died before.
    pub(crate) fn new(now_ns: u64) -> Self {
        Self { frequent_until_ns: now_ns + Self::FREQUENT_FOR_NS, last_ns: 0 }
    }

    /// A process died, or a node appeared or went.
    pub(crate) fn changed(&mut self, now_ns: u64) {
        self.frequent_until_ns = now_ns + Self::FREQUENT_FOR_NS;
    }

    /// Time to the next clean-up (ns); 0 where it is due.
    pub(crate) fn due_in_ns(&self, now_ns: u64) -> u64 {
        let period =
            if now_ns < self.frequent_until_ns { Self::FREQUENT_NS } else { Self::IDLE_NS };
        (self.last_ns + period).saturating_sub(now_ns)
    }

    /// A clean-up begins.
    pub(crate) fn begin(&mut self, now_ns: u64) {
        self.last_ns = now_ns;
    }
}

/// Watches for remains that the library itself does not clean up: files of a node that died while
/// it was being made (some of them empty, which the library's lister skips for ever), and segments
/// of its ports. They are removed a good while after their process is known to be dead.
#[derive(Debug, Default)]
pub(crate) struct Orphans {
    scanned_ns: u64,
    seen_dead_ns: HashMap<u32, u64>,
}

impl Orphans {
    /// The library has this long to clean up by itself.
    const PATIENCE_NS: u64 = 3 * SECOND_NS;

    /// Looks through the nodes as listed, and through the segments, once a second. What cannot be
    /// removed now is tried again the next time.
    pub(crate) fn clean(&mut self, folder: &NodeFolder, nodes: &[Remains]) {
        let now = now_ns();
        if now < self.scanned_ns + SECOND_NS {
            return;
        }
        self.scanned_ns = now;
        let mut remains = nodes.to_vec();
        let prefix = &folder.prefix;
        // Only segments of ports: a service's own segment outlives the process that happened to
        // make it.
        let listed = each_segment(prefix, |path, name| {
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

    /// Clean-ups in the ten seconds from `start_ns` on, if nothing else wakes the keeper.
    fn cleanups(schedule: &mut CleanupSchedule, start_ns: u64) -> usize {
        let (mut now, mut count) = (start_ns, 0);
        while now < start_ns + 10 * SECOND_NS {
            match schedule.due_in_ns(now) {
                0 => {
                    schedule.begin(now);
                    count += 1;
                }
                wait => now += wait,
            }
        }
        count
    }

    #[test]
    fn the_cleanup_follows_a_change_at_once_and_is_rare_without_one() {
        let mut schedule = CleanupSchedule::new(0);
        let now = 1000 * SECOND_NS;
        assert_eq!(cleanups(&mut schedule, now), 10);
        let now = now + 10 * SECOND_NS - MILLISECOND_NS;
        assert!(schedule.due_in_ns(now) > 0);
        schedule.changed(now);
        assert_eq!(schedule.due_in_ns(now), 0);
        // Ten within 300 ms, and one each second.
        assert_eq!(cleanups(&mut schedule, now), 19);
        // Changes without end do not make it more frequent.
        let now = now + 10 * SECOND_NS;
        schedule.begin(now);
        schedule.changed(now);
        assert_eq!(schedule.due_in_ns(now), CleanupSchedule::FREQUENT_NS);
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
        let folder = NodeFolder::new(root.path(), "p_");
        let mut orphans = Orphans::default();
        orphans.clean(&folder, &folder.list().unwrap());
        assert!(nodes.join(dead.to_string()).exists(), "the library gets its time first");
        orphans.scanned_ns = 0;
        orphans.seen_dead_ns.values_mut().for_each(|since| *since -= Orphans::PATIENCE_NS);
        orphans.clean(&folder, &folder.list().unwrap());
        assert!(!nodes.join(dead.to_string()).exists());
        assert!(!nodes.join(format!("p_{dead}.node_monitor")).exists());
        assert!(nodes.join(living.to_string()).exists());
        assert!(nodes.join(format!("p_{living}.node_monitor")).exists());
    }
}
