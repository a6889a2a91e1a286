//! The safety watchdog: interlocks and the enable line.
//!
//! [`interlock`] is the pure state machine; [`run`] the loop around it. The command thread does
//! what is slow: it serves the operator's commands, follows launcher and keeper, and reaches the
//! loop through queues that never block. [`enable_output`] is the line itself, where a real card is
//! wired to this process.

mod clock_of_day;
mod command_thread;
mod doctor_gate;
pub mod enable_output;
pub mod interlock;
mod logger_watch;
mod process;
mod since;
mod verb_exchange;

/// What the hand-offs between threads are made of; `tests/interleavings` compiles them with loom's.
mod sync {
    pub(crate) use std::sync::atomic::{AtomicU64, Ordering};

    pub(crate) use crossbeam_queue::ArrayQueue;
}

pub use process::{WatchdogError, run};
