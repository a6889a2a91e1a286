//! Search result of an equation-error model, and its error.

use nalgebra::DVector;

use crate::equation_error::block_roles::Block;
use crate::equation_error::model::{Fitted, RegressionModel};
use crate::equation_error::search::SearchResult;

/// A model, its prepared records and the search result.
pub(super) struct Study {
    /// Declared model and prepared records.
    pub(super) regression: RegressionModel,
    /// Rows by role.
    pub(super) blocks: Vec<Block>,
    /// What the search found.
    pub(super) found: SearchResult,
    /// Column of the force.
    pub(super) channel: &'static str,
    /// Notes on the data.
    pub(super) notes: Vec<String>,
}

/// Root mean square of the residual over some blocks, and of the force over the same rows.
pub(super) fn error(regression: &RegressionModel, fitted: &Fitted, blocks: &[Block]) -> (f64, f64) {
    let (mut e, mut f, mut n) = (0.0, 0.0, 0usize);
    for block in blocks {
        e += DVector::from_vec(regression.residual(fitted, block)).norm_squared();
        f += regression.balances[block.record].force[block.rows.clone()]
            .iter()
            .map(|f| f * f)
            .sum::<f64>();
        n += block.rows.len();
    }
    ((e / n.max(1) as f64).sqrt(), (f / n.max(1) as f64).sqrt())
}
