//! State of a learner between two blocks, with which another process continues.

use serde::{Deserialize, Serialize};

use crate::{Frozen, Learner, LearnerConfig, LearningError};

/// State of a learner between two blocks. A learner restored from it with the same configuration
/// continues identically.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LearnerState {
    /// Number of finished blocks.
    pub blocks: usize,
    /// The current reference (rad or m).
    pub reference: Vec<f64>,
    /// Error and reference of the best block (rad or m).
    pub best: Option<(f64, Vec<f64>)>,
    /// Number of consecutive worse blocks.
    pub worse: usize,
    /// The published law's filtered and advanced error of the previous block (rad or m).
    pub previous_error: Option<Vec<f64>>,
    /// Why learning ended, if it did.
    pub frozen: Option<Frozen>,
}

impl Learner {
    /// Returns the state; call it between two blocks.
    pub fn state(&self) -> LearnerState {
        self.state.clone()
    }

    /// Restores a learner from the state of another one with the same movement and configuration.
    ///
    /// # Errors
    /// [`LearningError`], also if a saved cycle differs in length from the movement or is not
    /// finite.
    pub fn restore(
        desired: &[f64],
        state: LearnerState,
        config: LearnerConfig,
    ) -> Result<Self, LearningError> {
        let learner = Self::from_reference(desired, &state.reference, config)?;
        let mut cycles = state.best.iter().map(|best| &best.1).chain(&state.previous_error);
        let fits = |cycle: &Vec<f64>| {
            cycle.len() == desired.len() && cycle.iter().all(|value| value.is_finite())
        };
        if !cycles.all(fits) {
            let found = "a saved cycle that does not fit the movement".to_owned();
            return Err(LearningError::Desired { found });
        }
        Ok(Self { state, ..learner })
    }
}
