//! What a learner knows between two blocks, to go on in another process.

use serde::{Deserialize, Serialize};

use crate::{Best, Frozen, Learner, LearnerConfig, LearningError, Rule};

/// What a learner knows between two blocks; with the same settings it goes on as if nothing had
/// been.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// Blocks that are done.
    pub blocks: usize,
    /// The reference in use (rad or m).
    pub reference: Vec<f64>,
    /// The best block's error (rad or m) and reference (rad or m).
    pub best: Option<(f64, Vec<f64>)>,
    /// Worse blocks in a row.
    pub worse: usize,
    /// The published law's: filtered and shifted error of the block before (rad or m).
    pub before: Option<Vec<f64>>,
    /// Why learning ended, if it did.
    pub frozen: Option<Frozen>,
}

impl Learner {
    /// What to keep; to be taken between two blocks.
    pub fn memory(&self) -> Memory {
        let before = match &self.rule {
            Rule::Published(rule) => rule.before().cloned(),
            Rule::ModelBased(_) => None,
        };
        Memory {
            blocks: self.blocks,
            reference: self.reference.clone(),
            best: self.best.as_ref().map(|best| (best.error, best.reference.clone())),
            worse: self.worse,
            before,
            frozen: self.frozen,
        }
    }

    /// A learner that goes on from what another one knew, with the same movement and settings.
    ///
    /// # Errors
    /// [`LearningError`], also where a kept cycle is of another length than the movement or not
    /// finite.
    pub fn recall(
        desired: &[f64],
        memory: Memory,
        config: LearnerConfig,
    ) -> Result<Self, LearningError> {
        let mut learner = Self::from_reference(desired, &memory.reference, config)?;
        let cycles = memory.best.iter().map(|best| &best.1).chain(&memory.before);
        for cycle in cycles {
            if cycle.len() != desired.len() || !cycle.iter().all(|value| value.is_finite()) {
                return Err(LearningError::Desired {
                    found: "a kept cycle that does not fit the movement".to_owned(),
                });
            }
        }
        learner.blocks = memory.blocks;
        learner.best = memory.best.map(|(error, reference)| Best { error, reference });
        learner.worse = memory.worse;
        learner.frozen = memory.frozen;
        if let Rule::Published(rule) = &mut learner.rule {
            rule.remember(memory.before);
        }
        Ok(learner)
    }
}
