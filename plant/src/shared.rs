//! The step of a transmission, cut in two where its slave moves: for a handle that several
//! transmissions share.

use crate::friction::{Advance, Load};
use crate::transmission::Input;

/// A transmission whose slave somebody else moves in the middle of each internal step.
pub(crate) trait Shared {
    /// An internal step in which the master has moved and the slave has not.
    type Stage;

    /// Moves the master over an internal step, and says what acts on the slave.
    fn begin(&mut self, input: Input, step_s: f64) -> (Self::Stage, Load);

    /// Moves everything else, once it is known what the slave did.
    fn complete(&mut self, stage: Self::Stage, slave: Advance);

    /// Lets the instruments look, after the last internal step.
    fn observe(&mut self, input: Input);

    /// Longest internal step (s).
    fn longest_step_s(&self) -> f64;

    /// Inertia of the slave by itself, effects included (kg·m²).
    fn slave_inertia_kg_m2(&self) -> f64;
}
