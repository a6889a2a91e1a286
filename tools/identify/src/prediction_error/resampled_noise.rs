//! Replicates of the noise of some records, and their inner products with given rows.
//!
//! A replicate of a record is its residual, begun at a random row (the end continues at the start)
//! and with a random sign, both common to all channels: colour and correlation between the channels
//! stay, the relation to the movement does not. No model is exact, and to that an error of the
//! model may be added. The replicates are not stored: their inner products with some rows are
//! circular correlations.

use nalgebra::{DMatrix, DVector};
use rand::{Rng, RngExt as _};
use realfft::num_complex::Complex;

use super::dataset::Dataset;
use super::transmission_model::Residual;
use crate::spectral::{inverse_transform, transform};

/// How a replicate comes from a record.
#[derive(Clone, Copy, Debug)]
struct Draw {
    /// Row of the residual at the replicate's first row.
    first: usize,
    /// 1 or -1.
    sign: f64,
}

/// Replicates of the residuals of some records.
#[derive(Debug)]
pub(super) struct ResampledNoise {
    residuals: Vec<Residual>,
    /// Transform of every record and channel.
    transforms: Vec<Vec<Vec<Complex<f64>>>>,
    /// Draws of every replicate and record.
    draws: Vec<Vec<Draw>>,
    /// Stacked rows that replicates have beside the noise: errors of the model.
    errors: Vec<DVector<f64>>,
    /// For every replicate, which of them, and how much of it.
    error_draws: Vec<(usize, f64)>,
}

impl ResampledNoise {
    /// Draws replicates of residuals; `None` where a record has no rows.
    pub(super) fn new(
        residuals: Vec<Residual>,
        replicates: usize,
        generator: &mut impl Rng,
    ) -> Option<Self> {
        let of = |own: &Residual| own.channels.iter().map(|rows| transform(rows.clone())).collect();
        if residuals.iter().flat_map(|own| &own.channels).any(Vec::is_empty) {
            return None;
        }
        let transforms = residuals.iter().map(of).collect::<Option<_>>()?;
        let mut draw = |own: &Residual| {
            let rows = own.channels.iter().map(Vec::len).max().unwrap_or(1);
            let sign = if generator.random::<bool>() { 1.0 } else { -1.0 };
            Draw { first: generator.random_range(0..rows), sign }
        };
        let draws = (0..replicates).map(|_| residuals.iter().map(&mut draw).collect()).collect();
        Some(Self { residuals, transforms, draws, errors: Vec::new(), error_draws: Vec::new() })
    }

    /// Adds errors of the model to the replicates: stacked rows, and for every replicate which of
    /// them, and how much of it.
    pub(super) fn add_errors(&mut self, errors: Vec<DVector<f64>>, draws: Vec<(usize, f64)>) {
        (self.errors, self.error_draws) = (errors, draws);
    }

    /// Weights of the records and channels.
    pub(super) fn weights(&self) -> Vec<Vec<f64>> {
        Dataset::weights(&self.residuals)
    }

    /// Inner products of a column of weighted rows, stacked record by record and channel by
    /// channel, with each weighted replicate; errors of the model are weighted already. `None` if a
    /// transform fails.
    pub(super) fn products(
        &self,
        column: &DVector<f64>,
        weights: &[Vec<f64>],
    ) -> Option<DVector<f64>> {
        let mut products = DVector::zeros(self.draws.len());
        let mut begin = 0;
        let records = self.residuals.iter().zip(&self.transforms).zip(weights).enumerate();
        for (record, ((residual, transforms), weights)) in records {
            for ((rows, noise), weight) in residual.channels.iter().zip(transforms).zip(weights) {
                let count = rows.len();
                let own = transform(column.as_slice().get(begin..begin + count)?.to_vec())?;
                let both = own.iter().zip(noise).map(|(own, noise)| weight * own.conj() * noise);
                let by_shift = inverse_transform(both.collect(), count)?;
                for (product, draws) in products.iter_mut().zip(&self.draws) {
                    let Draw { first, sign } = draws[record];
                    *product += sign * by_shift[first % count];
                }
                begin += count;
            }
        }
        let of_errors: Vec<f64> = self.errors.iter().map(|error| error.dot(column)).collect();
        for (product, (error, size)) in products.iter_mut().zip(&self.error_draws) {
            *product += size * of_errors[*error];
        }
        Some(products)
    }

    /// The inner products of each column of a matrix with each replicate, a row for each column.
    pub(super) fn products_of(
        &self,
        columns: &DMatrix<f64>,
        weights: &[Vec<f64>],
    ) -> Option<DMatrix<f64>> {
        let mut products = DMatrix::zeros(columns.ncols(), self.draws.len());
        for (row, column) in columns.column_iter().enumerate() {
            let own = self.products(&column.into_owned(), weights)?;
            products.set_row(row, &own.transpose());
        }
        Some(products)
    }

    /// One replicate. Errors of the model are added as they are.
    pub(super) fn replicate(&self, index: usize) -> Vec<Residual> {
        let of = |(residual, draw): (&Residual, &Draw)| {
            let rotated = |rows: &Vec<f64>| {
                let (before, after) = rows.split_at(draw.first % rows.len());
                after.iter().chain(before).map(|row| draw.sign * row).collect()
            };
            Residual { channels: residual.channels.iter().map(rotated).collect(), ..*residual }
        };
        let noise: Vec<Residual> = self.residuals.iter().zip(&self.draws[index]).map(of).collect();
        match self.error_draws.get(index) {
            Some((error, size)) => plus(noise, &[(*size, &self.errors[*error])]),
            None => noise,
        }
    }
}

/// Adds multiples of stacked rows to residuals.
pub(super) fn plus(mut residuals: Vec<Residual>, added: &[(f64, &DVector<f64>)]) -> Vec<Residual> {
    let rows = residuals.iter_mut().flat_map(|own| &mut own.channels).flatten();
    for (at, row) in rows.enumerate() {
        *row += added.iter().map(|(factor, column)| factor * column[at]).sum::<f64>();
    }
    residuals
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use rand::SeedableRng as _;
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::test_noise::noise;

    #[test]
    fn products_are_those_with_the_replicates() {
        let record = |seed: u64, rows: usize| Residual {
            channels: vec![noise(seed, rows), noise(seed + 1, rows)],
            slave_observed: true,
        };
        let records = [record(1, 50), record(3, 33)];
        let generator = &mut Pcg64Mcg::seed_from_u64(7);
        let mut noise_of = ResampledNoise::new(records.to_vec(), 5, generator).unwrap();
        let weights = vec![vec![1.0; 2]; 2];
        let errors = [11, 12].map(|seed| DVector::from_vec(noise(seed, 166))).to_vec();
        noise_of.add_errors(errors, vec![(0, 1.0), (1, 0.5), (1, -2.0), (0, 0.0), (1, 3.0)]);
        let column = DVector::from_vec(noise(9, 166));
        let products = noise_of.products(&column, &weights).unwrap();
        for (index, product) in products.iter().enumerate() {
            let stacked = Dataset::stack(&noise_of.replicate(index), &weights);
            assert!((stacked.dot(&column) - product).abs() < 1e-9);
        }
        let signs: Vec<bool> = noise_of.draws.iter().map(|draws| draws[0].sign > 0.0).collect();
        assert!(signs.contains(&true) && signs.contains(&false));
    }
}
