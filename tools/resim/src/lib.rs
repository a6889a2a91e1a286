//! Runs the cores of a rig's processes again on the inputs of a recording, and compares what comes
//! out with what was recorded, bit for bit.
//!
//! The cores are pure: time and messages are arguments, and each message names what it was computed
//! from. Covered are
//!
//! - **control**: the law ([`control::cycle`]), every field of each command that it computes;
//! - **gate** ([`runtime::gate`]), every field of each sample that it writes;
//! - **watchdog** ([`watchdog::interlock`]), every field of each token that it computes, and the
//!   enable line;
//! - **experiment**: the player ([`experiment::cycle`]) and its learning, every field of each
//!   setpoint that it computes.
//!
//! Not covered are the conversion of scans to samples, the validation of setpoints (which one
//! control held is an input), whether launcher, keeper and logger lived (the token tells it), and
//! what is in files that a protocol goes on from: a reference that was learnt before, and the
//! scanner as it was followed before an interruption.
//!
//! A process is run again from its start on, where that is recorded. Of those that began before,
//! or of which messages are missing, the law is run again from a stretch without power on (see
//! [`Report`]'s `begins`), the gate from the next time that it opens, the player from the next
//! protocol on, the watchdog not at all.

mod control_replay;
mod convergence;
mod difference;
mod experiment_replay;
mod gate_replay;
mod history;
mod learning_replay;
mod other_gains;
mod read;
mod replay;
mod report;
mod rigs;
mod runs;
mod used;
mod watchdog_replay;

pub use difference::FieldDifference;
pub use history::Recorded;
pub use read::{Error, read};
pub use replay::{Foreign, OtherAxes, Replay};
pub use report::{
    Begin, CoreReport, Difference, NotCompared, OtherGains, Report, Trip, Used, VoltsDifference,
};
pub use rigs::Rigs;
pub use runs::Runs;
