//! The key 5 at the terminal: many scanners' trigger boxes are keyboards that type it with every
//! volume.

use std::io::{self, IsTerminal, Read};
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ipc_types::ExperimentRequest;
use runtime::RigName;
use runtime::clock::now_ns;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::termios::{LocalModes, OptionalActions, Termios, tcgetattr, tcsetattr};

use crate::RigLink;

/// The key.
const KEY: u8 = b'5';
/// How long a key is sent again (ns): an older one is not counted.
const AGAIN_NS: u64 = 2_000_000_000;
const AGAIN_AFTER: Duration = Duration::from_millis(20);
/// Longest time for the thread to see that it shall end.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };

/// Keys that were not counted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Uncounted {
    /// How many.
    pub(crate) keys: u64,
    /// Why the last one was not.
    pub(crate) reason: String,
}

/// Sends each 5 that is typed to the experiment process, until it is dropped or finished.
pub(crate) struct ScannerKey {
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<Uncounted>>,
    /// The terminal's modes before; `None` where standard input is none.
    before: Option<Termios>,
}

impl ScannerKey {
    /// Begins to read standard input for the client of a protocol. A terminal then hands over each
    /// key at once, and does not show it.
    ///
    /// # Errors
    /// Where the rig cannot be reached or the terminal's modes cannot be set.
    pub(crate) fn start(rig: &RigName, client: u64) -> anyhow::Result<Self> {
        let ends = Arc::new(AtomicBool::new(false));
        let (ended, rig) = (Arc::clone(&ends), rig.clone());
        let thread = std::thread::Builder::new()
            .name("scanner key".to_owned())
            .spawn(move || count_keys(&rig, client, &ended))?;
        let mut key = Self { ends, thread: Some(thread), before: None };
        let input = io::stdin();
        if input.is_terminal() {
            let mut modes = tcgetattr(&input)?;
            key.before = Some(modes.clone());
            modes.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
            tcsetattr(&input, OptionalActions::Now, &modes)?;
        }
        Ok(key)
    }

    /// Stops reading; the keys that were not counted.
    pub(crate) fn finish(mut self) -> Uncounted {
        self.ends.store(true, Ordering::Relaxed);
        self.thread.take().and_then(|thread| thread.join().ok()).unwrap_or_default()
    }
}

impl Drop for ScannerKey {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(before) = &self.before {
            // Nothing better can be done where even that fails.
            let _restored = tcsetattr(io::stdin(), OptionalActions::Now, before);
        }
    }
}

/// Reads the keys, and has another thread send them: an answer that is late does not make the time
/// of the next key late.
fn count_keys(rig: &RigName, client: u64, ends: &AtomicBool) -> Uncounted {
    let (typed, keys) = channel();
    std::thread::scope(|scope| {
        let sender = std::thread::Builder::new().name("scanner key sender".to_owned());
        // A link stays in the thread that made it.
        let sender = match sender.spawn_scoped(scope, move || send_keys(rig, client, &keys)) {
            Ok(sender) => sender,
            Err(error) => return Uncounted { keys: 0, reason: error.to_string() },
        };
        if read_keys(&typed, ends) {
            // Now, and not at the end: the scanner may just be about to start.
            eprintln!("--scanner-key: standard input was closed; no key is counted any more");
        }
        drop(typed);
        sender.join().unwrap_or_default()
    })
}

/// Reads standard input until `ends`, and hands over when each key was pressed (ns). Whether it
/// was closed before.
fn read_keys(typed: &Sender<u64>, ends: &AtomicBool) -> bool {
    let input = io::stdin();
    while !ends.load(Ordering::Relaxed) {
        let mut waiting = [PollFd::from_borrowed_fd(input.as_fd(), PollFlags::IN)];
        if !poll(&mut waiting, Some(&LOOK)).is_ok_and(|ready| ready > 0) {
            continue;
        }
        let at_ns = now_ns();
        let mut bytes = [0; 64];
        let read = match input.lock().read(&mut bytes) {
            Ok(0) | Err(_) => return true,
            Ok(read) => read,
        };
        for _ in bytes.iter().take(read).filter(|key| **key == KEY) {
            if typed.send(at_ns).is_err() {
                return false;
            }
        }
    }
    false
}

/// Sends the keys to the experiment process until there will be no more.
fn send_keys(rig: &RigName, client: u64, keys: &Receiver<u64>) -> Uncounted {
    let mut uncounted = Uncounted::default();
    let link = match RigLink::open(rig) {
        Ok(link) => link,
        Err(error) => {
            uncounted.reason = format!("the rig cannot be reached: {error}");
            return uncounted;
        }
    };
    while let Ok(at_ns) = keys.recv() {
        if let Err(reason) = send_key(&link, client, at_ns) {
            uncounted.keys += 1;
            uncounted.reason = reason;
        }
    }
    uncounted
}

/// Sends a key; while no process answers, again and again: the launcher starts it anew, and a key
/// that arrives twice is counted once.
fn send_key(link: &RigLink, client: u64, at_ns: u64) -> Result<(), String> {
    loop {
        match link.experiment(&ExperimentRequest::Pulse { client, at_ns }) {
            Ok(answer) if answer.error.is_empty() => return Ok(()),
            Ok(answer) => return Err(answer.error),
            Err(error) if now_ns().saturating_sub(at_ns) > AGAIN_NS => {
                return Err(error.to_string());
            }
            Err(_) => std::thread::sleep(AGAIN_AFTER),
        }
    }
}
