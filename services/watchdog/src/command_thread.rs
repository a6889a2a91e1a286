//! The command thread: serves the operator's verbs, follows launcher and keeper.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crossbeam_queue::ArrayQueue;
use ipc_types::{
    CardKind, Event, EventKind, Process, Severity, Verb, VerbAnswer, WATCHDOG_COMMANDS,
    WatchdogState, heartbeat_topic,
};
use runtime::clock::{ClockPair, now_ns};
use runtime::{Domain, RigName, Server, ServiceError, Subscriber};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fd::OwnedFd;
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use rustix::time::Timespec;

use crate::clock_of_day::ClockOfDay;
use crate::doctor_gate::{DoctorGate, Passage};
use crate::logger_watch::LoggerWatch;
use crate::since::Since;
use crate::verb_exchange::VerbExchange;

/// Period of the thread.
const PERIOD: Duration = Duration::from_millis(2);
/// Period of the checks of keeper, logger and clock.
const KEEPER_PERIOD: Duration = Duration::from_millis(50);
/// How long the loop may take to execute a verb.
const VERB_LIMIT: Duration = Duration::from_millis(500);
/// A command thread without a cycle for so long hangs (ns): as long as the longest verb may take,
/// `arm` on a real card, which waits for the doctor's report and then for the loop.
const HANG_NS: u64 = 1_000_000_000;

/// What the loop and the command thread share. Nothing here blocks.
#[derive(Debug)]
pub(crate) struct Shared {
    /// Verbs for the loop, and their answers.
    pub(crate) verbs: VerbExchange,
    /// The launcher is alive, or there never was one.
    pub(crate) launcher: AtomicBool,
    /// The keeper is alive.
    pub(crate) keeper: AtomicBool,
    /// The logger is alive.
    pub(crate) logger: AtomicBool,
    /// Steps of the clock of the day that are not yet reported (s).
    pub(crate) clock_steps: ArrayQueue<f64>,
    /// The watchdog's state, for answers.
    pub(crate) state: AtomicU8,
    /// The command thread has ended.
    pub(crate) dead: AtomicBool,
    /// Cycles of the thread.
    pub(crate) cycles: AtomicU64,
    /// The card that the newest sample names ([`CardKind`]); [`NO_CARD`] before the first.
    pub(crate) card: AtomicU8,
    /// Events of the thread, for the loop to publish.
    pub(crate) events: ArrayQueue<Event>,
}

/// No sample has named a card yet.
const NO_CARD: u8 = u8::MAX;

impl Shared {
    pub(crate) fn new() -> Self {
        Self {
            verbs: VerbExchange::new(),
            launcher: AtomicBool::new(true),
            keeper: AtomicBool::new(true),
            logger: AtomicBool::new(true),
            clock_steps: ArrayQueue::new(8),
            state: AtomicU8::new(WatchdogState::Faulted.code()),
            dead: AtomicBool::new(false),
            cycles: AtomicU64::new(0),
            card: AtomicU8::new(NO_CARD),
            events: ArrayQueue::new(1),
        }
    }
}

/// The command thread's heartbeat, as the loop sees it. A thread that hangs executes no `estop` and
/// sees no launcher die.
#[derive(Debug, Default)]
pub(crate) struct Heartbeat {
    cycles: u64,
    since: Since,
}

impl Heartbeat {
    /// Whether the thread has run lately; `cycles` is its counter.
    pub(crate) fn is_alive(&mut self, cycles: u64, now_ns: u64) -> bool {
        let ran = std::mem::replace(&mut self.cycles, cycles) != cycles;
        self.since.elapsed_ns(ran, now_ns) <= HANG_NS
    }
}

/// Held by the command thread. However the thread ends early, by a panic too, the watchdog ends
/// with it and the service manager restarts it: without the thread `estop` has no effect.
struct CommandThreadGuard {
    shared: Arc<Shared>,
    stop: Arc<AtomicBool>,
}

