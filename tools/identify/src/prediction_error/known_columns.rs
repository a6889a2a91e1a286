//! Columns of a Jacobian with which fits from nearby points begin.

use nalgebra::{DMatrix, DVector};

use super::dataset::{Dataset, Fitted};
use super::free_parameter::FreeParameter;

/// The Jacobian of one fit, whose columns approximate those of other fits from the same values of
/// its parameters: a column costs one simulation of each record.
pub struct KnownColumns {
    /// Parameters of the columns.
    parameters: Vec<FreeParameter>,
    /// Jacobian of the weighted residual.
    pub jacobian: DMatrix<f64>,
    /// Weights of every record and channel.
    pub weights: Vec<Vec<f64>>,
}

impl KnownColumns {
    /// The columns of some parameters at a setting.
    pub fn at(dataset: &Dataset<'_>, fitted: &Fitted, parameters: &[FreeParameter]) -> Self {
        let weights = Dataset::weights(&fitted.residuals);
        let jacobian = dataset.jacobian(fitted, parameters, &weights);
        Self { parameters: parameters.to_vec(), jacobian, weights }
    }

    /// The Jacobian of some parameters near that setting, with other weights: columns that are not
    /// known are computed.
    pub fn jacobian(
        &self,
        dataset: &Dataset<'_>,
        fitted: &Fitted,
        parameters: &[FreeParameter],
        weights: &[Vec<f64>],
    ) -> DMatrix<f64> {
        let at = |own: &FreeParameter| self.parameters.iter().position(|known| known == own);
        let unknown: Vec<FreeParameter> =
            parameters.iter().filter(|own| at(own).is_none()).cloned().collect();
        let computed = dataset.jacobian(fitted, &unknown, weights);
        let mut computed = computed.column_iter();
        let factors = self.factors(fitted, weights);
        let mut all = DMatrix::zeros(self.jacobian.nrows(), parameters.len());
        for (column, own) in parameters.iter().enumerate() {
            if let Some(known) = at(own) {
                all.set_column(column, &self.jacobian.column(known).component_mul(&factors));
            } else if let Some(computed) = computed.next() {
                all.set_column(column, &computed);
            }
        }
        all
    }

    /// New weight over old of every row.
    fn factors(&self, fitted: &Fitted, weights: &[Vec<f64>]) -> DVector<f64> {
        let channels = fitted.residuals.iter().flat_map(|residual| &residual.channels);
        let new = weights.iter().flatten();
        let old = self.weights.iter().flatten();
        let rows = channels
            .zip(new.zip(old))
            .flat_map(|(channel, (new, old))| std::iter::repeat_n(new / old, channel.len()));
        DVector::from_vec(rows.collect())
    }
}
