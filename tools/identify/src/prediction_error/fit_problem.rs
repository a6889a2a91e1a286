//! One round of a fit, as the Levenberg-Marquardt solver sees it.

use std::cell::RefCell;

use levenberg_marquardt::LeastSquaresProblem;
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};

use super::dataset::{Dataset, Fitted};
use super::free_parameter::FreeParameter;
use super::growing_basis::GrowingBasis;
use super::known_columns::KnownColumns;
use super::transmission_model::Setting;

/// Broyden updates after which the Jacobian is computed afresh.
const MOST_UPDATES: usize = 8;
/// Decrease of the criterion per row below which the Jacobian is computed afresh.
const LEAST_DECREASE: f64 = 1e-3;

/// Residuals of a round for which its basis has room: one at the start, one after each update of
/// the Jacobian, and some rejected ones.
const FURTHER: usize = 2 * MOST_UPDATES;

/// One round of a fit with constant weights.
pub(super) struct Problem<'a, 'b> {
    dataset: &'a Dataset<'b>,
    parameters: &'a [FreeParameter],
    weights: Vec<Vec<f64>>,
    open: DVector<f64>,
    now: Option<Evaluated>,
    /// The point before the last step, restored if the step is rejected.
    before: Option<(DVector<f64>, Option<Evaluated>)>,
    template: Setting,
    /// Coordinates of weighted residuals; none where the first Jacobian has none.
    basis: Option<GrowingBasis>,
    /// The latest Jacobian; none after the deadline.
    known: RefCell<Option<BroydenJacobian>>,
    /// Number of rows that the solver sees.
    rows: usize,
}

/// A point with the residual that the solver sees.
struct Evaluated {
    fitted: Fitted,
    /// Weighted residual, or its coordinates, and prior rows.
    rows: DVector<f64>,
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
    /// Number of residual rows before any projection.
    count: usize,
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
        let gained = (self.objective - objective) / self.count as f64;
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
    /// A round from the best point so far, with weights from its residuals; the Jacobian begins
    /// with `columns`, or is computed.
    pub(super) fn new(
        dataset: &'a Dataset<'b>,
        parameters: &'a [FreeParameter],
        best: &Fitted,
        columns: Option<&KnownColumns>,
    ) -> Self {
        let open = parameters.iter().map(|own| own.unbounded(dataset.model, &best.setting));
        let weights = Dataset::weights(&best.residuals);
        let first = (!dataset.deadline.has_passed()).then(|| match columns {
            Some(columns) => columns.jacobian(dataset, best, parameters, &weights),
            None => dataset.jacobian(best, parameters, &weights),
        });
        let basis = first.as_ref().and_then(|first| GrowingBasis::of(first, FURTHER));
        let first = first.map(|first| match &basis {
            Some(basis) => basis.of_columns(&first),
            None => first,
        });
        let mut problem = Self {
            dataset,
            parameters,
            weights,
            open: DVector::from_iterator(parameters.len(), open),
            now: None,
            before: None,
            template: best.setting.clone(),
            basis,
            known: RefCell::new(None),
            rows: 0,
        };
        let start = problem.seen(best.clone());
        problem.rows = start.rows.len();
        problem.known = RefCell::new(first.map(|first| problem.known_at(&start, first)));
        problem.now = Some(start);
        problem
    }

    /// The best point of the round: the solver may end on a rejected step.
    pub(super) fn best(self) -> Option<Fitted> {
        let kept = self.before.and_then(|(_, evaluated)| evaluated);
        let all = [self.now, kept].into_iter().flatten().map(|evaluated| evaluated.fitted);
        all.min_by(|a, b| a.objective.total_cmp(&b.objective))
    }
}

impl Problem<'_, '_> {
    /// The Jacobian at the start, with the prior rows.
    fn known_at(&self, start: &Evaluated, first: DMatrix<f64>) -> BroydenJacobian {
        let data = first.nrows();
        let mut jacobian = first.resize_vertically(self.rows, 0.0);
        let of_declared =
            self.parameters.iter().enumerate().filter(|(_, parameter)| parameter.is_base());
        for (row, (column, parameter)) in of_declared.enumerate() {
            jacobian[(data + row, column)] =
                self.dataset.off_slope(parameter, &start.fitted.setting);
        }
        BroydenJacobian {
            open: self.open.clone(),
            rows: start.rows.clone(),
            objective: start.fitted.objective,
            count: start.fitted.rows() + self.declared().count(),
            jacobian,
            steps: 0,
        }
    }

    /// A point with its weighted residual and prior rows.
    fn seen(&mut self, fitted: Fitted) -> Evaluated {
        let stacked = Dataset::stack(&fitted.residuals, &self.weights);
        let data = match &mut self.basis {
            Some(basis) => basis.coordinates(&stacked),
            None => stacked,
        };
        let off: Vec<f64> =
            self.declared().map(|index| self.dataset.off(&fitted.setting, index)).collect();
        let count = data.len();
        let mut rows = data.resize_vertically(count + off.len(), 0.0);
        rows.rows_mut(count, off.len()).copy_from_slice(&off);
        Evaluated { fitted, rows }
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
            Some((known, evaluated)) if known == *open => {
                self.now = evaluated;
                return;
            }
            _ => {}
        }
        let mut setting = self.template.clone();
        for (parameter, open) in self.parameters.iter().zip(open.iter()) {
            parameter.set_unbounded(self.dataset.model, &mut setting, *open);
        }
        let fitted = self.dataset.evaluate(setting);
        self.now = fitted.map(|fitted| self.seen(fitted));
    }

    fn params(&self) -> DVector<f64> {
        self.open.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        // A step that cannot be simulated is rejected, not an error.
        let rejected = || DVector::from_element(self.rows, 1e6);
        Some(self.now.as_ref().map_or_else(rejected, |now| now.rows.clone()))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let now = self.now.as_ref().filter(|_| !self.dataset.deadline.has_passed())?;
        let mut known = self.known.borrow_mut();
        let known = known.as_mut()?;
        let holds = known.open == self.open
            || known.update(&self.open, now.rows.clone(), now.fitted.objective);
        holds.then(|| known.jacobian.clone())
    }
}
