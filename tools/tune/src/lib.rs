//! `farreach tune`: a rig that tunes its control.
//!
//! The cores are pure: [`tracking`] measures how a handle follows, [`proposal`] chooses the options
//! of the control by simulation with the model that was identified ([`simulated`]), among the
//! [`settings`]. [`live`] plays and records on a rig that is up, and [`run`] is the command line.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod live;
mod page;
pub mod proposal;
mod protocols;
pub mod recorded;
mod run;
pub mod settings;
pub mod simulated;
pub mod since;
pub mod tracking;
mod tuning;

pub use page::section;
pub use protocols::Protocols;
pub use run::{Args, run};
pub use tuning::{Tuning, TuningSummary};
