//! The criterion of the fit: a model, the records on which it is evaluated, and its likelihood.
//!
//! The criterion is the concentrated negative log-likelihood of independent residuals of unknown
//! variance, `Σ ½ M ln(mean e²)` over records and channels, with one prior row per declared
//! parameter, which keeps unidentifiable ones near their declared values.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::free_parameter::FreeParameter;
use super::transmission_model::{Residual, Setting, TransmissionModel};
use crate::deadline::{Deadline, NEVER};
use crate::equation_error::block_roles::Role;

/// Weight of the prior at the edge of the tolerance (standard deviations). Neighbouring residual
/// rows are correlated: some tens of them carry as much information as one independent row.
pub(super) const PRIOR_WEIGHT: f64 = 5.0;

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
}

/// `Σ ½ M ln(mean e²)`.
pub fn objective(residuals: &[Residual]) -> f64 {
    let one = |channel: &Vec<f64>| {
        channel.len() as f64 * super::record::rms(channel.iter().copied()).max(1e-9).ln()
    };
    residuals.iter().flat_map(|residual| &residual.channels).map(one).sum()
}
