//! A fitted model linearised in its parameters: what a refit takes of a residual, and what it
//! changes on other records.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::dataset::{Dataset, Fitted};
use super::free_parameter::FreeParameter;
use super::resampled_noise::ResampledNoise;
use super::screening::{bounded, solvable};

/// Sensitivities of the residuals of two datasets to the parameters that the first one estimates.
pub(super) struct LinearisedModel {
    /// Jacobian of the weighted residual of the fitting records.
    fit: DMatrix<f64>,
    /// `JᵀJ + W²`, with the weights `W` of the prior rows.
    normal: Cholesky<f64, Dyn>,
    /// Jacobian of the residual of the selecting records, not weighted.
    select: DMatrix<f64>,
}

/// Directions in which an effect changes the residual of the fitting records, each refitted, with
/// their least-squares factors in every replicate.
pub(super) struct LinearFits {
    /// Change of the parameters along each direction.
    answers: Vec<DVector<f64>>,
    /// Factors of the directions, by replicate.
    pub(super) factors: Vec<Vec<f64>>,
    /// Decrease of the sum of squares, by replicate.
    pub(super) decreases: Vec<f64>,
}

impl LinearisedModel {
    /// Linearises a fitted model, which is also `selected` on the selecting records; `weights` are
    /// those of the fitting and of the selecting records' residuals. `None` if it has no solution.
    pub(super) fn at(
        (fit, select): (&Dataset<'_>, &Dataset<'_>),
        (fitted, selected): (&Fitted, &Fitted),
        weights: [&[Vec<f64>]; 2],
    ) -> Option<Self> {
        let inside = |own: &&FreeParameter| own.is_inside(fit.model, &fitted.setting);
        let parameters: Vec<FreeParameter> =
            fitted.parameters.iter().filter(inside).cloned().collect();
        let prior = parameters.iter().map(|own| fit.off_slope(own, &fitted.setting));
        Self::new(
            fit.jacobian(fitted, &parameters, weights[0]),
            &DVector::from_iterator(parameters.len(), prior),
            select.jacobian(selected, &parameters, weights[1]),
        )
    }

    /// A linear model with these Jacobians and weights of the prior rows.
    fn new(fit: DMatrix<f64>, prior: &DVector<f64>, select: DMatrix<f64>) -> Option<Self> {
        let normal = fit.tr_mul(&fit) + DMatrix::from_diagonal(&prior.map(|own| own * own));
        Some(Self { normal: solvable(normal)?, fit, select })
    }

    /// The sum of squares that a change of the weighted residual leaves after a refit.
    pub(super) fn left_of(&self, change: &DVector<f64>) -> f64 {
        let along = self.fit.tr_mul(change);
        change.norm_squared() - along.dot(&self.normal.solve(&along))
    }

    /// The parameters that a refit chooses for every replicate of the noise, a column for each.
    pub(super) fn refits(
        &self,
        noise: &ResampledNoise,
        weights: &[Vec<f64>],
    ) -> Option<DMatrix<f64>> {
        Some(-self.normal.solve(&noise.products_of(&self.fit, weights)?))
    }

    /// Fits an effect whose trials change the weighted residual by `changes` to every replicate of
    /// the noise, with factors between `limits`. `None` where the directions coincide.
    pub(super) fn fit_effect(
        &self,
        noise: &ResampledNoise,
        weights: &[Vec<f64>],
        changes: &[DVector<f64>],
        limits: (f64, f64),
    ) -> Option<LinearFits> {
        let answers: Vec<DVector<f64>> =
            changes.iter().map(|change| -self.normal.solve(&self.fit.tr_mul(change))).collect();
        // Of inner products with projected rows one factor alone need be projected.
        let both = changes.iter().zip(&answers);
        let projected: Vec<DVector<f64>> =
            both.map(|(change, answer)| change + &self.fit * answer).collect();
        let gram = DMatrix::from_fn(changes.len(), changes.len(), |row, column| {
            changes[row].dot(&projected[column])
        });
        let products: Vec<DVector<f64>> =
            projected.iter().map(|own| noise.products(own, weights)).collect::<Option<_>>()?;
        let normal = solvable(gram.clone())?;
        let replicates = products.first()?.len();
        let (mut factors, mut decreases) = (Vec::new(), Vec::new());
        for replicate in 0..replicates {
            let along =
                DVector::from_iterator(changes.len(), products.iter().map(|own| own[replicate]));
            let chosen = bounded(&normal, &-&along, limits);
            let moved = DVector::from_column_slice(&chosen);
            decreases.push(-(2.0 * moved.dot(&along) + moved.dot(&(&gram * &moved))));
            factors.push(chosen);
        }
        Some(LinearFits { answers, factors, decreases })
    }

