//! Redraws the thesis's figures from the models, beside the published values.
//!
//! ```text
//! $ farreach figures --out figures
//! OUTPUT
//! ```
//!
//! - [`published`] is the table of what the thesis says, [`row`] one line of the comparison;
//! - [`line`] is what is simulated, [`measure`] how a peak, a cut-off or a cycle is read off it;
//! - [`tracing`] closes the loop: one softening fitted to one measured number, everything else predicted, over all that the
//!   thesis leaves open, and against other explanations;
//! - [`drawn`] holds the figures, [`study`] computes all of it, [`page`] shows it.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

mod args;
pub mod drawn;
mod error;
mod folder;
pub mod line;
pub mod linear;
pub mod measure;
pub mod page;
pub mod published;
pub mod row;
mod run;
pub mod slow;
pub mod study;
pub mod tracing;

pub use args::Args;
pub use error::{FiguresError, Result};
pub use run::run;
