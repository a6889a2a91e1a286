//! Identity of a process: pid and start time, so that a recycled pid is not mistaken for it.

use std::fmt;
use std::os::fd::{AsFd, OwnedFd};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use serde::{Deserialize, Serialize};

/// A process; another one that gets the same pid later has another identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ProcessIdentity {
    /// Process id.
    pub pid: i32,
    /// Start time in clock ticks since boot: field 22 of `/proc/PID/stat`.
    pub start_time: u64,
}

impl fmt::Display for ProcessIdentity {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "pid {}", self.pid)
    }
}

impl ProcessIdentity {
    /// The living process with this pid; `None` if there is none or only a zombie.
    pub fn of(pid: i32) -> Option<Self> {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        let (state, start_time) = state_and_start_time(&stat)?;
        let dead = match state {
            'X' | 'x' => true,
            // The first thread is a zombie; the process lives, with its files and locks, until its
            // last thread has ended.
            'Z' => pidfd_open(Pid::from_raw(pid)?, PidfdFlags::NONBLOCK)
                .map_or(true, |handle| has_ended(&handle)),
            _ => false,
        };
        (!dead).then_some(Self { pid, start_time })
    }

    /// This process.
    pub fn own() -> Option<Self> {
        Self::of(i32::try_from(std::process::id()).ok()?)
    }

    /// Whether this very process is alive.
    pub fn is_alive(&self) -> bool {
        Self::of(self.pid) == Some(*self)
    }

    /// A handle to this very process; `None` if it has ended, even if its pid was reused.
    pub fn open(&self) -> Option<OwnedFd> {
        let handle = pidfd_open(Pid::from_raw(self.pid)?, PidfdFlags::NONBLOCK).ok()?;
        // The handle refers to whichever process had the pid when it was opened, and cannot change.
        self.is_alive().then_some(handle)
    }

    /// Sends a signal to this very process; `false` if it has ended.
    pub fn signal(&self, signal: Signal) -> bool {
        self.open().is_some_and(|handle| pidfd_send_signal(&handle, signal).is_ok())
    }
}

/// Whether the process behind a pidfd has ended with all its threads; reaped or not.
pub(crate) fn has_ended(handle: impl AsFd) -> bool {
    let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
    matches!(poll(&mut [PollFd::new(&handle, PollFlags::IN)], Some(&at_once)), Ok(1))
}

/// Fields 3 and 22 of `/proc/PID/stat`. The name in field 2 may hold blanks and brackets: what
/// counts is the last `)`.
fn state_and_start_time(stat: &str) -> Option<(char, u64)> {
    let mut fields = stat[stat.rfind(')')? + 1..].split_whitespace();
    let state = fields.next()?.chars().next()?;
    let start_time = fields.nth(18)?.parse().ok()?;
    Some((state, start_time))
}

/// Identity of this boot of the computer, within which start times are valid; empty if it cannot be
/// read.
pub fn boot_id() -> String {
    std::fs::read_to_string("/proc/sys/kernel/random/boot_id")
        .map(|text| text.trim().to_owned())
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_with_brackets_does_not_shift_the_fields() {
        let stat =
            "42 (a) b (c)) S 1 42 42 0 -1 4194304 1 0 0 0 0 0 0 0 20 0 1 0 987654 1000 1 2 3";
        assert_eq!(state_and_start_time(stat), Some(('S', 987_654)));
        assert_eq!(state_and_start_time("42 (a"), None);
    }

    #[test]
    fn another_start_time_is_another_process() {
        let own = ProcessIdentity::own().unwrap();
        assert!(own.is_alive());
        assert!(own.open().is_some());
        let recycled = ProcessIdentity { start_time: own.start_time + 1, ..own };
        assert!(!recycled.is_alive());
        assert!(recycled.open().is_none());
    }

    #[test]
    fn a_zombie_is_dead() {
        let mut child = std::process::Command::new("true").spawn().unwrap();
        let pid = child.id() as i32;
        let handle = pidfd_open(Pid::from_raw(pid).unwrap(), PidfdFlags::empty()).unwrap();
        rustix::event::poll(
            &mut [rustix::event::PollFd::new(&handle, rustix::event::PollFlags::IN)],
            None,
        )
        .unwrap();
        assert_eq!(ProcessIdentity::of(pid), None);
        child.wait().unwrap();
    }
}
