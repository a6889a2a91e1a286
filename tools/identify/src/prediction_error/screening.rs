//! Score screening of the candidates.
//!
//! Every starting point of every candidate is simulated once. The change of the residual, with the
//! sensitivities to the estimated parameters projected out, is compared with the residual: the
//! score is the share of the squared residual that it would explain. Nothing is fitted here.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use plant::effects::search::PHASE;
use rayon::prelude::*;

use super::candidates::Candidate;
use super::dataset::{Dataset, Fitted};
use super::known_columns::KnownColumns;
use super::transmission_model::{PlacedEffect, Residual, Setting};

/// The residual of a fit, projected onto the complement of its own Jacobian.
pub struct Projection {
    /// Jacobian of the weighted residual, and its weights.
    pub columns: KnownColumns,
    here: DVector<f64>,
    basis: DMatrix<f64>,
    left: DVector<f64>,
}

/// Returns an orthonormal basis of the span of some columns with `rows` rows, zero columns left
/// out.
pub fn basis(columns: impl Iterator<Item = DVector<f64>>, rows: usize) -> DMatrix<f64> {
    let columns: Vec<DVector<f64>> = columns
        .filter_map(|column| {
            let norm = column.norm();
            (norm > 0.0).then(|| column / norm)
        })
        .collect();
    if columns.is_empty() {
        DMatrix::zeros(rows, 0)
    } else {
        DMatrix::from_columns(&columns).qr().q()
    }
}

/// Decomposes the normal matrix of a least-squares problem, with a ridge against directions that
/// coincide.
pub(super) fn solvable(normal: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let count = normal.nrows();
    let ridge = 1e-9 * normal.trace().max(f64::MIN_POSITIVE);
    (normal + DMatrix::identity(count, count) * ridge).cholesky()
}

/// Least-squares factors, each moved to its limits.
pub(super) fn bounded(
    normal: &Cholesky<f64, Dyn>,
    right: &DVector<f64>,
    (low, high): (f64, f64),
) -> Vec<f64> {
    normal.solve(right).iter().map(|factor| factor.clamp(low, high)).collect()
}

/// A candidate with its best starting point.
#[derive(Clone, Debug)]
pub struct ScoredCandidate {
    /// Index of the candidate.
    pub candidate: usize,
    /// Starting point of the fit, with its size scaled.
    pub placed: PlacedEffect,
    /// Share of the squared residual that it explains, 0 to 1.
    pub share: f64,
}

impl Projection {
    /// Projects the residual of a fit by its estimated parameters.
    pub fn new(dataset: &Dataset<'_>, fitted: &Fitted) -> Self {
        let parameters = &fitted.parameters;
        let known = KnownColumns::at(dataset, fitted, parameters);
        let here = Dataset::stack(&fitted.residuals, &known.weights);
        let columns = parameters
            .iter()
            .zip(known.jacobian.column_iter())
            .filter(|(parameter, _)| parameter.is_inside(dataset.model, &fitted.setting));
        let basis = basis(columns.map(|(_, column)| column.into_owned()), here.len());
        let left = &here - &basis * (basis.transpose() * &here);
        Self { columns: known, here, basis, left }
    }

    /// Returns the weighted, projected change of the residual; `None` if the setting cannot be
    /// simulated, or after the deadline.
    fn change(&self, dataset: &Dataset<'_>, setting: &Setting) -> Option<DVector<f64>> {
        if dataset.deadline.has_passed() {
            return None;
        }
        Some(self.projected(&dataset.residuals(setting)?))
    }

    /// Returns the weighted, projected difference of residuals from those of the fit.
    fn projected(&self, with: &[Residual]) -> DVector<f64> {
        let change = Dataset::stack(with, &self.columns.weights) - &self.here;
        &change - &self.basis * (self.basis.transpose() * &change)
    }

    /// Share of the squared residual that directions with given factors explain; negative where
    /// they make it larger.
    fn share(&self, directions: &[DVector<f64>], factors: &[f64]) -> f64 {
        let mut after = self.left.clone();
        for (direction, factor) in directions.iter().zip(factors) {
            after.axpy(*factor, direction, 1.0);
        }
        1.0 - after.norm_squared() / self.left.norm_squared().max(f64::MIN_POSITIVE)
    }

