//! Maximum-likelihood fit by Levenberg-Marquardt, with one noise variance per record and channel.
//!
//! The criterion is the concentrated negative log-likelihood of independent residuals of unknown
//! variance, `Σ ½ M ln(mean e²)` over records and channels. Weights are the inverse rms of the last
//! residuals, held during a Levenberg-Marquardt round. Bounds are enforced by a change of variable
//! ([`super::free_parameter`]); one prior row per declared parameter keeps unidentifiable ones near
//! their declared values.

use std::f64::consts::FRAC_PI_2;

use levenberg_marquardt::LevenbergMarquardt;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::fit_problem::Problem;
use super::free_parameter::FreeParameter;
use super::known_columns::KnownColumns;
use super::transmission_model::{Residual, Setting, TransmissionModel};
use crate::deadline::{Deadline, NEVER};
use crate::equation_error::block_roles::Role;

/// A root-mean-square sensitivity of the weighted residual below this counts as zero.
const INSENSITIVE: f64 = 1e-6;
/// Weight of the prior at the edge of the tolerance (standard deviations). Neighbouring residual
/// rows are correlated: some tens of them carry as much information as one independent row.
const PRIOR_WEIGHT: f64 = 5.0;

/// Number of starting points that are continued after a brief fit.
pub(super) const LEADING: usize = 3;

/// A model and the records on which it is evaluated.
#[derive(Clone, Debug)]
pub struct Dataset<'a> {
    /// Model and records.
    pub model: &'a TransmissionModel,
    /// Indices of the records.
    pub records: Vec<usize>,
    /// When fits end with the best found so far.
    pub deadline: &'a Deadline,
}

/// A setting with its residuals.
#[derive(Clone, Debug, Default)]
pub struct Fitted {
    /// The setting.
    pub setting: Setting,
    /// Residuals of the dataset's records, in its order.
    pub residuals: Vec<Residual>,
    /// Negative log-likelihood with the prior, up to a constant.
    pub objective: f64,
    /// The parameters that were estimated, declared ones first; none where it was not fitted.
    pub parameters: Vec<FreeParameter>,
}

impl Fitted {
    /// Number of residual rows over all channels.
    pub fn rows(&self) -> usize {
        self.residuals.iter().flat_map(|residual| &residual.channels).map(Vec::len).sum()
    }

    /// The estimated parameters that belong to effects.
    pub fn of_effects(&self) -> impl Iterator<Item = &FreeParameter> {
        self.parameters.iter().filter(|parameter| !parameter.is_base())
    }
}

impl<'a> Dataset<'a> {
    /// The records of one role.
    pub fn of(model: &'a TransmissionModel, role: Role) -> Self {
        Self { model, records: model.of_role(role), deadline: &NEVER }
    }

    /// All records.
    pub fn whole(model: &'a TransmissionModel) -> Self {
        Self { model, records: (0..model.records.len()).collect(), deadline: &NEVER }
    }

    /// Ends fits at a deadline.
    #[must_use]
    pub fn until(self, deadline: &'a Deadline) -> Self {
        Self { deadline, ..self }
    }
}