impl Drop for CommandThreadGuard {
    fn drop(&mut self) {
        if !self.stop.load(Ordering::Relaxed) {
            self.shared.dead.store(true, Ordering::Relaxed);
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// Follows the launcher by its pid file: `PID START_TIME`, as the launcher writes it.
#[derive(Debug)]
struct Launcher {
    file: PathBuf,
    handle: Option<OwnedFd>,
    /// A launcher was seen, so that its absence is a loss.
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

/// Starts the command thread. It ends with the process's stop flag.
pub(crate) fn start(
    gate: DoctorGate,
    name: RigName,
    shared: Arc<Shared>,
    stop: Arc<AtomicBool>,
) -> std::io::Result<std::thread::JoinHandle<()>> {
    runtime::realtime::beside_loop("verbs").spawn(move || {
        let guard = CommandThreadGuard { shared, stop };
        if let Err(error) = serve(&gate, &name, &guard.shared, &guard.stop) {
            eprintln!("farreach watchdog: the command thread ended: {error}");
        }
    })
}

fn serve(
    gate: &DoctorGate,
    name: &RigName,
    shared: &Shared,
    stop: &AtomicBool,
) -> Result<(), ServiceError> {
    let domain = Domain::open(name)?;
    runtime::realtime::request_helper(domain.fifo());
    let node = domain.node("watchdog-verbs")?;
    let server = Server::new(&node, &WATCHDOG_COMMANDS)?;
    let mut launcher = Launcher::new(name);
    let mut keeper_seen = Instant::now();
    let heartbeats = heartbeat_topic(Process::Logger).map(|topic| Subscriber::new(&node, topic));
    let mut logger = heartbeats.transpose()?.map(LoggerWatch::new);
    let mut day = ClockOfDay::default();
    while !stop.load(Ordering::Relaxed) {
        shared.launcher.store(launcher.alive(), Ordering::Relaxed);
        if keeper_seen.elapsed() >= KEEPER_PERIOD {
            keeper_seen = Instant::now();
            shared.keeper.store(domain.keeper_lives(), Ordering::Relaxed);
            if let Some(logger) = &mut logger {
                shared.logger.store(logger.alive(now_ns())?, Ordering::Relaxed);
            }
            if let Some(step_s) = day.step_s(ClockPair::measure()) {
                // Eight steps within one cycle of the loop are none of a clock's.
                let _queued = shared.clock_steps.push(step_s);
            }
        }
        // One verb at a time: between two of them everything else is looked at.
        let answered = server.poll(
            |verb: Verb| answer_through(gate, verb, shared),
            |error| eprintln!("farreach watchdog: a command could not be answered: {error}"),
        )?;
        shared.cycles.fetch_add(1, Ordering::Relaxed);
        if !answered {
            std::thread::sleep(PERIOD);
        }
    }
    Ok(())
}

/// Answers a verb that the doctor's report allows, or that a person wants all the same.
fn answer_through(gate: &DoctorGate, verb: Verb, shared: &Shared) -> VerbAnswer {
    let card = CardKind::from_code(shared.card.load(Ordering::Relaxed));
    let overridden = match gate.passage(verb, card) {
        Passage::Refused(reason) => {
            return VerbAnswer { done: false, state: state(shared), reason };
        }
        Passage::Overridden(objection) => Some(objection),
        Passage::Free => None,
    };
    let answer = answer(verb, shared);
    if let Some(objection) = overridden.filter(|_| answer.done) {
        // The loop has told every earlier one: it has answered this verb since.
        let _queued = shared.events.push(armed_unchecked(&objection));
    }
    answer
}

/// The event that tells of an `arm --unchecked`.
fn armed_unchecked(objection: &str) -> Event {
    Event::new(Process::Watchdog, EventKind::ArmedUnchecked, Severity::Warning, objection)
}

fn state(shared: &Shared) -> WatchdogState {
    WatchdogState::from_code(shared.state.load(Ordering::Relaxed)).unwrap_or(WatchdogState::Faulted)
}

fn answer(verb: Verb, shared: &Shared) -> VerbAnswer {
    let state = || state(shared);
    let refused = |reason: String| VerbAnswer { done: false, state: state(), reason };
    let Some(ticket) = shared.verbs.ask(verb) else {
        return refused("the watchdog is still executing an earlier command".to_owned());
    };
    let asked = Instant::now();
    loop {
        match shared.verbs.answer_to(&ticket) {
            Some(Ok(state)) => return VerbAnswer { done: true, state, reason: String::new() },
            Some(Err(refusal)) => return refused(refusal.to_string()),
            None if asked.elapsed() > VERB_LIMIT => {
                let taken_back = shared.verbs.give_up(ticket);
                let what = if taken_back { "it was not executed" } else { "check the state" };
                return refused(format!("the watchdog's loop did not answer; {what}"));
            }
            None => std::thread::sleep(Duration::from_millis(1)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interlock::Refusal;

    #[test]
    fn a_verb_that_the_loop_does_not_execute_is_taken_back() {
        let shared = Shared::new();
        let said = answer(Verb::Enable, &shared);
        assert!(!said.done && said.reason.contains("not executed"), "{said:?}");
        assert!(shared.verbs.take().is_none());
    }

    #[test]
    fn refusals_reach_the_operator_in_words() {
        let shared = Arc::new(Shared::new());
        let inner = Arc::clone(&shared);
        let loop_thread = std::thread::spawn(move || {
            let order = loop {
                match inner.verbs.take() {
                    Some(order) => break order,
                    None => std::thread::yield_now(),
                }
            };
            inner.verbs.answer(order, Err(Refusal::Moving));
        });
        let said = answer(Verb::Arm, &shared);
        loop_thread.join().unwrap();
        assert!(!said.done && said.reason.contains("moves"), "{said:?}");
    }

    #[test]
    fn sr_14_a_refused_arm_does_not_reach_the_loop_and_an_override_is_told() {
        let gate = DoctorGate::new(None, "bench".parse().unwrap()).unwrap();
        let shared = Arc::new(Shared::new());
        shared.card.store(CardKind::Hardware.code(), Ordering::Relaxed);
        let said = answer_through(&gate, Verb::Arm, &shared);
        assert!(!said.done && said.reason.contains("farreach doctor"), "{said:?}");
        assert!(shared.verbs.take().is_none() && shared.events.is_empty());
        let inner = Arc::clone(&shared);
        let loop_thread = std::thread::spawn(move || {
            for done in [Err(Refusal::Moving), Ok(WatchdogState::Armed)] {
                let order = loop {
                    match inner.verbs.take() {
                        Some(order) => break order,
                        None => std::thread::yield_now(),
                    }
                };
                inner.verbs.answer(order, done);
            }
        });
        // What the loop refuses is no override.
        assert!(!answer_through(&gate, Verb::ArmUnchecked, &shared).done);
        assert!(shared.events.is_empty());
        assert!(answer_through(&gate, Verb::ArmUnchecked, &shared).done);
        loop_thread.join().unwrap();
        let event = shared.events.pop().unwrap();
        assert_eq!(event.kind, EventKind::ArmedUnchecked.code());
        assert!(event.text.starts_with(b"there is no doctor's report"), "{event:?}");
    }

    #[test]
    fn a_command_thread_that_panics_ends_the_watchdog() {
        let (shared, stop) = (Arc::new(Shared::new()), Arc::new(AtomicBool::new(false)));
        let guard = CommandThreadGuard { shared: Arc::clone(&shared), stop: Arc::clone(&stop) };
        let thread = std::thread::spawn(move || {
            let _guard = guard;
            panic!("as a port may");
        });
        assert!(thread.join().is_err());
        assert!(shared.dead.load(Ordering::Relaxed) && stop.load(Ordering::Relaxed));
        // One that ends on request is not reported dead.
        let shared = Arc::new(Shared::new());
        drop(CommandThreadGuard { shared: Arc::clone(&shared), stop });
        assert!(!shared.dead.load(Ordering::Relaxed));
    }

    #[test]
    fn a_command_thread_that_hangs_is_noticed_and_a_slow_one_is_not() {
        let mut heartbeat = Heartbeat::default();
        assert!(heartbeat.is_alive(0, 5_000_000_000), "its time begins with the first check");
        assert!(heartbeat.is_alive(0, 5_000_000_000 + HANG_NS));
        assert!(!heartbeat.is_alive(0, 5_000_000_001 + HANG_NS));
        assert!(heartbeat.is_alive(1, 7_000_000_000), "it runs again");
        assert!(heartbeat.is_alive(1, 7_000_000_000 + HANG_NS));
        assert!(!heartbeat.is_alive(1, 9_000_000_000));
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
