//! Standard deviations of estimated parameters.
//!
//! With all parameters normalised to their bounds (`p` from -1 to 1), `J` the Jacobian of the
//! weighted residual, `E` the estimated parameters and `U` those that stay as declared or ended at
//! a bound, an estimate is off by
//!
//! ```text
//! Δp_E = H⁻¹ (J_Eᵀ e + W² (p° - p_E) + J_Eᵀ J_U Δp_U),    H = J_Eᵀ J_E + W²,
//! ```
//!
//! with the noise `e`, the weight `W` of the prior (5 for declared parameters, 0 for others), and
//! the declared values `p°`. A rig file says of the truth that it lies within the tolerances; with
//! a uniform distribution there, of variance 1/3, the covariance is
//!
//! ```text
//! H⁻¹ (Σ_k s_k s_kᵀ + W⁴/3 + J_Eᵀ J_U J_Uᵀ J_E / 3) H⁻¹,
//! ```
//!
//! where `s_k` are the scores `J_Eᵀ e` of blocks of correlated rows, of all channels together. The
//! first term is the sandwich covariance; the second is what the prior hides along directions of
//! which the records tell little, the third what parameters that were not estimated do to others.
//!
//! No model is exact, and where it is not its parameters are biased: all rows share that error, and
//! no block tells of it. `c H⁻¹` is therefore added, with `c = 2 η N / n` for `N` rows and `n`
//! parameters: parameters that leave a share `η` more error than the estimates, spread over all
//! directions, are as good as these. `η` is [`MODEL_ERROR`].

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rayon::prelude::*;

use super::dataset::{Dataset, Fitted, PRIOR_WEIGHT};
use super::free_parameter::{AT_BOUND, BOUND_MARGIN, FreeParameter};
use super::transmission_model::{Residual, Setting};
use crate::estimate_correlation::correlation;

/// A root-mean-square sensitivity of the weighted residual below this counts as zero.
const INSENSITIVE: f64 = 1e-6;
/// Error that an inexact model may leave more with the true parameters than with the estimates.
/// On simulated records whose friction passes through zero otherwise than the model's, it is 1 to
/// 2 %; with 3 % the stated deviations hold the truth as often as they should (odd seeds).
pub const MODEL_ERROR: f64 = 0.03;
/// Movement of a normalised declared parameter to each side.
const WIDE: f64 = 0.25;
/// Increase of the criterion to which a movement along an eigenvector is to lead.
const STEP_COST: f64 = 25.0;
/// Its greatest length.
const LONGEST_STEP: f64 = 0.5;
/// A shorter movement, within the bounds, tells nothing.
const LEAST_STEP: f64 = 1e-3;
/// Variance of a uniform distribution from -1 to 1.
const UNIFORM: f64 = 1.0 / 3.0;

