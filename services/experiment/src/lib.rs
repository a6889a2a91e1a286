//! The experiment runner: plays protocols as setpoints.
//!
//! Its core knows no clock: [`trajectory`] gives movements with exact derivatives, [`player`] plays
//! a protocol in a time that is an argument, [`ilc_trial`] and [`ilc_update`] let a
//! segment's reference be learnt, [`range_finder`] finds the ends of an axis, [`state`]
//! is what is kept for a restart. The process around it is [`run`].

mod field;
pub mod ilc_trial;
pub mod ilc_update;
pub mod player;
mod process;
pub mod range_finder;
pub mod state;
pub mod trajectory;
pub mod trial_record;
pub mod trial_schedule;

pub use process::{ExperimentError, Options, Runner, run};
