//! The safety watchdog: interlocks and the enable line.
//!
//! [`interlock`] is the pure state machine; [`run`] the loop around it. The command thread does
//! what is slow: it serves the operator's commands, follows launcher and keeper, and reaches the
//! loop through queues that never block.

mod clock_of_day;
mod command_thread;
pub mod interlock;
mod logger_watch;
mod process;
mod since;
mod verb_exchange;

pub use process::{WatchdogError, run};
