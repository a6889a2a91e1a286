//! How the error of a model with one measured channel is formed.

use nalgebra::DVector;

use crate::equation_error::block_roles::Block;
use crate::equation_error::fit::ShapeSearch;
use crate::equation_error::model::{Fitted, RegressionModel, Structure};
use crate::output_error::fit::OutputErrorModel;

/// A declared model with its records.
pub enum Predictor<'a> {
    /// The error is that of the force which the measured motion needs.
    EquationError(&'a RegressionModel),
    /// The error is that of the output which is simulated from the input alone.
    OutputError(OutputErrorModel<'a>),
}

impl Predictor<'_> {
    /// The declared model, and its records for the equation error.
    pub const fn regression(&self) -> &RegressionModel {
        match self {
            Self::EquationError(regression) => regression,
            Self::OutputError(simulation) => simulation.regression,
        }
    }

    /// The measured channel of a record, by row.
    pub fn measured(&self, record: usize) -> &[f64] {
        match self {
            Self::EquationError(regression) => &regression.balances[record].force,
            Self::OutputError(simulation) => &simulation.records[record].output,
        }
    }

    /// Unit of the measured channel.
    pub const fn unit(&self) -> &'static str {
        match self {
            Self::EquationError(regression) => regression.axis.units.force,
            Self::OutputError(simulation) => simulation.regression.axis.units.position,
        }
    }

    /// Measured less predicted, over the rows of a block.
    pub fn residual(&self, fitted: &Fitted, block: &Block) -> Vec<f64> {
        match self {
            Self::EquationError(regression) => regression.residual(fitted, block),
            Self::OutputError(simulation) => simulation.residual(&fitted.outputs, block),
        }
    }

    /// Mean squared residual of each block.
    pub fn mean_squares(&self, fitted: &Fitted, blocks: &[Block]) -> Vec<f64> {
        let mean = |e: Vec<f64>| e.iter().map(|e| e * e).sum::<f64>() / e.len().max(1) as f64;
        blocks.iter().map(|block| mean(self.residual(fitted, block))).collect()
    }

    /// The residual over the rows of a block, 0 in those in which the machine stands still if dry
    /// friction is in the structure, and the number of the others: at rest dry friction takes any
    /// value below its limit, and what explains a force there explains nothing.
    pub fn moving_residual(
        &self,
        structure: &Structure<'_>,
        fitted: &Fitted,
        block: &Block,
    ) -> (Vec<f64>, usize) {
        let mut residual = self.residual(fitted, block);
        let mut rows = residual.len();
        let at_rest = self.at_rest(structure, block).unwrap_or_default();
        for (row, _) in at_rest.iter().enumerate().filter(|(_, at_rest)| **at_rest) {
            residual[row] = 0.0;
            rows -= 1;
        }
        (residual, rows)
    }

    /// As [`Self::mean_squares`], over the moving rows ([`Self::moving_residual`]).
    pub fn moving_mean_squares(
        &self,
        structure: &Structure<'_>,
        fitted: &Fitted,
        blocks: &[Block],
    ) -> Vec<f64> {
        let of = |block: &Block| {
            let (residual, rows) = self.moving_residual(structure, fitted, block);
            residual.iter().map(|e| e * e).sum::<f64>() / rows.max(1) as f64
        };
        blocks.iter().map(of).collect()
    }

    /// Root mean square of the residual over some blocks, and of the channel over the same rows.
    pub fn error(&self, fitted: &Fitted, blocks: &[Block]) -> (f64, f64) {
        let squares = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
        let (mut e, mut y, mut n) = (0.0, 0.0, 0usize);
        for block in blocks {
            let residual = self.residual(fitted, block);
            // The order of the sum differs between the two; published errors depend on it in their
            // last bit.
            e += match self {
                Self::EquationError(_) => DVector::from_vec(residual).norm_squared(),
                Self::OutputError(_) => squares(&residual),
            };
            y += squares(&self.measured(block.record)[block.rows.clone()]);
            n += block.rows.len();
        }
        ((e / n.max(1) as f64).sqrt(), (y / n.max(1) as f64).sqrt())
    }

    /// Mean square of the error that noise of the measured position leaves, over some blocks; 0
    /// where the output is simulated.
    pub fn noise_square(
        &self,
        structure: &Structure<'_>,
        fitted: &Fitted,
        blocks: &[Block],
    ) -> f64 {
        match self {
            Self::EquationError(regression) => regression.noise_square(structure, fitted, blocks),
            Self::OutputError(_) => 0.0,
        }
    }

    /// Whether the machine stands still, by row; `None` where that does not matter: without dry
    /// friction, and where the output is simulated.
    pub fn at_rest(&self, structure: &Structure<'_>, block: &Block) -> Option<Vec<bool>> {
        match self {
            Self::EquationError(regression) if regression.uses_sign(structure) => {
                Some(regression.at_rest(block))
            }
            _ => None,
        }
    }

    /// Fits a structure to blocks, starting from a fit. The terms with the indices `without` stay
    /// at 0, where the output is simulated.
    pub fn refit(
        &self,
        structure: &Structure<'_>,
        blocks: &[Block],
        start: &Fitted,
        without: &[usize],
    ) -> Option<Fitted> {
        match self {
            Self::EquationError(regression) => {
                regression.fit(structure, blocks, &start.shapes, ShapeSearch::Refine)
            }
            Self::OutputError(simulation) => simulation.fit(structure, blocks, start, without),
        }
    }
}
