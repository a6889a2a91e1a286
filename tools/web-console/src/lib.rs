//! The console: pages for the operator and for the subject, served to browsers.
//!
//! ```text
//! $ farreach up --simulate --console --record /data/S07.mcap
//! $ farreach console
//! operator  http://127.0.0.1:8321/#token=6f1c…
//! subject   http://127.0.0.1:8321/subject
//! ```
//!
//! The operator's page sets a protocol up, homes the rig, starts and stops, and shows interlocks,
//! scanner, sessions, losses and live signals. The subject's page shows bars, light and an
//! instruction. Whoever reaches the address may watch; whoever shows the token may stop the rig;
//! one page at a time has control.
//!
//! The process is a client of the rig like the command line: it asks the watchdog, the logger and
//! the experiment process, and reads topics. The rig does not depend on it, and a console that is
//! killed goes on with the experiment that it plays when it is started again.
//!
//! | thread | what it does |
//! |---|---|
//! | main | reads topics, tells the pages, publishes the console's events |
//! | web | serves pages and WebSockets |
//! | power | emergency stop and disarm, which wait for nothing else |
//! | stop | the end of a movement, which waits for the experiment process alone |
//! | commands | what may take its time |
//! | runner | plays protocols |
//! | sessions | reads the list of sessions from the recording |
//! | status | asks for processes, rates and losses once a second |
#![forbid(unsafe_code)]

mod access;
mod actions;
mod board;
mod commands;
mod desk;
mod host_check;
mod page_clock;
mod page_link;
mod plot_batch;
mod process;
mod request;
mod rig_view;
mod run_state;
mod runner;
mod session_list;
mod subject_view;
mod web;

use std::sync::{Mutex, MutexGuard, PoisonError};

pub use host_check::{computer_name, is_own_host, without_port};
pub use process::{ConsoleError, run};

/// Reads a text as a message of a page and returns its number; nothing is done.
///
/// # Errors
/// The number, 0 where it has none, and what is wrong, in words.
pub fn check_message(text: &str) -> Result<u64, (u64, String)> {
    request::parse(text).map(|message| message.id)
}

/// Reads a text as the state that a console keeps, and returns it as it is written; for the fuzz
/// targets.
///
/// # Errors
/// What is wrong with it.
#[doc(hidden)]
pub fn check_state(text: &[u8]) -> serde_json::Result<String> {
    run_state::RunState::of(text).and_then(|state| serde_json::to_string(&state))
}

/// Locks; what a thread that panicked left behind is still whole, as every value is set at once.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
