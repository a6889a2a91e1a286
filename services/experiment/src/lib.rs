//! The experiment runner: plays protocols as setpoints.
//!
//! Its core knows no clock: [`trajectory`] gives movements with exact derivatives, [`player`] plays
//! a protocol in a time that is an argument, [`lesson`] and [`teacher`] let a segment's reference
//! be learnt, [`range`] finds the ends of an axis, [`state`] is what is kept to go on after a
//! restart. The process around it is [`run`].

mod field;
pub mod lesson;
pub mod player;
mod process;
pub mod range;
pub mod state;
pub mod teacher;
pub mod trajectory;

pub use process::{ExperimentError, Options, Runner, run};
