//! Redraws the thesis's figures from the models, beside the published values.
//!
//! ```text
//! $ farreach figures --out figures
//! The printed constants peak at 30.2 Hz; the rig peaked at 8 Hz. A line 14.1 times softer ...
//! Fitted to that one number, it predicts a cut-off of 13.3 Hz (measured 12), a lag of 34.5 ms ...
//!   yes  The printed constants cannot give the measured resonance of 8 Hz.
//!   ...
//!   no   With the softening fitted to the resonance, the measured lag at 1 Hz is predicted ...
//! page: /home/lab/figures/index.html
//! ```
//!
//! - [`published`] is the table of published values, [`table_row`] one line of the comparison;
//! - [`simulated_line`] is the simulated line, [`simulated_response`] finds its peak, cut-off or
//!   cycle;
//! - [`calibration`] fits one softening to one measured number and predicts everything else, over
//!   all that the thesis leaves open, and compares it with alternative explanations;
//! - [`guided`] compares the laws of position control on the lock-step rig (§ 4.1);
//! - [`mod@learning`] runs iterative learning control on the lock-step rig (§ 4.3);
//! - [`plots`] draws the figures, [`study`] computes everything, [`page`] shows it.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

mod args;
pub mod calibration;
mod folder;
pub mod guided;
pub mod learning;
pub mod linear_response;
mod measured;
pub mod page;
pub mod plots;
pub mod published;
pub mod quasi_static;
mod run;
pub mod simulated_line;
pub mod simulated_response;
pub mod study;
pub mod table_row;

pub use args::Args;
pub use run::run;
