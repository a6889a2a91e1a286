//! Whether the innovations of the newest blocks look like one of the changes: the score of each
//! direction, by which even a change whose energy is below the innovation's own is noticed.
//!
//! A change of size s adds s times its direction d to the residual r (what the calibration leaves
//! of the innovation). Over a window the score Σ r d grows with s Σ d², whereas that of the usual
//! innovation has the variance Σ d² (in standard deviations, with rows counted by as much as they
//! are independent: [`weights`]), and that of parameters which are known only with the covariance
//! P, the variance (Σ d p)ᵀ P (Σ d p). The square of the score over the sum of both is compared
//! with a limit, as in a generalised likelihood ratio test (Basseville and Nikiforov, Detection of
//! Abrupt Changes, 1993, ch. 7).

use std::collections::VecDeque;

use nalgebra::{DMatrix, DVector};

use crate::bank::CHANNELS;
use crate::calibration::{Calibration, weights};
use crate::sums::Sums;

/// Blocks of a window: four seconds of movement.
pub const WINDOW: usize = 8;

/// A block, weighted and summed over the channels.
#[derive(Clone, Debug)]
struct Block {
    /// Σ r d of each direction, with the innovation for r.
    with: DVector<f64>,
    /// Σ d².
    power: DVector<f64>,
    /// Σ d p: directions by row, parameters by column.
    products: DMatrix<f64>,
}

/// The direction that the newest blocks show most.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// Square of the score over its variance without a change.
    pub ratio: f64,
    /// Blocks since the direction began to show, the newest included.
    pub blocks: usize,
}

/// The newest blocks. Does not allocate after it is made.
#[derive(Clone, Debug)]
pub struct Window {
    blocks: VecDeque<Block>,
    taken: usize,
    /// Sum of the blocks' products.
    products: DMatrix<f64>,
    /// Covariance of the parameters times a row of products.
    known: DVector<f64>,
}

impl Window {
    /// For so many directions, of which the first are those of parameters.
    pub fn new(parameters: usize, directions: usize) -> Self {
        let block = Block {
            with: DVector::zeros(directions),
            power: DVector::zeros(directions),
            products: DMatrix::zeros(directions, parameters),
        };
        Self {
            products: block.products.clone(),
            known: DVector::zeros(parameters),
            blocks: (0..WINDOW).map(|_| block.clone()).collect(),
            taken: 0,
        }
    }

    /// Takes a block, with the standard deviations of the innovation (rad).
    pub fn take(&mut self, sums: &Sums, deviations: [f64; CHANNELS]) {
        let Some(mut block) = self.blocks.pop_front() else { return };
        let weights = weights(deviations);
        let parameters = block.products.ncols();
        for at in 0..block.with.len() {
            block.with[at] = sums.with(at, weights);
            block.power[at] = sums.product(at, at, weights);
            for parameter in 0..parameters {
                block.products[(at, parameter)] = sums.product(at, parameter, weights);
            }
        }
        self.blocks.push_back(block);
        self.taken += 1;
    }

    /// The score of the direction that shows most, beyond the parameters as they were calibrated
    /// before the window; nothing until it is full.
    pub fn score(&mut self, before: &Calibration) -> Score {
        let mut most = Score::default();
        if self.taken < WINDOW {
            return most;
        }
        self.products.fill(0.0);
        for block in &self.blocks {
            self.products += &block.products;
        }
        let mut best = 0;
        for at in 0..self.products.nrows() {
            let scores = self.scores(at, before);
            let power: f64 = self.blocks.iter().map(|block| block.power[at]).sum();
            let row = self.products.row(at);
            for (other, known) in self.known.iter_mut().enumerate() {
                *known =
                    row.iter().zip(before.covariance().column(other).iter()).map(product).sum();
            }
            let uncertain: f64 = row.iter().zip(self.known.iter()).map(product).sum();
            let variance = power + uncertain.max(0.0);
            let ratio = clipped(scores).powi(2) / variance.max(f64::MIN_POSITIVE);
            if power > 0.0 && ratio > most.ratio {
                (most.ratio, best) = (ratio, at);
            }
        }
        most.blocks = self.since(best, before);
        most
    }

    /// Score of a direction in each block.
    fn scores(&self, at: usize, before: &Calibration) -> [f64; WINDOW] {
        let mut scores = [0.0; WINDOW];
        for (score, block) in scores.iter_mut().zip(&self.blocks) {
            let known: f64 =
                block.products.row(at).iter().zip(before.shares().iter()).map(product).sum();
            *score = block.with[at] - known;
        }
        scores
    }

    /// Blocks since a direction began to show: those that together explain most.
    fn since(&self, at: usize, before: &Calibration) -> usize {
        let scores = self.scores(at, before);
        let (mut score, mut power, mut most, mut since) = (0.0, 0.0, 0.0, 0);
        for (age, (own, block)) in scores.iter().zip(&self.blocks).rev().enumerate() {
            score += own;
            power += block.power[at];
            if power > 0.0 && score * score / power > most {
                (most, since) = (score * score / power, age + 1);
            }
        }
        since
    }
}

fn product((one, other): (&f64, &f64)) -> f64 {
    one * other
}

/// Size of the sum of scores, of which one block counts no more than all others: it alone is no
/// change.
fn clipped(scores: [f64; WINDOW]) -> f64 {
    let sum: f64 = scores.iter().sum();
    let largest = scores.map(|own| own * sum.signum()).into_iter().fold(0.0, f64::max);
    sum.abs().min(2.0 * (sum.abs() - largest)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::Innovations;

    const USUAL_RAD: [f64; CHANNELS] = [1e-3, 0.0];

    /// A block in which the second of two directions (the first is a parameter's) has this share in
    /// the innovation, beside noise of one deviation.
    fn block(share: f64) -> Sums {
        let mut sums = Sums::new(2);
        for step in 0..125 {
            let phase = f64::from(step);
            let (one, two) = (2e-3 * phase.cos(), 2e-3 * phase.sin());
            let noise = if step % 2 == 0 { 1e-3 } else { -1e-3 };
            let directions = vec![[one, 0.0], [two, 0.0]];
            let linear = [share * two + noise, 0.0];
            sums.add(&Innovations { linear, directions, ..Innovations::default() });
        }
        sums
    }

    fn after(shares: &[f64]) -> Score {
        let mut window = Window::new(1, 2);
        shares.iter().for_each(|share| window.take(&block(*share), USUAL_RAD));
        window.score(&Calibration::new(1))
    }

    #[test]
    fn a_change_is_scored_and_its_beginning_found() {
        let none = after(&[0.0; WINDOW]);
        assert!(none.ratio < 0.1, "{none:?}");
        let changed = after(&[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
        // Five of eight blocks; in each 125 rows / 100 of a mean d² of 2 square deviations.
        let expected = (5.0f64 * 2.5).powi(2) / (8.0 * 2.5);
        assert!((changed.ratio / expected - 1.0).abs() < 0.1, "{changed:?}, not {expected}");
        assert_eq!(changed.blocks, 5);
    }

    #[test]
    fn one_block_is_no_change_and_a_short_past_shows_none() {
        let one = after(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 50.0]);
        assert!(one.ratio < 0.1, "{one:?}");
        assert_eq!(after(&[1.0; WINDOW - 1]), Score::default());
    }
}
