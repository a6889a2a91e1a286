//! Output-error method: the model is simulated from its input alone and fitted to the measured
//! output.
//!
//! It is used for machines with a spring, in which an error of the initial state decays. The
//! equations are those of [`crate::equation_error`], but integrated, so that output noise is not
//! differentiated.

pub mod fit;
pub mod simulation;
