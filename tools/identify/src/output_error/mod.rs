//! Output-error method: models simulated from their input alone and fitted to the measured output.
//!
//! For machines with a spring, whose initial state decays. The equations are those of
//! [`crate::equation_error`]; here they are integrated, so that output noise is not differentiated.

pub mod fit;
pub mod simulation;