    /// The change of the selecting records' residual by each trial, the parameters refitted on the
    /// fitting records.
    pub(super) fn on_selected(
        &self,
        fits: &LinearFits,
        changes: &[DVector<f64>],
    ) -> Vec<DVector<f64>> {
        let both = changes.iter().zip(&fits.answers);
        both.map(|(change, answer)| change + self.refitted(answer)).collect()
    }

    /// The change of the selecting records' residual with the parameters.
    pub(super) fn refitted(&self, parameters: &DVector<f64>) -> DVector<f64> {
        &self.select * parameters
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use rand::SeedableRng as _;
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::prediction_error::transmission_model::Residual;
    use crate::test_noise::noise;

    /// Of white noise, the share that one direction explains beside `p` others in `n` rows has the
    /// beta distribution with 1/2 and (n - p - 1)/2: its mean is 1/(n - p), and the 95th percentile
    /// for large n 3.84 times that.
    #[test]
    fn the_share_that_a_candidate_explains_of_white_noise_has_a_beta_distribution() {
        const PARAMETERS: usize = 5;
        const ROWS: usize = 400;
        let records: Vec<Residual> = (0..4)
            .map(|seed| Residual {
                channels: vec![noise(100 + seed, ROWS / 4)],
                slave_observed: true,
            })
            .collect();
        let generator = &mut Pcg64Mcg::seed_from_u64(1);
        let replicates = ResampledNoise::new(records, 4000, generator).unwrap();
        let weights = replicates.weights();
        let jacobian = DMatrix::from_vec(ROWS, PARAMETERS, noise(7, ROWS * PARAMETERS));
        let model = LinearisedModel::new(
            jacobian.clone(),
            &DVector::zeros(PARAMETERS),
            DMatrix::zeros(10, PARAMETERS),
        )
        .unwrap();
        let change = DVector::from_vec(noise(8, ROWS));
        let unbounded = (f64::NEG_INFINITY, f64::INFINITY);
        let fits = model.fit_effect(&replicates, &weights, &[change], unbounded).unwrap();
        let refits = model.refits(&replicates, &weights).unwrap();
        let mut shares: Vec<f64> = (0..4000)
            .map(|replicate| {
                let rows = Dataset::stack(&replicates.replicate(replicate), &weights);
                let left = rows + &jacobian * refits.column(replicate);
                fits.decreases[replicate] / left.norm_squared()
            })
            .collect();
        shares.sort_by(f64::total_cmp);
        let free = (ROWS - PARAMETERS) as f64;
        let mean = free * shares.iter().sum::<f64>() / 4000.0;
        let percentile = free * shares[3800];
        assert!((0.9..1.1).contains(&mean), "{mean}");
        assert!((3.4..4.3).contains(&percentile), "{percentile}");
        assert!(shares[0] >= 0.0 && shares[3999] < 1.0);
    }

    #[test]
    fn what_the_parameters_explain_is_no_effect_and_limits_hold() {
        let records = [Residual { channels: vec![noise(5, 60)], slave_observed: true }];
        let generator = &mut Pcg64Mcg::seed_from_u64(2);
        let replicates = ResampledNoise::new(records.to_vec(), 20, generator).unwrap();
        let weights = replicates.weights();
        let jacobian = DMatrix::from_vec(60, 1, noise(6, 60));
        let same = jacobian.column(0).into_owned();
        let model =
            LinearisedModel::new(jacobian, &DVector::zeros(1), DMatrix::zeros(1, 1)).unwrap();
        let of = |change: DVector<f64>, limits| {
            model.fit_effect(&replicates, &weights, &[change], limits).unwrap()
        };
        assert!(of(same, (-3.0, 3.0)).decreases.iter().all(|decrease| decrease.abs() < 1e-6));
        let limited = of(DVector::from_vec(noise(9, 60)), (0.0, 1e-3));
        assert!(limited.factors.iter().all(|own| (0.0..=1e-3).contains(&own[0])));
        assert!(limited.decreases.iter().all(|decrease| *decrease >= 0.0));
    }
}
