//! The declared parameters within their tolerances, followed as the machine warms up and wears.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::bank::CHANNELS;
use crate::sums::Sums;

/// Rows of innovations count this much less than independent ones: an innovation lasts for as long
/// as the observer takes to follow, and what the model lacks is the same in each cycle of a
/// movement.
const ROWS_PER_INDEPENDENT: f64 = 100.0;
/// Standard deviation of a parameter's walk from block to block (tolerances): 0.06 in two minutes.
/// A machine that warms up by a tolerance within an hour goes 0.03 in that time.
const WALK: f64 = 0.004;

/// Estimates by how much the parameters are off their declared values, in tolerances: a Kalman
/// filter with a tolerance as the standard deviation of the prior, and a random walk.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    shares: DVector<f64>,
    /// Covariance of the shares (square tolerances).
    covariance: DMatrix<f64>,
}

impl Calibration {
    /// For so many parameters, the first of the directions.
    pub fn new(parameters: usize) -> Self {
        Self {
            shares: DVector::zeros(parameters),
            covariance: DMatrix::identity(parameters, parameters),
        }
    }

    /// Deviations of the parameters from their declared values, in tolerances.
    pub const fn shares(&self) -> &DVector<f64> {
        &self.shares
    }

    /// Covariance of the deviations (square tolerances).
    pub const fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// Becomes another, without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        self.shares.copy_from(&other.shares);
        self.covariance.copy_from(&other.covariance);
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

    /// Takes a block, with the standard deviations of the innovation (rad). One whose sums are not
    /// finite changes nothing.
    pub fn take(&mut self, block: &Sums, deviations: [f64; CHANNELS]) {
        let count = self.shares.len();
        let weights = weights(deviations);
        let mut before = self.covariance.clone();
        (0..count).for_each(|at| before[(at, at)] += WALK * WALK);
        let Some(before) = before.cholesky() else { return };
        let shown = DMatrix::from_fn(count, count, |at, other| block.product(at, other, weights));
        let with = DVector::from_fn(count, |at, _| block.with(at, weights));
        let left = with - &shown * &self.shares;
        if let Some(after) = (before.inverse() + shown).cholesky() {
            self.shares += after.solve(&left);
            self.covariance = after.inverse();
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
            sums.add(&Innovations { linear: declared, directions, ..Innovations::default() });
        }
        sums
    }

    #[test]
    fn a_parameter_is_found_and_one_that_was_never_seen_is_uncertain() {
        let mut calibration = Calibration::new(2);
        let before = calibration.expected(&block(0));
        for _ in 0..40 {
            calibration.take(&block(0), USUAL_RAD);
        }
        assert!((calibration.shares()[0] - 0.5).abs() < 0.01, "{}", calibration.shares());
        assert!(calibration.expected(&block(0))[0] < 0.01 * before[0]);
        // The other movement may show anything within the tolerance.
        let other = calibration.expected(&block(1));
        let walked = 1.0 + 40.0 * WALK * WALK;
        let tolerance = walked * block(1).product(1, 1, [1.0, 0.0]) / 125.0;
        assert!((other[0] / tolerance - 1.0).abs() < 1e-9, "{other:?} {tolerance}");
    }

    #[test]
    fn what_is_not_seen_any_more_is_kept_and_known_less() {
        let mut calibration = Calibration::new(2);
        (0..40).for_each(|_| calibration.take(&block(0), USUAL_RAD));
        let known = calibration.covariance()[(0, 0)];
        (0..200).for_each(|_| calibration.take(&block(1), USUAL_RAD));
        assert!((calibration.shares()[0] - 0.5).abs() < 0.01, "{}", calibration.shares());
        let walked = calibration.covariance()[(0, 0)] - known;
        assert!((walked / (200.0 * WALK * WALK) - 1.0).abs() < 1e-6, "{walked}");
    }

    #[test]
    fn a_channel_that_is_not_observed_has_no_weight() {
        assert_eq!(weights([0.0, 1.0])[0], 0.0);
    }
}
