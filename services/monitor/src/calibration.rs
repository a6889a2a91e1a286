//! The declared parameters within their tolerances, followed as the machine warms up and wears.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::bank::CHANNELS;
use crate::sums::Sums;

/// Rows of innovations count this much less than independent ones. An innovation lasts for as long
/// as the observer takes to follow; and a direction is that of one change alone and of one size:
/// believed to the letter, parameters leave their tolerances to fit one movement, and are wrong in
/// the next.
pub const ROWS_PER_INDEPENDENT: f64 = 1000.0;

/// Estimates by how much the parameters are off their declared values, in tolerances: recursive
/// least squares with a tolerance as the standard deviation of the prior, and a memory.
#[derive(Clone, Debug)]
pub struct Calibration {
    sums: Sums,
    forgetting: f64,
    shares: DVector<f64>,
    /// Covariance of the shares (square tolerances).
    covariance: DMatrix<f64>,
}

impl Calibration {
    /// For the first `parameters` of so many `directions`; what is older than `memory` blocks
    /// fades.
    pub fn new(parameters: usize, directions: usize, memory: f64) -> Self {
        Self {
            sums: Sums::new(directions),
            forgetting: (-1.0 / memory).exp(),
            shares: DVector::zeros(parameters),
            covariance: DMatrix::identity(parameters, parameters),
        }
    }

    /// Deviations of the parameters from their declared values, in tolerances.
    pub const fn shares(&self) -> &DVector<f64> {
        &self.shares
    }

    /// Mean square that a block is expected to have beside the baseline, since the shares are known
    /// only so far, by channel (rad²): in a movement that shows a parameter for the first time it
    /// is large.
    pub fn expected(&self, block: &Sums) -> [f64; CHANNELS] {
        let count = self.shares.len();
        std::array::from_fn(|channel| {
            let weights = std::array::from_fn(|at| f64::from(u8::from(at == channel)));
            let row = |at: usize| -> f64 {
                (0..count)
                    .map(|other| self.covariance[(at, other)] * block.product(at, other, weights))
                    .sum()
            };
            let sum: f64 = (0..count).map(row).sum();
            (sum / f64::from(block.rows().max(1))).max(0.0)
        })
    }

    /// Takes a block, with the standard deviations of the innovation (rad).
    pub fn take(&mut self, block: &Sums, deviations: [f64; CHANNELS]) {
        self.sums.scale(self.forgetting);
        self.sums.add_sums(block);
        let weights = weights(deviations);
        if let Some(normal) = normal(&self.sums, self.shares.len(), weights, 1.0) {
            let with = DVector::from_fn(self.shares.len(), |at, _| self.sums.with(at, weights));
            self.shares = normal.solve(&with);
            self.covariance = normal.inverse();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::Innovations;

    const USUAL_RAD: [f64; CHANNELS] = [1e-4; CHANNELS];

    /// A block of a movement that shows the first direction, or the second, with a deviation of the
    /// first parameter by half a tolerance.
    fn block(shown: usize) -> Sums {
        let mut sums = Sums::new(2);
        for step in 0..125 {
            let wave = 1e-2 * f64::from(step).sin();
            let mut directions = vec![[0.0; CHANNELS]; 2];
            directions[shown] = [wave, 0.5 * wave];
            let own = if shown == 0 { 0.5 * wave } else { 0.0 };
            let declared = [own, 0.5 * own];
            sums.add(&Innovations { declared, directions, ..Innovations::default() });
        }
        sums
    }

    #[test]
    fn a_parameter_is_found_and_one_that_was_never_seen_is_uncertain() {
        let mut calibration = Calibration::new(2, 2, 240.0);
        let before = calibration.expected(&block(0));
        for _ in 0..40 {
            calibration.take(&block(0), USUAL_RAD);
        }
        assert!((calibration.shares()[0] - 0.5).abs() < 0.01, "{}", calibration.shares());
        assert!(calibration.expected(&block(0))[0] < 0.01 * before[0]);
        // The other movement may show anything within the tolerance.
        let other = calibration.expected(&block(1));
        let tolerance = block(1).product(1, 1, [1.0, 0.0]) / 125.0;
        assert!((other[0] / tolerance - 1.0).abs() < 1e-9, "{other:?} {tolerance}");
    }

    #[test]
    fn what_is_old_fades() {
        let mut calibration = Calibration::new(2, 2, 10.0);
        (0..40).for_each(|_| calibration.take(&block(0), USUAL_RAD));
        (0..200).for_each(|_| calibration.take(&block(1), USUAL_RAD));
        assert!(calibration.shares()[0].abs() < 0.01, "{}", calibration.shares());
    }

    #[test]
    fn a_channel_that_is_not_observed_has_no_weight() {
        assert_eq!(weights([0.0, 1.0])[0], 0.0);
    }
}
