//! Maximum-likelihood fit by Levenberg-Marquardt: the minimum of the criterion of
//! [`super::dataset`].
//!
//! Weights are the inverse rms of the last residuals, held during a Levenberg-Marquardt round.
//! Bounds are enforced by a change of variable ([`super::free_parameter`]).

use std::f64::consts::FRAC_PI_2;

use levenberg_marquardt::LevenbergMarquardt;
use nalgebra::DMatrix;
use rayon::prelude::*;

use super::dataset::{Dataset, Fitted};
use super::fit_problem::Problem;
use super::free_parameter::FreeParameter;
use super::known_columns::KnownColumns;
use super::transmission_model::Setting;

/// Number of starting points that are continued after a brief fit.
const LEADING: usize = 3;

/// The best of several brief fits, best first.
pub(super) fn foremost(mut begun: Vec<Fitted>) -> Vec<Fitted> {
    begun.sort_by(|a, b| a.objective.total_cmp(&b.objective));
    begun.truncate(LEADING);
    begun
}

impl Dataset<'_> {
    /// Takes one damped Gauss-Newton step with a given Jacobian and its weights, halting at the
    /// first step length that lowers the criterion; `None` if none does.
    pub fn step(
        &self,
        from: &Fitted,
        parameters: &[FreeParameter],
        jacobian: &DMatrix<f64>,
        weights: &[Vec<f64>],
    ) -> Option<Fitted> {
        let rows = Self::stack(&from.residuals, weights);
        let (mut normal, mut gradient) = (jacobian.tr_mul(jacobian), jacobian.tr_mul(&rows));
        for (at, parameter) in parameters.iter().enumerate() {
            let FreeParameter::Base(index) = parameter else { continue };
            let slope = self.off_slope(parameter, &from.setting);
            normal[(at, at)] += slope * slope;
            gradient[at] += slope * self.off(&from.setting, *index);
        }
        let damped =
            &normal + DMatrix::from_diagonal(&normal.diagonal().map(|entry| 1e-3 * entry + 1e-9));
        let whole = -damped.cholesky()?.solve(&gradient);
        [1.0, 0.4, 0.1].iter().find_map(|part| {
            let mut setting = from.setting.clone();
            for (parameter, change) in parameters.iter().zip(whole.iter()) {
                let open = parameter.unbounded(self.model, &setting);
                // At most up to the bound.
                let open = (open + (part * change).clamp(-0.7, 0.7)).clamp(-FRAC_PI_2, FRAC_PI_2);
                parameter.set_unbounded(self.model, &mut setting, open);
            }
            self.evaluate(setting).filter(|fitted| fitted.objective < from.objective)
        })
    }

    /// Fits from a starting point in up to `rounds` rounds, each with weights from its start.
    /// `None` if the starting point cannot be simulated.
    pub fn fit(
        &self,
        start: &Setting,
        parameters: &[FreeParameter],
        rounds: usize,
    ) -> Option<Fitted> {
        self.fit_beginning_with(start, parameters, rounds, None)
    }

    /// Fits a model without its effect at index `at`, from where it ended with it.
    pub fn fit_without(&self, with: &Fitted, at: usize, rounds: usize) -> Option<Fitted> {
        let mut setting = with.setting.clone();
        setting.placed.remove(at);
        let left: Vec<FreeParameter> =
            with.parameters.iter().filter_map(|parameter| parameter.without(at)).collect();
        self.fit(&setting, &left, rounds)
    }

    /// As [`Self::fit`]; the first round begins with columns of a Jacobian that holds nearby.
    pub fn fit_beginning_with(
        &self,
        start: &Setting,
        parameters: &[FreeParameter],
        rounds: usize,
        mut columns: Option<&KnownColumns>,
    ) -> Option<Fitted> {
        let mut best = self.evaluate(self.inside(start.clone(), parameters))?;
        for _ in (0..rounds).take_while(|_| !self.deadline.has_passed()) {
            let before = best.objective;
            let columns = columns.take();
            let (problem, _) = LevenbergMarquardt::new()
                .with_ftol(1e-4)
                .with_xtol(1e-9)
                .with_stepbound(3.0)
                .minimize(Problem::new(self, parameters, &best, columns));
            if let Some(now) = problem.best().filter(|now| now.objective < best.objective) {
                best = now;
            }
            // Converged: the criterion fell by less than 2e-4 per row. A round with columns of
            // another fit does not tell.
            if columns.is_none() && before - best.objective < 2e-4 * best.rows() as f64 {
                break;
            }
        }
        Some(Fitted { parameters: parameters.to_vec(), ..best })
    }

    /// Returns the best of several starting points after a brief fit, best first. The criterion at
    /// a starting point predicts little; that after a round or two predicts most.
    pub fn leading(
        &self,
        starts: &[Setting],
        parameters: &[FreeParameter],
        rounds: usize,
        columns: Option<&KnownColumns>,
    ) -> Vec<Fitted> {
        let brief = |start: &Setting| self.fit_beginning_with(start, parameters, rounds, columns);
        let begun = starts.par_iter().filter(|_| !self.deadline.has_passed());
        foremost(begun.filter_map(brief).collect())
    }
}
