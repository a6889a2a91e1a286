//! The experiment runner: plays protocols as setpoints.
//!
//! Its core has no clock of its own: [`prepared_movement`] gives movements with exact derivatives,
//! [`player`] plays a protocol with the time as an argument, [`ilc_trial`] and [`ilc_update`] learn
//! a segment's reference, [`range_finder`] finds the ends of an axis's travel, [`scan_tracker`]
//! follows the scanner, and [`state`] is what a restart needs. [`run`] is the process around it.

mod field_setpoint;
pub mod ilc_trial;
pub mod ilc_update;
pub mod player;
pub mod prepared_movement;
mod process;
pub mod range_finder;
pub mod scan_tracker;
pub mod state;
pub mod trial_record;
pub mod trial_schedule;

pub use process::{ExperimentError, Runner, run};