impl Dataset<'_> {
    /// Returns the standard deviation of each estimated parameter's value, with scores summed over
    /// blocks of so many rows; infinite where the parameter is not identifiable.
    pub fn deviations(&self, fitted: &Fitted, block: usize) -> Vec<(FreeParameter, f64)> {
        self.deviations_with_correlation(fitted, block).0
    }

    /// As [`Self::deviations`], with the correlation of each with each; 0 for those at a bound.
    pub fn deviations_with_correlation(
        &self,
        fitted: &Fitted,
        block: usize,
    ) -> (Vec<(FreeParameter, f64)>, DMatrix<f64>) {
        let own = &fitted.parameters;
        let others =
            (0..self.model.base.len()).map(FreeParameter::Base).filter(|base| !own.contains(base));
        let all: Vec<FreeParameter> = own.iter().cloned().chain(others).collect();
        let (jacobian, slopes) = self.secants(fitted, &all);
        let at_bound = |parameter: &FreeParameter| {
            parameter.is_base()
                && parameter.normalised(self.model, &fitted.setting).abs() > AT_BOUND
        };
        let estimated: Vec<usize> = (0..own.len()).filter(|at| !at_bound(&own[*at])).collect();
        let rest: Vec<usize> = (0..all.len()).filter(|at| !estimated.contains(at)).collect();
        let given = jacobian.select_columns(&rest);
        let free: Vec<FreeParameter> = estimated.iter().map(|at| all[*at].clone()).collect();
        let of = self.along_eigenvectors(fitted, &free, &jacobian.select_columns(&estimated));
        let prior: Vec<bool> = estimated.iter().map(|at| self.is_declared(&all[*at])).collect();
        let covariance = covariance(&of, &given, &prior, &self.scores(fitted, &of, block));
        let unseen = INSENSITIVE * INSENSITIVE * jacobian.nrows() as f64;
        let of_parameter = |(index, parameter): (usize, &FreeParameter)| {
            let at = estimated.iter().position(|own| *own == index);
            let seen = jacobian.column(index).norm_squared() > unseen;
            let variance = match (at, &covariance) {
                (Some(at), Some(covariance)) if seen => covariance[(at, at)],
                _ => f64::INFINITY,
            };
            // The tolerance bounds what is not known of a declared parameter.
            let most = if self.is_declared(parameter) { UNIFORM } else { f64::INFINITY };
            let variance = if seen { variance.min(most) } else { variance };
            (parameter.clone(), variance.max(0.0).sqrt() * slopes[index].abs())
        };
        let deviations = own.iter().enumerate().map(of_parameter).collect();
        let mut correlations = DMatrix::zeros(own.len(), own.len());
        if let Some(covariance) = &covariance {
            let of_estimated = correlation(covariance);
            for (row, first) in estimated.iter().enumerate() {
                for (column, second) in estimated.iter().enumerate() {
                    // A rising value may belong to a falling normalised parameter.
                    let sign = slopes[*first].signum() * slopes[*second].signum();
                    correlations[(*first, *second)] = sign * of_estimated[(row, column)];
                }
            }
        }
        (deviations, correlations)
    }

    /// Returns the secants of the weighted residual over each normalised parameter, and the slopes
    /// of the parameters' values.
    ///
    /// Declared parameters are moved by [`WIDE`] to both sides. A small movement decides single
    /// events of stick and slip; divided by it they look like information about every parameter,
    /// and hide which of them trade off.
    fn secants(&self, fitted: &Fitted, all: &[FreeParameter]) -> (DMatrix<f64>, Vec<f64>) {
        let ends = |parameter: &FreeParameter| -> [f64; 2] {
            let here = parameter.unbounded(self.model, &fitted.setting).sin();
            if self.is_declared(parameter) {
                return [-WIDE, WIDE].map(|wide| (here + wide).clamp(-BOUND_MARGIN, BOUND_MARGIN));
            }
            [here, parameter.perturbed(self.model, &fitted.setting).sin()]
        };
        let ends: Vec<[f64; 2]> = all.iter().map(ends).collect();
        let moved = |(parameter, place): (&FreeParameter, f64)| {
            let mut setting = fitted.setting.clone();
            parameter.set_unbounded(self.model, &mut setting, place.asin());
            setting
        };
        let settings: Vec<Setting> = all
            .iter()
            .zip(&ends)
            .flat_map(|(parameter, [low, high])| [(parameter, *low), (parameter, *high)])
            .map(moved)
            .collect();
        let residuals: Vec<Option<Vec<Residual>>> =
            settings.par_iter().map(|setting| self.residuals(setting)).collect();
        let weights = Self::weights(&fitted.residuals);
        let mut jacobian = DMatrix::zeros(fitted.rows(), all.len());
        let mut slopes = Vec::with_capacity(all.len());
        for (at, (parameter, [low, high])) in all.iter().zip(&ends).enumerate() {
            let value = |end: usize| parameter.value(&settings[2 * at + end]);
            slopes.push((value(1) - value(0)) / (high - low));
            // A parameter whose model diverges stays without influence.
            if let (Some(low_end), Some(high_end)) = (&residuals[2 * at], &residuals[2 * at + 1]) {
                let rows = Self::stack(high_end, &weights) - Self::stack(low_end, &weights);
                jacobian.set_column(at, &(rows / (high - low)));
            }
        }
        (jacobian, slopes)
    }

    /// Returns a Jacobian over normalised parameters from secants along the eigenvectors of a first
    /// one's normal matrix. Columns that are nearly collinear have large parts in common, and what
    /// is not linear in these hides how little the records tell along the eigenvector in which they
    /// cancel; a movement along it has no such parts.
    fn along_eigenvectors(
        &self,
        fitted: &Fitted,
        free: &[FreeParameter],
        first: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(first.tr_mul(first));
        let here: Vec<f64> =
            free.iter().map(|own| own.unbounded(self.model, &fitted.setting).sin()).collect();
        let ends: Vec<[f64; 2]> = (0..free.len())
            .map(|at| {
                let step = (2.0 * STEP_COST / eigenvalues[at].max(f64::MIN_POSITIVE)).sqrt();
                room(&here, eigenvectors.column(at).as_slice(), step.min(LONGEST_STEP))
            })
            .collect();
        let moved = |at: usize, by: f64| {
            let mut setting = fitted.setting.clone();
            for ((own, here), along) in free.iter().zip(&here).zip(eigenvectors.column(at).iter()) {
                own.set_unbounded(self.model, &mut setting, (here + by * along).asin());
            }
            self.residuals(&setting)
        };
        let weights = Self::weights(&fitted.residuals);
        let secant = |at: usize| {
            let [back, forth] = ends[at];
            let both = (forth - back > LEAST_STEP)
                .then(|| moved(at, forth).zip(moved(at, back)))
                .flatten();
            match both {
                Some((ahead, behind)) => {
                    (Self::stack(&ahead, &weights) - Self::stack(&behind, &weights))
                        / (forth - back)
                }
                None => first * eigenvectors.column(at),
            }
        };
        let columns: Vec<DVector<f64>> = (0..free.len()).into_par_iter().map(secant).collect();
        match columns.is_empty() {
            true => first.clone(),
            false => DMatrix::from_columns(&columns) * eigenvectors.transpose(),
        }
    }

    /// Whether the prior draws a parameter to a declared value.
    fn is_declared(&self, parameter: &FreeParameter) -> bool {
        match parameter {
            FreeParameter::Base(index) => self.model.base[*index].declared.is_some(),
            _ => false,
        }
    }

    /// Scores of blocks of rows, of all channels of a record together.
    fn scores(&self, fitted: &Fitted, jacobian: &DMatrix<f64>, block: usize) -> Vec<DVector<f64>> {
        let rows = Self::stack(&fitted.residuals, &Self::weights(&fitted.residuals));
        let (mut scores, mut from) = (Vec::new(), 0);
        for residual in &fitted.residuals {
            let first = scores.len();
            for channel in &residual.channels {
                for (at, start) in (0..channel.len()).step_by(block.max(1)).enumerate() {
                    let count = block.max(1).min(channel.len() - start);
                    let part =
                        jacobian.rows(from + start, count).tr_mul(&rows.rows(from + start, count));
                    match scores.get_mut(first + at) {
                        Some(score) => *score += part,
                        None => scores.push(part),
                    }
                }
                from += channel.len();
            }
        }
        scores
    }
}

