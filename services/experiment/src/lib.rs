//! The experiment runner: plays protocols as setpoints.
//!
//! Its core has no clock of its own: [`prepared_movement`] gives movements with exact derivatives,
//! [`player`] plays a protocol with the time as an argument, [`cycle`] is what its loop does with
//! what it receives, [`ilc_trial`] and [`ilc_update`] learn a segment's reference,
//! [`range_finder`] finds the ends of an axis's travel, [`scan_tracker`] follows the scanner by a
//! [`scan_plan`], [`session_tracker`] the sessions with their sums of effort and the subject's bar
//! ([`matching_bar`]), and [`state`] is what a restart needs, [`interrupted`] what a start of the
//! whole computer needs. [`run`] is the process around it.

pub mod contraction;
pub mod cycle;
mod field_setpoint;
pub mod ilc_trial;
pub mod ilc_update;
pub mod interrupted;
pub mod matching_bar;
pub mod player;
pub mod prepared_movement;
mod process;
pub mod range_finder;
pub mod scan_plan;
mod scan_report;
pub mod scan_tracker;
pub mod session_state;
pub mod session_tracker;
pub mod state;
pub mod trial_record;
pub mod trial_schedule;

/// What the hand-offs between threads are made of; `tests/interleavings` compiles them with loom's.
mod sync {
    pub(crate) use std::sync::atomic::{AtomicU64, Ordering};
}

pub use process::{ExperimentError, Runner, run};
