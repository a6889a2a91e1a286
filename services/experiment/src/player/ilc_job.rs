//! Jobs for the worker thread of iterative learning.

use std::sync::Arc;

use super::Program;
use crate::ilc_trial::{IlcTrials, Returned};

/// A job for the worker thread.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "a box would be made in the real-time loop")]
pub enum IlcJob {
    /// A learning segment begins; the worker answers with `IlcOutcome::Ready` or
    /// `IlcOutcome::Failed`.
    Begin {
        /// Number of the learning run.
        run_id: u32,
        /// The program.
        program: Arc<Program>,
        /// Index of the segment.
        segment: u32,
        /// Whether it continues an interrupted run.
        resumed: bool,
    },
    /// A record to learn from, or a reference that is no longer used.
    Returned(Returned),
    /// The learning run is complete or stopped; returns all memory that it still holds.
    End(IlcTrials),
}

/// Capacity for jobs that wait to be fetched.
pub(super) const JOBS: usize = 32;
