//! The jobs that the player has for the worker thread of iterative learning.

use std::sync::Arc;

use super::Program;
use crate::ilc_trial::{IlcTrials, Returned};

/// A job for the worker thread.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "a box would be made in the real-time loop")]
pub enum IlcJob {
    /// A segment begins in which something is learnt: the worker answers with `IlcResult::Ready`
    /// or `IlcResult::Failed`.
    Begin {
        /// Number of the learning run.
        run_id: u32,
        /// The program, and its segment.
        program: Arc<Program>,
        /// Index of the segment.
        segment: u32,
        /// Whether it goes on where it was interrupted.
        resumed: bool,
    },
    /// A record to learn from, or a reference that is no longer followed.
    Returned(Returned),
    /// The learning run is over, complete or stopped; carries all the memory that it still holds.
    End(IlcTrials),
}

/// Most jobs that may wait to be fetched.
pub(super) const JOBS: usize = 32;
