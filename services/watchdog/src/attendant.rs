//! The slow side of the watchdog: answers the operator's verbs, looks after launcher and keeper.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crossbeam_queue::ArrayQueue;
use ipc_types::{Verb, VerbAnswer, WATCHDOG_COMMANDS, WatchdogState};
use runtime::{Domain, DomainError, RequestError, RigName, Server};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fd::OwnedFd;
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use rustix::time::Timespec;

use crate::machine::Refusal;

/// How often it looks around.
const ROUND: Duration = Duration::from_millis(2);
/// How often it looks after the keeper.
const KEEPER_EVERY: Duration = Duration::from_millis(50);
/// How long the loop may take to do a verb.
const VERB_LIMIT: Duration = Duration::from_millis(500);
/// An attendant that has not gone round for so long hangs (ns): twice what a verb may take.
const PATIENCE_NS: u64 = 1_000_000_000;

/// What the loop and the attendant share. Nothing here blocks.
#[derive(Debug)]
pub(crate) struct Shared {
    /// Verbs for the loop.
    pub(crate) verbs: ArrayQueue<Verb>,
    /// What came of them.
    pub(crate) answers: ArrayQueue<Result<WatchdogState, Refusal>>,
    /// The launcher lives, or there is none to look for.
    pub(crate) launcher: AtomicBool,
    /// The keeper lives.
    pub(crate) keeper: AtomicBool,
    /// The watchdog's state, for answers.
    pub(crate) state: AtomicU8,
    /// The attendant gave up.
    pub(crate) deaf: AtomicBool,
    /// How often it went round.
    pub(crate) rounds: AtomicU64,
}

impl Shared {
    pub(crate) fn new() -> Self {
        Self {
            verbs: ArrayQueue::new(1),
            answers: ArrayQueue::new(1),
            launcher: AtomicBool::new(true),
            keeper: AtomicBool::new(true),
            state: AtomicU8::new(WatchdogState::Faulted.code()),
            deaf: AtomicBool::new(false),
            rounds: AtomicU64::new(0),
        }
    }
}

/// Whether the attendant goes round, as the loop sees it. One that hangs hears no `estop` and sees
/// no launcher die.
#[derive(Debug, Default)]
pub(crate) struct Attendance {
    rounds: u64,
    since_ns: Option<u64>,
}

impl Attendance {
    /// Whether it went round lately; `rounds` as it counts them.
    pub(crate) fn holds(&mut self, rounds: u64, now_ns: u64) -> bool {
        if rounds != self.rounds {
            (self.rounds, self.since_ns) = (rounds, Some(now_ns));
        }
        now_ns.saturating_sub(*self.since_ns.get_or_insert(now_ns)) <= PATIENCE_NS
    }
}

/// Held by the attendant's thread: however it ends before the process is to, a panic among it, the
/// watchdog ends too, and the service manager starts it anew. Without ears it must not go on.
struct Ears {
    shared: Arc<Shared>,
    stop: Arc<AtomicBool>,
}

