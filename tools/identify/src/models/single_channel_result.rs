//! Search result of a model with one measured channel.

use crate::correlation::TestedResidual;
use crate::equation_error::block_roles::{Block, Role, blocks_of_role};
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

/// The residual of the final model on the reporting rows, with the input of an oscillator or the
/// speed of a drive or element along it. Rows are taken one period of the cut-off apart: a low-pass
/// correlates nearer ones.
pub(super) fn tested(study: &Study<'_>) -> TestedResidual {
    let mut tested = TestedResidual::default();
    let (mut name, mut along) = ("", Vec::new());
    for block in blocks_of_role(&study.blocks, Role::Report) {
        let balance = &study.predictor.regression().balances[block.record];
        let step_s = balance.row_step();
        let (input, every);
        (name, input, every) = match &study.predictor {
            Predictor::EquationError(_) => (
                "velocity",
                balance.signals.rows(&balance.signals.velocity),
                (1.0 / balance.cut_off / step_s).ceil().max(1.0) as usize,
            ),
            Predictor::OutputError(_) => ("input", balance.force.clone(), 1),
        };
        let thinned = |rows: &[f64]| rows.iter().step_by(every).copied().collect::<Vec<f64>>();
        tested.step_s = step_s * every as f64;
        let residual = study.predictor.residual(&study.found.last().fitted, &block);
        tested.residual.push(thinned(&residual));
        along.push(thinned(input.get(block.rows.clone()).unwrap_or_default()));
    }
    tested.inputs = vec![(name, along)];
    tested
}

/// All rows of a record as one block.
pub(super) fn all_rows(record: usize, balance: &ForceBalance) -> Block {
    Block { record, rows: 0..balance.rows(), role: Role::Fit }
}
