//! Models simulated from their input alone, and fitted by what their output lacks.
//!
//! For a machine with a spring, whose motion forgets where it began. The equations are those that
//! [`crate::equation_error`] reads inversely; here they are integrated, so that noise of the output is not
//! differentiated and the error is that of a prediction.

pub mod fit;
pub mod simulation;
