//! Notices the death of a process through the kernel: a pidfd for each process that has a node in
//! the domain, and inotify on the folder of the nodes, so that nothing runs while nothing changes.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fd::OwnedFd;
use rustix::fs::inotify::{CreateFlags, WatchFlags, add_watch, init};
use rustix::io::Errno;
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use rustix::time::Timespec;

use crate::stale_cleanup::{NodeFolder, Remains};

/// The processes that have a node in a domain.
#[derive(Debug)]
pub(crate) struct ProcessWatch {
    /// Readable after a node came or went, and after an overflow of the queue. `None` where the
    /// system grants no inotify: then a new process is watched from the next refresh on.
    changes: Option<OwnedFd>,
    /// Pidfds, readable once the process is dead. `None` for a process known to be dead, until its
    /// last node is gone.
    processes: BTreeMap<u32, Option<OwnedFd>>,
}

impl ProcessWatch {
    /// Watches the processes with a node in the folder.
    pub(crate) fn new(nodes: &NodeFolder) -> Self {
        let changes = watch_folder(&nodes.path)
            .inspect_err(|error| {
                eprintln!(
                    "farreach keeper: no inotify on {}: {error}; new processes are noticed by the \
                     scan once a second",
                    nodes.path.display()
                );
            })
            .ok();
        let mut watch = Self { changes, processes: BTreeMap::new() };
        watch.refresh(&nodes.list().unwrap_or_default());
        watch
    }

    /// By a list of the nodes, opens a pidfd for each process that is new and closes those of
    /// processes without a node.
    pub(crate) fn refresh(&mut self, nodes: &[Remains]) {
        let mut processes = BTreeMap::new();
        for &pid in nodes.iter().flat_map(|(_, pids)| pids) {
            processes
                .entry(pid)
                .or_insert_with(|| self.processes.remove(&pid).unwrap_or_else(|| open(pid)));
        }
        self.processes = processes;
    }

    /// Waits until a process dies, a node appears or goes, a signal arrives or `limit` has passed.
    /// Returns whether there may be something to clean up. Each death is reported once.
    pub(crate) fn wait(&mut self, limit: Duration) -> bool {
        let handles = self.changes.iter().chain(self.processes.values().flatten());
        let mut polled: Vec<PollFd<'_>> =
            handles.map(|handle| PollFd::new(handle, PollFlags::IN)).collect();
        match poll(&mut polled, Timespec::try_from(limit).ok().as_ref()) {
            Ok(0) | Err(Errno::INTR) => return false,
            Ok(_) => {}
            // No memory, or more processes than this one may have files: the scan has to do.
            Err(_) => {
                std::thread::sleep(limit);
                return false;
            }
        }
        let ready: Vec<bool> = polled.iter().map(|handle| !handle.revents().is_empty()).collect();
        let mut ready = ready.into_iter();
        if self.changes.is_some() && ready.next() == Some(true) {
            self.take_changes();
        }
        for process in self.processes.values_mut().filter(|process| process.is_some()) {
            if ready.next() == Some(true) {
                *process = None;
            }
        }
        true
    }

    /// Empties the queue; what does not fit into the buffer makes the next wait return at once.
    fn take_changes(&mut self) {
        let read = self.changes.as_ref().map(|changes| rustix::io::read(changes, &mut [0; 4096]));
        if !matches!(read, Some(Ok(1..) | Err(Errno::AGAIN | Errno::INTR))) {
            // Broken: it would end every wait at once.
            self.changes = None;
        }
    }
}

fn watch_folder(folder: &Path) -> io::Result<OwnedFd> {
    let changes = init(CreateFlags::CLOEXEC | CreateFlags::NONBLOCK)?;
    add_watch(&changes, folder, WatchFlags::CREATE | WatchFlags::DELETE | WatchFlags::MOVED_TO)?;
    Ok(changes)
}

/// `None` for a process that is gone, or where no more files can be opened; its remains are found
/// by the scan.
fn open(pid: u32) -> Option<OwnedFd> {
    pidfd_open(Pid::from_raw(i32::try_from(pid).ok()?)?, PidfdFlags::empty()).ok()
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::PathBuf;
    use std::process::{Child, Command};

    use super::*;

    /// Ends a wait that should have ended long before.
    const LONG: Duration = Duration::from_secs(20);

    fn sleeper(nodes: &Path) -> (Child, PathBuf) {
        let child = Command::new("sleep").arg("60").spawn().unwrap();
        let node = nodes.join(format!("rig_{}", u128::from(child.id()) << 64));
        fs::create_dir(&node).unwrap();
        (child, node)
    }

    fn folder() -> (tempfile::TempDir, NodeFolder) {
        let root = tempfile::tempdir().unwrap();
        let nodes = NodeFolder::new(root.path(), "rig_");
        fs::create_dir(&nodes.path).unwrap();
        (root, nodes)
    }

    #[test]
    fn a_new_node_and_a_death_end_the_wait_and_a_death_does_so_once() {
        let (_root, nodes) = folder();
        let mut watch = ProcessWatch::new(&nodes);
        assert!(!watch.wait(Duration::ZERO), "nothing happened");
        let (mut child, node) = sleeper(&nodes.path);
        assert!(watch.wait(LONG), "a node appeared");
        watch.refresh(&nodes.list().unwrap());
        assert!(watch.processes[&child.id()].is_some());
        assert!(!watch.wait(Duration::ZERO), "the change was taken");
        child.kill().unwrap();
        assert!(watch.wait(LONG), "the process died");
        // Not yet waited for, it still has its entry in the table of processes, and its node.
        watch.refresh(&nodes.list().unwrap());
        assert!(!watch.wait(Duration::ZERO), "a death is reported once");
        child.wait().unwrap();
        fs::remove_dir(node).unwrap();
        assert!(watch.wait(LONG), "a node went");
        watch.refresh(&nodes.list().unwrap());
        assert!(watch.processes.is_empty(), "no file stays open for a process without a node");
    }

    #[test]
    fn without_inotify_a_refresh_finds_the_processes() {
        let (_root, nodes) = folder();
        let mut watch = ProcessWatch::new(&nodes);
        watch.changes = None;
        let (mut child, _node) = sleeper(&nodes.path);
        assert!(!watch.wait(Duration::ZERO));
        watch.refresh(&nodes.list().unwrap());
        child.kill().unwrap();
        assert!(watch.wait(LONG), "the process died");
        child.wait().unwrap();
    }

    #[test]
    fn a_folder_that_cannot_be_watched_is_no_error() {
        let mut watch = ProcessWatch::new(&NodeFolder::new(Path::new("/nonexistent"), "rig_"));
        assert!(watch.changes.is_none());
        assert!(!watch.wait(Duration::ZERO));
    }
}
