//! What the demo did.

use crate::IdentifyResult;
use crate::analysis::Kill;
use crate::closed_loop::ClosedLoop;

/// What the demo did, beside what is in its first recording.
#[derive(Debug)]
pub struct Run {
    /// The processes that were killed.
    pub kills: Vec<Kill>,
    /// The effect that was hidden (`ID@SITE=SIZE`).
    pub hidden: Option<String>,
    /// What identify says of the excitation.
    pub identified: IdentifyResult,
    /// What was tuned, and what it gained.
    pub closed_loop: ClosedLoop,
}
