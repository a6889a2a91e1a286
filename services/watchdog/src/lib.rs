//! The safety watchdog: interlocks and the enable line.
//!
//! [`machine`] is the pure state machine; [`run`] the loop around it. What is slow (the operator's
//! verbs, looking after launcher and keeper) is a thread of its own and reaches the loop through
//! queues that never block.

mod attendant;
pub mod machine;
mod process;

pub use process::{Options, WatchdogError, axis_limits, run};
