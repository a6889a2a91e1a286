//! `farreach bridge`: a running rig for other people's programs.
//!
//! ```text
//! $ farreach bridge foxglove
//! ws://127.0.0.1:8765
//! viewer 1 (127.0.0.1:50312) is there
//! viewer 1 (127.0.0.1:50312) left: 18201 messages sent, 0 lost before the bridge, 0 dropped
//!
//! $ farreach bridge lsl
//! farreach.sample: 12 channels, 2000 Hz
//! farreach.markers: markers
//! ```
//!
//! A bridge is a probe: it subscribes, publishes nothing, and ends when the rig goes down. Whoever
//! is slow or vanishes at its other end loses messages, which are counted; the rig never waits.
#![deny(unsafe_code)]

/// Says something on standard error. Whoever has closed it is not told, and nothing else ends.
macro_rules! say {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _closed = writeln!(std::io::stderr(), $($words)*);
    }};
}

mod args;
mod foxglove;
mod lsl;

use std::io::Write;
use std::sync::{Mutex, MutexGuard, PoisonError};

use runtime::RigName;
use runtime::clock::MILLISECOND_NS;

pub use args::{Command, FoxgloveArgs, LslArgs};

/// Polling period; the subscribers' buffers hold at least 100 ms (ns).
const PERIOD_NS: u64 = 10 * MILLISECOND_NS;

/// Runs a bridge until a signal ends it; returns the exit code.
///
/// # Errors
/// If the rig does not exist or has gone down, a topic is not known, the address is taken, or a
/// library is not installed.
pub fn run(command: &Command, rig: &RigName) -> anyhow::Result<i32> {
    run_to(command, rig, &mut std::io::stdout().lock())
}

/// Runs a bridge and prints its address to `out`.
///
/// # Errors
/// As [`run`].
pub fn run_to(command: &Command, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<i32> {
    match command {
        Command::Foxglove(args) => foxglove::run(args, rig, out),
        Command::Lsl(args) => lsl::run(args, rig, out),
    }
}

/// Reads a text as a viewer's request and says what is asked for; for the fuzz targets.
///
/// # Errors
/// What is wrong with it.
#[doc(hidden)]
pub fn check_request(text: &str) -> Result<String, String> {
    foxglove::protocol::parse(text).map(|request| format!("{request:?}"))
}

/// Locks; every value is set at once, so what a thread that panicked left behind is still whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
