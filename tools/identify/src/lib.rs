//! Identifies a declared model from measured data and reports the effect that it lacks.
//!
//! Given a rig file (the declared model, its nominal values and tolerances) and measured records,
//! identify fits the declared parameters within their tolerances, adds listed effects by stepwise
//! selection, and reports the error before and after on rows that took no part in fitting or
//! selection. It may also report that nothing is missing, or that an unlisted effect is.
//!
//! The cores are pure functions on columns of numbers: [`models`] holds one file for each kind of
//! model behind [`models::Model`]; effects are the plant's, one file each ([`plant::effects`]).
//! Records are read in [`study::read`] and [`study::read_mapped`]; the
//! folder of a [`trend`] in its own module; all else is read and written in [`run`] only.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

// Records of the integration tests are made with the public interface.
#[cfg(test)]
extern crate self as identify;

mod args;
pub mod chosen_axis;
pub mod correlation;
pub mod deadline;
pub mod effects;
pub mod equation_error;
pub mod error;
pub mod estimate_correlation;
pub mod false_alarm;
pub mod filter;
pub mod input;
pub mod models;
mod naming;
pub mod outcome;
mod outcome_tables;
pub mod output_error;
pub mod prediction_error;
pub mod regression;
mod result_files;
mod run;
pub mod selection;
pub mod spectral;
pub mod study;
#[cfg(test)]
mod test_noise;
pub mod trend;
#[cfg(test)]
#[path = "../tests/two_sides/mod.rs"]
mod two_sides;
pub mod write_rig;

pub use args::Args;
pub use outcome_tables::short as four_digits;
pub use run::run;