impl Drop for Ears {
    fn drop(&mut self) {
        if !self.stop.load(Ordering::Relaxed) {
            self.shared.deaf.store(true, Ordering::Relaxed);
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// Follows the launcher by its pid file: `PID START_TIME`, as the launcher writes it.
#[derive(Debug)]
struct Launcher {
    file: PathBuf,
    handle: Option<OwnedFd>,
    /// There was a launcher once, so that its absence means something.
    expected: bool,
}

impl Launcher {
    fn new(name: &RigName) -> Self {
        Self { file: name.run_directory().join("launcher.pid"), handle: None, expected: false }
    }

    /// Field 22 of `/proc/PID/stat`: distinguishes a process from another one that got its number
    /// later.
    fn start_time(pid: i32) -> Option<u64> {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        stat.rsplit_once(')')?.1.split_whitespace().nth(19)?.parse().ok()
    }

    fn find(&self) -> Option<OwnedFd> {
        let text = std::fs::read_to_string(&self.file).ok()?;
        let mut words = text.split_whitespace();
        let pid: i32 = words.next()?.parse().ok()?;
        let start_time: u64 = words.next()?.parse().ok()?;
        let handle = pidfd_open(Pid::from_raw(pid)?, PidfdFlags::NONBLOCK).ok()?;
        (Self::start_time(pid) == Some(start_time)).then_some(handle)
    }

    fn alive(&mut self) -> bool {
        if self.handle.is_none() {
            self.handle = self.find();
        }
        let Some(handle) = &self.handle else { return !self.expected };
        self.expected = true;
        let mut waiting = [PollFd::new(handle, PollFlags::IN)];
        let ended = poll(&mut waiting, Some(&Timespec { tv_sec: 0, tv_nsec: 0 }))
            .is_ok_and(|ready| ready > 0);
        if ended {
            self.handle = None;
        }
        !ended
    }
}

/// Begins the attendant. It ends with the process's stop flag.
pub(crate) fn start(
    name: RigName,
    shared: Arc<Shared>,
    stop: Arc<AtomicBool>,
) -> std::io::Result<std::thread::JoinHandle<()>> {
    std::thread::Builder::new().name("verbs".to_owned()).spawn(move || {
        let ears = Ears { shared, stop };
        if let Err(error) = attend(&name, &ears.shared, &ears.stop) {
            eprintln!("farreach watchdog: the operator's verbs are not heard: {error}");
        }
    })
}

#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
enum AttendError {
    #[error(transparent)]
    Domain(#[from] DomainError),
    #[error(transparent)]
    Request(#[from] RequestError),
}

fn attend(name: &RigName, shared: &Shared, stop: &AtomicBool) -> Result<(), AttendError> {
    let domain = Domain::open(name)?;
    runtime::realtime::request_helper(domain.fifo());
    let node = domain.node("watchdog-verbs")?;
    let server = Server::new(&node, &WATCHDOG_COMMANDS)?;
    let mut launcher = Launcher::new(name);
    let mut keeper_seen = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        shared.launcher.store(launcher.alive(), Ordering::Relaxed);
        if keeper_seen.elapsed() >= KEEPER_EVERY {
            keeper_seen = Instant::now();
            shared.keeper.store(domain.keeper_lives(), Ordering::Relaxed);
        }
        server.poll(
            |verb: Verb| answer(verb, shared),
            |error| eprintln!("farreach watchdog: a verb could not be answered: {error}"),
        )?;
        shared.rounds.fetch_add(1, Ordering::Relaxed);
        std::thread::sleep(ROUND);
    }
    Ok(())
}

fn answer(verb: Verb, shared: &Shared) -> VerbAnswer {
    let state = || {
        WatchdogState::from_code(shared.state.load(Ordering::Relaxed))
            .unwrap_or(WatchdogState::Faulted)
    };
    // An answer that came too late for the verb before must not be taken for this one's.
    while shared.answers.pop().is_some() {}
    let refused = |reason: String| VerbAnswer { done: false, state: state(), reason };
    if shared.verbs.push(verb).is_err() {
        return refused("the watchdog has not done the verb before yet".to_owned());
    }
    let asked = Instant::now();
    loop {
        match shared.answers.pop() {
            Some(Ok(state)) => return VerbAnswer { done: true, state, reason: String::new() },
            Some(Err(refusal)) => return refused(refusal.to_string()),
            None if asked.elapsed() > VERB_LIMIT => {
                // Taken back, so that it is not done behind the operator's back later.
                let taken_back = shared.verbs.pop().is_some();
                let what = if taken_back { "it was not done" } else { "look at the state" };
                return refused(format!("the watchdog's loop did not answer; {what}"));
            }
            None => std::thread::sleep(Duration::from_millis(1)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verb_that_the_loop_does_not_do_is_taken_back() {
        let shared = Shared::new();
        let said = answer(Verb::Enable, &shared);
        assert!(!said.done && said.reason.contains("not done"), "{said:?}");
        assert!(shared.verbs.is_empty());
    }

    #[test]
    fn refusals_reach_the_operator_in_words() {
        let shared = Arc::new(Shared::new());
        let inner = Arc::clone(&shared);
        let loop_thread = std::thread::spawn(move || {
            while inner.verbs.pop().is_none() {
                std::thread::yield_now();
            }
            inner.answers.push(Err(Refusal::Moving)).unwrap();
        });
        let said = answer(Verb::Arm, &shared);
        loop_thread.join().unwrap();
        assert!(!said.done && said.reason.contains("moves"), "{said:?}");
    }

    #[test]
    fn an_attendant_that_panics_ends_the_watchdog() {
        let (shared, stop) = (Arc::new(Shared::new()), Arc::new(AtomicBool::new(false)));
        let ears = Ears { shared: Arc::clone(&shared), stop: Arc::clone(&stop) };
        let thread = std::thread::spawn(move || {
            let _ears = ears;
            panic!("as a port may");
        });
        assert!(thread.join().is_err());
        assert!(shared.deaf.load(Ordering::Relaxed) && stop.load(Ordering::Relaxed));
        // One that ends because it is to is not deaf.
        let shared = Arc::new(Shared::new());
        drop(Ears { shared: Arc::clone(&shared), stop });
        assert!(!shared.deaf.load(Ordering::Relaxed));
    }

    #[test]
    fn an_attendant_that_hangs_is_noticed_and_a_slow_one_is_not() {
        let mut attendance = Attendance::default();
        assert!(attendance.holds(0, 5_000_000_000), "its time begins with the first look");
        assert!(attendance.holds(0, 5_000_000_000 + PATIENCE_NS));
        assert!(!attendance.holds(0, 5_000_000_001 + PATIENCE_NS));
        assert!(attendance.holds(1, 7_000_000_000), "it goes round again");
        assert!(attendance.holds(1, 7_000_000_000 + PATIENCE_NS));
        assert!(!attendance.holds(1, 9_000_000_000));
    }

    #[test]
    fn a_launcher_is_followed_by_pid_and_start_time() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("launcher.pid");
        let mut launcher = Launcher { file: file.clone(), handle: None, expected: false };
        assert!(launcher.alive(), "no launcher was ever there");
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let pid = child.id() as i32;
        let start = Launcher::start_time(pid).unwrap();
        // another process had that number: not ours
        std::fs::write(&file, format!("{pid} {}\n", start + 1)).unwrap();
        assert!(launcher.find().is_none());
        std::fs::write(&file, format!("{pid} {start}\n")).unwrap();
        assert!(launcher.alive());
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!launcher.alive());
        assert!(!launcher.alive(), "and stays lost");
    }
}