/// How far a point may move back and forth along a direction within the bounds, up to a step.
fn room(here: &[f64], along: &[f64], step: f64) -> [f64; 2] {
    let mut ends = [-step, step];
    for (here, along) in here.iter().zip(along).filter(|(_, along)| **along != 0.0) {
        let [one, other] = [-BOUND_MARGIN, BOUND_MARGIN].map(|bound| (bound - here) / along);
        ends = [ends[0].max(one.min(other).min(0.0)), ends[1].min(one.max(other).max(0.0))];
    }
    ends
}

/// The covariance of the estimated parameters, from the Jacobian of those and of the `given` ones;
/// `None` if it is singular.
fn covariance(
    of: &DMatrix<f64>,
    given: &DMatrix<f64>,
    prior: &[bool],
    scores: &[DVector<f64>],
) -> Option<DMatrix<f64>> {
    let weight = |power: i32| {
        let of = |has: &bool| if *has { PRIOR_WEIGHT.powi(power) } else { 0.0 };
        DMatrix::from_diagonal(&DVector::from_iterator(prior.len(), prior.iter().map(of)))
    };
    let normal = of.tr_mul(of);
    let ridge = DMatrix::from_diagonal(&normal.diagonal().map(|entry| 1e-9 * entry + 1e-12));
    let inverse = (&normal + weight(2) + ridge).cholesky()?.inverse();
    let of_prior = weight(4) * UNIFORM;
    let mut spread = of_prior.clone();
    for score in scores {
        spread.ger(1.0, score, score, 1.0);
    }
    // A parameter to which few blocks are sensitive has no spread among them; that of independent
    // rows is then the lower bound.
    for at in 0..prior.len() {
        let least = normal[(at, at)] + of_prior[(at, at)];
        spread[(at, at)] = spread[(at, at)].max(least);
    }
    let coupling = of.tr_mul(given);
    spread += &coupling * coupling.transpose() * UNIFORM;
    let model_error = 2.0 * MODEL_ERROR * of.nrows() as f64 / prior.len().max(1) as f64;
    Some(&inverse * spread * &inverse + inverse * model_error)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn deviation(of: &DMatrix<f64>, given: &DMatrix<f64>, prior: &[bool]) -> f64 {
        covariance(of, given, prior, &[]).unwrap()[(0, 0)].sqrt()
    }

    #[test]
    fn of_a_parameter_that_the_records_do_not_tell_the_tolerance_remains() {
        let (of, none) = (DMatrix::zeros(100, 1), DMatrix::zeros(100, 0));
        let model_error = 2.0 * MODEL_ERROR * 100.0 / PRIOR_WEIGHT.powi(2);
        let found = deviation(&of, &none, &[true]);
        assert!((found - (UNIFORM + model_error).sqrt()).abs() < 1e-6, "{found}");
    }

    #[test]
    fn white_residuals_give_the_inverse_of_the_normal_matrix() {
        let of = DMatrix::from_fn(400, 1, |row, _| if row % 2 == 0 { 3.0 } else { -3.0 });
        let normal = 400.0 * 9.0;
        let found = deviation(&of, &DMatrix::zeros(400, 0), &[false]);
        let model_error = 2.0 * MODEL_ERROR * 400.0;
        assert!((found - ((1.0 + model_error) / normal).sqrt()).abs() < 1e-6, "{found}");
    }

    #[test]
    fn a_parameter_that_acts_like_one_that_is_not_estimated_has_its_tolerance() {
        let of = DMatrix::from_fn(400, 1, |row, _| if row % 2 == 0 { 50.0 } else { -50.0 });
        let alone = deviation(&of, &DMatrix::zeros(400, 0), &[true]);
        let beside = deviation(&of, &of, &[true]);
        assert!(alone < 0.02 && (beside - UNIFORM.sqrt()).abs() < 0.01, "{alone} {beside}");
    }

    #[test]
    fn a_movement_ends_at_the_first_bound() {
        let [back, forth] = room(&[0.9, 0.0], &[1.0, -0.5], 0.5);
        assert!((back + 0.5).abs() < 1e-12 && (forth - (BOUND_MARGIN - 0.9)).abs() < 1e-12);
        assert_eq!(room(&[-BOUND_MARGIN], &[1.0], 0.2)[0], 0.0);
    }
}
