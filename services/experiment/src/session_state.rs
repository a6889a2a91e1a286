//! What passes from session to session: the target, and the values that a rest repeats.

use ipc_types::BARS;
use serde::{Deserialize, Serialize};

use crate::contraction::Maxima;
use crate::matching_bar::heights;

/// Most updates of the bar that are kept of a session; the longest session has as many.
pub const UPDATES: usize = 1200;

/// The sessions of a protocol so far; kept on disk for a restart.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SessionState {
    /// Number of the last session that ran to its end; 0 before.
    pub over: u32,
    /// What the next session has to match; 0 where there is no target.
    pub target: [f64; BARS],
    /// What the last session had to match, or, for the first, its own mean.
    pub repeated_target: [f64; BARS],
    /// The values of the bar in the session that runs or ran last.
    pub values: Vec<[f64; BARS]>,
    /// The maxima of the electrodes in the contractions so far.
    pub maxima: Maxima,
}

/// A step of a session.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SessionStep {
    /// A session begins.
    Begun,
    /// The bar was updated.
    Update([f64; BARS]),
    /// The session of that number is over, with the value that the next has to match.
    Over(u32, [f64; BARS]),
    /// A contraction had these maxima.
    Contracted(Maxima),
}

impl SessionState {
    /// No session yet, with memory for the values of one.
    pub fn with_capacity() -> Self {
        Self { values: Vec::with_capacity(UPDATES), ..Self::default() }
    }

    /// Takes over the contents of another without giving up its own memory.
    pub fn copy_from(&mut self, other: &Self) {
        self.values.clear();
        self.values.extend(other.values.iter().take(UPDATES));
        (self.over, self.target, self.repeated_target, self.maxima) =
            (other.over, other.target, other.repeated_target, other.maxima);
    }

    /// Carries out a step. Within [`SessionState::with_capacity`] it does not allocate.
    pub fn take(&mut self, step: SessionStep) {
        match step {
            SessionStep::Begun => self.values.clear(),
            SessionStep::Update(values) if self.values.len() < UPDATES => self.values.push(values),
            SessionStep::Update(_) => {}
            SessionStep::Over(number, mean) => {
                self.repeated_target = if self.has_target() { self.target } else { mean };
                self.target = mean;
                self.over = number;
            }
            SessionStep::Contracted(maxima) => {
                for (largest, maximum) in self.maxima.iter_mut().zip(maxima) {
                    *largest = largest.max(maximum);
                }
            }
        }
    }

    /// Whether the next session has something to match: it is not the first.
    pub const fn has_target(&self) -> bool {
        self.over > 0
    }

    /// The values at an update of a rest, from 0, with the heights of the bars; `None` once the
    /// rest has shown all.
    pub fn repeated(&self, update: usize) -> Option<([f64; BARS], [f64; BARS])> {
        let values = *self.values.get(update)?;
        Some((values, heights(values, self.repeated_target)))
    }
}