impl Dataset<'_> {
    /// Leaves out some records.
    #[must_use]
    pub fn without(mut self, records: &[usize]) -> Self {
        self.records.retain(|record| !records.contains(record));
        self
    }

    /// Returns the residuals of all records; `None` if one cannot be simulated.
    pub fn residuals(&self, setting: &Setting) -> Option<Vec<Residual>> {
        self.records.par_iter().map(|record| self.model.residual(setting, *record)).collect()
    }

    /// Moves parameters at their bounds to the largest normalised value that a fit reaches, so that
    /// the first step does not jump.
    pub fn inside(&self, mut setting: Setting, parameters: &[FreeParameter]) -> Setting {
        for parameter in parameters {
            let open = parameter.unbounded(self.model, &setting);
            parameter.set_unbounded(self.model, &mut setting, open);
        }
        setting
    }

    /// Evaluates a setting without fitting.
    pub fn evaluate(&self, setting: Setting) -> Option<Fitted> {
        let residuals = self.residuals(&setting)?;
        let objective = objective(&residuals) + self.prior(&setting);
        Some(Fitted { setting, residuals, objective, parameters: Vec::new() })
    }

    fn prior(&self, setting: &Setting) -> f64 {
        (0..self.model.base.len()).map(|index| 0.5 * self.off(setting, index).powi(2)).sum()
    }

    /// Prior row: weighted deviation of a declared parameter from its declared value, relative to
    /// its tolerance.
    pub(super) fn off(&self, setting: &Setting, index: usize) -> f64 {
        let parameter = &self.model.base[index];
        parameter.declared.map_or(0.0, |declared| {
            PRIOR_WEIGHT * 2.0 * (setting.base[index] - declared) / (parameter.high - parameter.low)
        })
    }

    /// Derivative of the prior row with respect to the unbounded variable; 0 for others.
    pub(super) fn off_slope(&self, parameter: &FreeParameter, setting: &Setting) -> f64 {
        match parameter {
            // Derivative of `sin(u)`; the declared value is at, or near, the middle of the range.
            FreeParameter::Base(index) if self.model.base[*index].declared.is_some() => {
                PRIOR_WEIGHT * parameter.unbounded(self.model, setting).cos()
            }
            _ => 0.0,
        }
    }

    /// Returns the weight of every record and channel: the inverse rms of its residual.
    pub fn weights(residuals: &[Residual]) -> Vec<Vec<f64>> {
        let weight =
            |channel: &Vec<f64>| 1.0 / super::record::rms(channel.iter().copied()).max(1e-9);
        residuals.iter().map(|residual| residual.channels.iter().map(weight).collect()).collect()
    }

    /// Stacks weighted residuals into one column.
    pub fn stack(residuals: &[Residual], weights: &[Vec<f64>]) -> DVector<f64> {
        let rows = residuals.iter().zip(weights).flat_map(|(residual, weights)| {
            residual
                .channels
                .iter()
                .zip(weights)
                .flat_map(|(channel, weight)| channel.iter().map(move |row| weight * row))
        });
        DVector::from_vec(rows.collect())
    }

    /// Returns the Jacobian of the weighted residual by finite differences; a column is 0 where the
    /// perturbed model diverges, so that the parameter stays.
    pub fn jacobian(
        &self,
        fitted: &Fitted,
        parameters: &[FreeParameter],
        weights: &[Vec<f64>],
    ) -> DMatrix<f64> {
        let here = Self::stack(&fitted.residuals, weights);
        let moved: Vec<(Setting, f64)> = parameters
            .iter()
            .map(|parameter| {
                let mut setting = fitted.setting.clone();
                let (from, to) = (
                    parameter.unbounded(self.model, &setting),
                    parameter.perturbed(self.model, &setting),
                );
                parameter.set_unbounded(self.model, &mut setting, to);
                (setting, to - from)
            })
            .collect();
        let jobs: Vec<(usize, usize)> = (0..parameters.len())
            .flat_map(|parameter| self.records.iter().map(move |record| (parameter, *record)))
            .collect();
        let mut residuals = jobs
            .par_iter()
            .map(|(parameter, record)| self.model.residual(&moved[*parameter].0, *record))
            .collect::<Vec<Option<Residual>>>()
            .into_iter();
        let mut jacobian = DMatrix::zeros(here.len(), parameters.len());
        for (parameter, (_, aside)) in moved.iter().enumerate() {
            let of_parameter: Vec<Option<Residual>> =
                residuals.by_ref().take(self.records.len()).collect();
            if let Some(of_parameter) = of_parameter.into_iter().collect::<Option<Vec<Residual>>>()
            {
                jacobian.set_column(
                    parameter,
                    &((Self::stack(&of_parameter, weights) - &here) / *aside),
                );
            }
        }
        jacobian
    }

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
        let (mut normal, mut gradient) =
            (jacobian.transpose() * jacobian, jacobian.transpose() * rows);
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
            match problem.best() {
                Some(now) if now.objective < best.objective => best = now,
                _ if columns.is_none() => break,
                _ => {}
            }
            // Converged: the criterion fell by less than 2e-4 per row.
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
        let mut begun: Vec<Fitted> = begun.filter_map(brief).collect();
        begun.sort_by(|a, b| a.objective.total_cmp(&b.objective));
        begun.truncate(LEADING);
        begun
    }
}

/// `Σ ½ M ln(mean e²)`.
pub fn objective(residuals: &[Residual]) -> f64 {
    let one = |channel: &Vec<f64>| {
        channel.len() as f64 * super::record::rms(channel.iter().copied()).max(1e-9).ln()
    };
    residuals.iter().flat_map(|residual| &residual.channels).map(one).sum()
}

impl Dataset<'_> {
    /// Returns the standard deviation of each parameter's value from the sandwich covariance with
    /// scores summed over blocks of correlated rows; infinite where the parameter is not
    /// identifiable.
    pub fn deviations(&self, fitted: &Fitted, block: usize) -> Vec<(FreeParameter, f64)> {
        let parameters = &fitted.parameters;
        let weights = Self::weights(&fitted.residuals);
        let jacobian = self.jacobian(fitted, parameters, &weights);
        let rows = Self::stack(&fitted.residuals, &weights);
        let normal = jacobian.transpose() * &jacobian;
        let unseen = INSENSITIVE * INSENSITIVE * jacobian.nrows() as f64;
        let seen: Vec<bool> = normal.diagonal().iter().map(|entry| *entry > unseen).collect();
        let ridge = DMatrix::from_diagonal(&normal.diagonal().map(|entry| 1e-9 * entry + 1e-12));
        let Some(factors) = (normal + ridge).cholesky() else {
            return parameters.iter().map(|own| (own.clone(), f64::INFINITY)).collect();
        };
        let inverse = factors.inverse();
        let mut spread = DMatrix::zeros(parameters.len(), parameters.len());
        let mut from = 0;
        for channel in fitted.residuals.iter().flat_map(|residual| &residual.channels) {
            for at in (0..channel.len()).step_by(block.max(1)) {
                let count = block.min(channel.len() - at);
                let part =
                    jacobian.rows(from + at, count).transpose() * rows.rows(from + at, count);
                spread += &part * part.transpose();
            }
            from += channel.len();
        }
        let covariance = &inverse * spread * &inverse;
        let by_value = |(index, parameter): (usize, &FreeParameter)| {
            // From the unbounded variable to the value.
            let mut moved = fitted.setting.clone();
            let (open, aside) =
                (parameter.unbounded(self.model, &moved), parameter.perturbed(self.model, &moved));
            let before = parameter.value(&moved);
            parameter.set_unbounded(self.model, &mut moved, aside);
            let slope = (parameter.value(&moved) - before) / (aside - open);
            // A parameter to which few blocks are sensitive has no spread among them; the
            // independent-rows variance is then the lower bound.
            let variance = covariance[(index, index)].max(inverse[(index, index)]);
            let known =
                if seen[index] { variance.max(0.0).sqrt() * slope.abs() } else { f64::INFINITY };
            (parameter.clone(), known)
        };
        parameters.iter().enumerate().map(by_value).collect()
    }
}