    /// Least squares of the residual on some directions: bounded factors, and the share explained.
    fn best(&self, directions: &[DVector<f64>], limits: (f64, f64)) -> Option<(Vec<f64>, f64)> {
        let count = directions.len();
        let gram =
            DMatrix::from_fn(count, count, |row, column| directions[row].dot(&directions[column]));
        let right = DVector::from_iterator(
            count,
            directions.iter().map(|direction| -direction.dot(&self.left)),
        );
        let factors = bounded(&solvable(gram)?, &right, limits);
        let share = self.share(directions, &factors);
        Some((factors, share))
    }

    /// Scores several settings together (nonparametric functions): factors and share explained.
    pub fn explain(&self, dataset: &Dataset<'_>, settings: &[Setting]) -> Option<(Vec<f64>, f64)> {
        let directions: Vec<DVector<f64>> = settings
            .par_iter()
            .map(|setting| self.change(dataset, setting))
            .collect::<Option<_>>()?;
        self.best(&directions, (f64::NEG_INFINITY, f64::INFINITY))
    }

    /// Least squares of the residual on the changes that each of several torques makes, given by
    /// the residuals with each: factors of the torques.
    pub fn regress(&self, with: &[Vec<Residual>]) -> Option<Vec<f64>> {
        let directions: Vec<DVector<f64>> = with.iter().map(|with| self.projected(with)).collect();
        Some(self.best(&directions, (f64::NEG_INFINITY, f64::INFINITY))?.0)
    }

    /// Share of the squared residual that these torques explain with given factors; negative where
    /// they make it larger.
    pub fn explained(&self, with: &[Vec<Residual>], factors: &[f64]) -> f64 {
        let directions: Vec<DVector<f64>> = with.iter().map(|with| self.projected(with)).collect();
        self.share(&directions, factors)
    }

    /// Scores every candidate, best first; those that cannot be simulated are omitted.
    pub fn rank(
        &self,
        dataset: &Dataset<'_>,
        fitted: &Fitted,
        candidates: &[Candidate],
    ) -> Vec<ScoredCandidate> {
        let starts: Vec<(usize, &PlacedEffect)> = candidates
            .iter()
            .enumerate()
            .flat_map(|(index, candidate)| candidate.starts.iter().map(move |start| (index, start)))
            .collect();
        let scored: Vec<ScoredCandidate> = starts
            .par_iter()
            .filter_map(|(index, start)| {
                self.score(dataset, fitted, *index, &candidates[*index], start)
            })
            .collect();
        let mut best: Vec<ScoredCandidate> = Vec::new();
        for scored in scored {
            match best.iter_mut().find(|known| known.candidate == scored.candidate) {
                Some(known) if known.share >= scored.share => {}
                Some(known) => *known = scored,
                None => best.push(scored),
            }
        }
        best.sort_by(|a, b| b.share.total_cmp(&a.share));
        best
    }

    fn score(
        &self,
        dataset: &Dataset<'_>,
        fitted: &Fitted,
        candidate: usize,
        of: &Candidate,
        start: &PlacedEffect,
    ) -> Option<ScoredCandidate> {
        let with = |placed: &PlacedEffect| self.change(dataset, &fitted.setting.with(placed));
        let mut directions = vec![with(start)?];
        if let Some(quadrature) = of.quadrature(start) {
            directions.push(with(&quadrature)?);
        }
        let (factors, share) = self.best(&directions, of.factor_limits())?;
        Some(ScoredCandidate { candidate, placed: scaled(of, start, &factors), share })
    }
}

/// Scales the size of a starting point.
fn scaled(candidate: &Candidate, start: &PlacedEffect, factors: &[f64]) -> PlacedEffect {
    let mut placed = start.clone();
    if let ([cosine, sine], Some((name, most))) = (factors, candidate.phasor) {
        for (own, value) in &mut placed.values {
            if *own == name {
                *value = (*value * cosine.hypot(*sine)).clamp(0.02 * most, most);
            } else if *own == PHASE {
                *value = sine.atan2(*cosine);
            }
        }
        return placed;
    }
    let Some(factor) = factors.first() else { return placed };
    // Not below a tenth: near zero the gradient vanishes.
    let factor = if factor.abs() < 0.1 { 0.1_f64.copysign(*factor) } else { *factor };
    for (name, value) in placed.values.iter_mut().take(candidate.sizes) {
        let (low, high) = candidate
            .free
            .iter()
            .find(|free| free.name == *name)
            .map_or((f64::MIN, f64::MAX), |free| (free.low, free.high));
        *value = (*value * factor).clamp(low, high);
    }
    placed
}
