//! The declared parameters within their tolerances, followed as the machine warms up and wears.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::bank::CHANNELS;
use crate::sums::Sums;

/// Rows of innovations are this much less informative than independent ones: an innovation lasts
/// for as long as the observer takes to follow.
pub const ROWS_PER_INDEPENDENT: f64 = 10.0;

/// Estimates by how much the parameters are off their declared values, in tolerances: recursive
/// least squares with a tolerance as the standard deviation of the prior, and a memory.
#[derive(Clone, Debug)]
pub struct Calibration {
    sums: Sums,
    forgetting: f64,
    shares: DVector<f64>,
}

impl Calibration {
    /// For the first `parameters` of so many `directions`; what is older than `memory` blocks
    /// fades.
    pub fn new(parameters: usize, directions: usize, memory: f64) -> Self {
        Self {
            sums: Sums::new(directions),
            forgetting: (-1.0 / memory).exp(),
            shares: DVector::zeros(parameters),
        }
    }

    /// Deviations of the parameters from their declared values, in tolerances.
    pub const fn shares(&self) -> &DVector<f64> {
        &self.shares
    }

    /// Takes a block, with the standard deviations of the innovation (rad).
    pub fn take(&mut self, block: &Sums, deviations: [f64; CHANNELS]) {
        self.sums.scale(self.forgetting);
        self.sums.add_sums(block);
        let weights = weights(deviations);
        if let Some(normal) = normal(&self.sums, self.shares.len(), weights, 1.0) {
            let with = DVector::from_fn(self.shares.len(), |at, _| self.sums.with(at, weights));
            self.shares = normal.solve(&with);
        }
    }
}

/// Below this a channel does not change: it is not observed (rad).
const UNOBSERVED_RAD: f64 = 1e-9;

/// Weights of the channels with these standard deviations (rad); none of one that is not observed.
pub fn weights(deviations: [f64; CHANNELS]) -> [f64; CHANNELS] {
    let weight = |own: f64| 1.0 / (ROWS_PER_INDEPENDENT * own * own);
    deviations.map(|own| if own > UNOBSERVED_RAD { weight(own) } else { 0.0 })
}

/// Factors of the normal equations of the first `parameters` directions, each with this precision
/// beforehand (per square tolerance); `None` where sums are not finite.
pub fn normal(
    sums: &Sums,
    parameters: usize,
    weights: [f64; CHANNELS],
    precision: f64,
) -> Option<Cholesky<f64, Dyn>> {
    let entry = |row: usize, column: usize| {
        sums.product(row, column, weights) + if row == column { precision } else { 0.0 }
    };
    DMatrix::from_fn(parameters, parameters, entry).cholesky()
}
