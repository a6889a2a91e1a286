//! State of a learner between two blocks, with which another process continues.

use serde::{Deserialize, Serialize};

use crate::{Best, Frozen, Learner, LearnerConfig, LearningError, Rule};

/// State of a learner between two blocks. A learner restored from it with the same configuration
/// continues identically.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
        let previous_error = match &self.rule {
            Rule::Published(rule) => rule.previous_error().cloned(),
            Rule::ModelBased(_) => None,
        };
        LearnerState {
            blocks: self.blocks,
            reference: self.reference.clone(),
            best: self.best.as_ref().map(|best| (best.error, best.reference.clone())),
            worse: self.worse,
            previous_error,
            frozen: self.frozen,
        }
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
        let mut learner = Self::from_reference(desired, &state.reference, config)?;
        let cycles = state.best.iter().map(|best| &best.1).chain(&state.previous_error);
        for cycle in cycles {
            if cycle.len() != desired.len() || !cycle.iter().all(|value| value.is_finite()) {
                return Err(LearningError::Desired {
                    found: "a saved cycle that does not fit the movement".to_owned(),
                });
            }
        }
        learner.blocks = state.blocks;
        learner.best = state.best.map(|(error, reference)| Best { error, reference });
        learner.worse = state.worse;
        learner.frozen = state.frozen;
        if let Rule::Published(rule) = &mut learner.rule {
            rule.restore(state.previous_error);
        }
        Ok(learner)
    }
}
