//! One round of a fit, as the Levenberg-Marquardt solver sees it.

use std::cell::RefCell;

use levenberg_marquardt::LeastSquaresProblem;
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};

use super::dataset::{Dataset, Fitted};
use super::free_parameter::FreeParameter;
use super::known_columns::KnownColumns;
use super::transmission_model::Setting;

/// Broyden updates after which the Jacobian is computed afresh.
const MOST_UPDATES: usize = 8;
/// Decrease of the criterion per row below which the Jacobian is computed afresh.
const LEAST_DECREASE: f64 = 1e-3;

/// One round of a fit with constant weights.
pub(super) struct Problem<'a, 'b> {
    dataset: &'a Dataset<'b>,
    parameters: &'a [FreeParameter],
    weights: Vec<Vec<f64>>,
    open: DVector<f64>,
    now: Option<Fitted>,
    /// The point before the last step, restored if the step is rejected.
    before: Option<(DVector<f64>, Option<Fitted>)>,
    template: Setting,
    /// Columns with which the Jacobian begins.
    columns: Option<&'a KnownColumns>,
    /// The current Jacobian.
    known: RefCell<Option<BroydenJacobian>>,
}

/// A Jacobian with Broyden's rank-one updates: an update costs one simulation per record, a new
/// Jacobian one per record and parameter.
struct BroydenJacobian {
    /// Point at which it holds.
    open: DVector<f64>,
    /// Residual rows there.
    rows: DVector<f64>,
    /// Criterion there.
    objective: f64,
    jacobian: DMatrix<f64>,
    /// Updates since it was computed.
    steps: usize,
}

impl BroydenJacobian {
    /// Updates the Jacobian; `false` where it should be computed afresh, after too many updates or
    /// too small a decrease.
    fn update(&mut self, open: &DVector<f64>, rows: DVector<f64>, objective: f64) -> bool {
        let step = open - &self.open;
        let length = step.norm_squared();
        let gained = (self.objective - objective) / rows.len() as f64;
        if self.steps >= MOST_UPDATES || gained < LEAST_DECREASE || length <= f64::MIN_POSITIVE {
            return false;
        }
        let beyond = &rows - &self.rows - &self.jacobian * &step;
        self.jacobian.ger(1.0 / length, &beyond, &step, 1.0);
        (self.open, self.rows, self.objective) = (open.clone(), rows, objective);
        self.steps += 1;
        true
    }
}

impl<'a, 'b> Problem<'a, 'b> {
    /// A round from the best point so far, with weights from its residuals.
    pub(super) fn new(
        dataset: &'a Dataset<'b>,
        parameters: &'a [FreeParameter],
        best: &Fitted,
        columns: Option<&'a KnownColumns>,
    ) -> Self {
        let open = parameters.iter().map(|own| own.unbounded(dataset.model, &best.setting));
        Self {
            dataset,
            parameters,
            weights: Dataset::weights(&best.residuals),
            open: DVector::from_iterator(parameters.len(), open),
            now: Some(best.clone()),
            before: None,
            template: best.setting.clone(),
            columns,
            known: RefCell::new(None),
        }
    }

    /// The best point of the round: the solver may end on a rejected step.
    pub(super) fn best(self) -> Option<Fitted> {
        let kept = self.before.and_then(|(_, fitted)| fitted);
        let all = [self.now, kept].into_iter().flatten();
        all.min_by(|a, b| a.objective.total_cmp(&b.objective))
    }
}

impl Problem<'_, '_> {
    fn rows(&self) -> usize {
        let model = self.dataset.model;
        let of =
            |record: &usize| model.channels(*record).len() * model.records[*record].residual_rows();
        self.dataset.records.iter().map(of).sum::<usize>() + self.declared().count()
    }

    fn declared(&self) -> impl Iterator<Item = usize> {
        self.parameters.iter().filter_map(|parameter| match parameter {
            FreeParameter::Base(index) => Some(*index),
            _ => None,
        })
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_, '_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, open: &DVector<f64>) {
        if *open == self.open {
            return;
        }
        let left = (std::mem::replace(&mut self.open, open.clone()), self.now.take());
        match self.before.replace(left) {
            Some((known, fitted)) if known == *open => {
                self.now = fitted;
                return;
            }
            _ => {}
        }
        let mut setting = self.template.clone();
        for (parameter, open) in self.parameters.iter().zip(open.iter()) {
            parameter.set_unbounded(self.dataset.model, &mut setting, *open);
        }
        self.now = self.dataset.evaluate(setting);
    }

    fn params(&self) -> DVector<f64> {
        self.open.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        // A step that cannot be simulated is rejected, not an error.
        let Some(now) = self.now.as_ref() else {
            return Some(DVector::from_element(self.rows(), 1e6));
        };
        let rows = Dataset::stack(&now.residuals, &self.weights);
        let off: Vec<f64> =
            self.declared().map(|index| self.dataset.off(&now.setting, index)).collect();
        let data = rows.len();
        let mut all = rows.resize_vertically(data + off.len(), 0.0);
        for (row, off) in off.into_iter().enumerate() {
            all[data + row] = off;
        }
        Some(all)
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let now = self.now.as_ref().filter(|_| !self.dataset.deadline.has_passed())?;
        let rows = self.residuals()?;
        let mut known = self.known.borrow_mut();
        if let Some(known) = known.as_mut() {
            return known.update(&self.open, rows, now.objective).then(|| known.jacobian.clone());
        }
        let jacobian = match self.columns {
            Some(columns) => columns.jacobian(self.dataset, now, self.parameters, &self.weights),
            None => self.dataset.jacobian(now, self.parameters, &self.weights),
        };
        let data = jacobian.nrows();
        let mut all = jacobian.resize_vertically(data + self.declared().count(), 0.0);
        let of_declared =
            self.parameters.iter().enumerate().filter(|(_, parameter)| parameter.is_base());
        for (row, (column, parameter)) in of_declared.enumerate() {
            all[(data + row, column)] = self.dataset.off_slope(parameter, &now.setting);
        }
        *known = Some(BroydenJacobian {
            open: self.open.clone(),
            rows,
            objective: now.objective,
            jacobian: all.clone(),
            steps: 0,
        });
        Some(all)
    }
}
