//! Search result of a model with one measured channel.

use crate::equation_error::block_roles::{Block, Role};
use crate::equation_error::signals::ForceBalance;
use crate::selection::predictor::Predictor;
use crate::selection::search::SearchResult;

/// A model, its records and the search result.
pub(super) struct Study<'a> {
    /// Declared model and records.
    pub(super) predictor: Predictor<'a>,
    /// Rows by role.
    pub(super) blocks: Vec<Block>,
    /// What the search found.
    pub(super) found: SearchResult<'a>,
    /// Column of the measured channel.
    pub(super) channel: &'static str,
    /// Notes on the data.
    pub(super) notes: Vec<String>,
    /// Whether the deadline ended the search.
    pub(super) early: bool,
}

/// All rows of a record as one block.
pub(super) fn all_rows(record: usize, balance: &ForceBalance) -> Block {
    Block { record, rows: 0..balance.rows(), role: Role::Fit }
}
