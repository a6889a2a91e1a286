//! A linear model with a few nonlinear shapes, and its fit.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};

use super::signals::Balance;
use super::split::Block;
use crate::effects::{Declared, InverseEffect, Shape, Speeds, Term, Units};
use crate::regression::{Bound, Fit, Gram, solve, standard_deviations};

/// A declared parameter as a column of the regression.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Name, as in the rig file.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Declared value.
    pub declared: f64,
    /// Half the width of the range in which the value is believed to lie.
    pub spread: f64,
    /// What it multiplies.
    pub column: Column,
}

/// What a declared parameter multiplies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// Acceleration: mass or inertia.
    Acceleration,
    /// Velocity: viscous friction.
    Velocity,
    /// Smoothed sign of the velocity: Coulomb friction, where the rig file declares it.
    Sign,
    /// One: a constant force.
    One,
}

/// The machine and its records, before any effect.
pub struct Machine {
    /// Records, ready for regression.
    pub balances: Vec<Balance>,
    /// Declared parameters.
    pub parameters: Vec<Parameter>,
    /// Units of the axis.
    pub units: Units,
    /// How fast the records move.
    pub speeds: Speeds,
}

/// The declared model with the effects that were added to it.
#[derive(Clone)]
pub struct Structure<'a> {
    /// In the order in which they were added.
    pub effects: Vec<&'a dyn InverseEffect>,
}

/// A fitted structure.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Amplitudes: declared parameters first, then the effects' terms.
    pub fit: Fit,
    /// Their standard deviations.
    pub std: Vec<f64>,
    /// Smoothing speed first, then the effects' shapes.
    pub shapes: Vec<f64>,
    /// Columns by record, at these shapes.
    pub columns: Vec<Vec<Vec<f64>>>,
}

/// Clusters of the sandwich last this long [s]: eight periods of the cut-off, far beyond what the low-pass correlates.
const CLUSTER_S: f64 = 0.2;

impl Machine {
    /// Whether anything in the structure depends on the smoothed sign.
    fn uses_sign(&self, structure: &Structure<'_>) -> bool {
        !structure.effects.is_empty() || self.parameters.iter().any(|p| p.column == Column::Sign)
    }

    /// The smoothing speed of the sign, then the shapes of the effects.
    pub fn shapes(&self, structure: &Structure<'_>) -> Vec<Shape> {
        let mut shapes = vec![Shape {
            name: "smoothing_speed".into(),
            unit: self.units.velocity.into(),
            low: 1e-3 * self.speeds.rms,
            high: 0.3 * self.speeds.rms,
            points: if self.uses_sign(structure) { 7 } else { 1 },
        }];
        shapes.extend(structure.effects.iter().flat_map(|e| e.shapes(&self.units, &self.speeds)));
        shapes
    }

    /// The effects' terms in order.
    pub fn terms(&self, structure: &Structure<'_>) -> Vec<Term> {
        structure.effects.iter().filter(|e| e.lifts().is_none()).flat_map(|e| e.terms(&self.units)).collect()
    }

    /// Bounds of all amplitudes: tolerances of declared parameters unless an effect lifts them, physical
    /// limits of effects.
    pub fn bounds(&self, structure: &Structure<'_>) -> Vec<Bound> {
        let lifted = |column| {
            structure.effects.iter().any(|e| {
                matches!(
                    (e.lifts(), column),
                    (Some(Declared::Mass), Column::Acceleration) | (Some(Declared::Viscous), Column::Velocity)
                )
            })
        };
        let declared = self.parameters.iter().map(|p| match p.column {
            // Mass and damping below 0 are no machine, whatever the tolerance.
            Column::One => (p.declared - p.spread, p.declared + p.spread),
            column if lifted(column) => (0.0, f64::INFINITY),
            _ => ((p.declared - p.spread).max(0.0), p.declared + p.spread),
        });
        declared.chain(self.terms(structure).into_iter().map(|t| t.bound)).collect()
    }

    fn columns_of(&self, structure: &Structure<'_>, shapes: &[f64], balance: &Balance) -> Vec<Vec<f64>> {
        let signals = &balance.signals;
        let smoothing = shapes.first().copied().unwrap_or(1.0);
        let sign = if self.uses_sign(structure) { signals.sign(smoothing) } else { Vec::new() };
        let mut columns: Vec<Vec<f64>> = self
            .parameters
            .iter()
            .map(|p| match p.column {
                Column::Acceleration => signals.rows(&signals.acceleration),
                Column::Velocity => signals.rows(&signals.velocity),
                Column::Sign => signals.low_passed_rows(&sign),
                Column::One => vec![1.0; balance.rows()],
            })
            .collect();
        let mut used = 1;
        for effect in &structure.effects {
            let count = effect.shapes(&self.units, &self.speeds).len();
            let own = shapes.get(used..used + count).unwrap_or(&[]);
            used += count;
            columns.extend(effect.columns(signals, &sign, own).iter().map(|c| signals.low_passed_rows(c)));
        }
        columns
    }

    /// All columns of all records.
    pub fn columns(&self, structure: &Structure<'_>, shapes: &[f64]) -> Vec<Vec<Vec<f64>>> {
        self.balances.iter().map(|b| self.columns_of(structure, shapes, b)).collect()
    }

    fn gram(&self, columns: &[Vec<Vec<f64>>], blocks: &[Block]) -> Gram {
        let mut gram = Gram::empty(columns.first().map_or(0, Vec::len));
        for block in blocks {
            gram.add(&columns[block.record], &self.balances[block.record].force, block.rows.clone());
        }
        gram
    }

    /// Residual of a fitted structure over some rows.
    pub fn residual(&self, fitted: &Fitted, block: &Block) -> Vec<f64> {
        residual(&fitted.columns[block.record], &self.balances[block.record].force, &fitted.fit.coefficients, block)
    }

    /// Fits amplitudes and shapes on `blocks`: shapes on their grid (amplitudes by bounded least squares at each point), the
    /// best point refined by Levenberg-Marquardt on the projected residual. Shapes that are given in `fixed` are held
    /// there. `None` where the columns cannot be told apart in these rows.
    pub fn fit(&self, structure: &Structure<'_>, blocks: &[Block], fixed: Option<&[f64]>) -> Option<Fitted> {
        let shapes = self.shapes(structure);
        let bounds = self.bounds(structure);
        let try_at = |values: &[f64]| {
            let columns = self.columns(structure, values);
            let fit = solve(&self.gram(&columns, blocks), &bounds)?;
            Some((fit, columns))
        };
        let mut best: Option<(f64, Vec<f64>)> = None;
        for values in grid(&shapes, fixed) {
            if let Some((fit, _)) = try_at(&values)
                && best.as_ref().is_none_or(|b| fit.squares < b.0)
            {
                best = Some((fit.squares, values));
            }
        }
        let (_, mut values) = best?;
        if fixed.is_none() && shapes.iter().any(|s| s.points > 1) {
            values = self.refine(structure, blocks, &shapes, &bounds, values);
        }
        let (fit, columns) = try_at(&values)?;
        let gram = self.gram(&columns, blocks);
        let scores = self.scores(&columns, &fit, blocks);
        let std = standard_deviations(&gram, &fit, &scores);
        Some(Fitted { fit, std, shapes: values, columns })
    }

    /// `Xᵀe` by clusters of [`CLUSTER_S`].
    fn scores(&self, columns: &[Vec<Vec<f64>>], fit: &Fit, blocks: &[Block]) -> Vec<DVector<f64>> {
        let mut scores = Vec::new();
        for block in blocks {
            let balance = &self.balances[block.record];
            let length = ((CLUSTER_S / balance.row_step()).ceil() as usize).max(1);
            let e = residual(&columns[block.record], &balance.force, &fit.coefficients, block);
            for (i, part) in e.chunks(length).enumerate() {
                let from = block.rows.start + i * length;
                scores.push(DVector::from_iterator(
                    fit.coefficients.len(),
                    columns[block.record].iter().map(|c| part.iter().zip(&c[from..]).map(|(e, x)| e * x).sum::<f64>()),
                ));
            }
        }
        scores
    }

    fn refine(
        &self,
        structure: &Structure<'_>,
        blocks: &[Block],
        shapes: &[Shape],
        bounds: &[Bound],
        start: Vec<f64>,
    ) -> Vec<f64> {
        let problem = Projected {
            machine: self,
            structure,
            blocks,
            shapes,
            bounds,
            logs: DVector::from_iterator(start.len(), start.iter().map(|v| v.ln())),
        };
        let before = problem.residuals().map_or(f64::INFINITY, |r| r.norm_squared());
        let (problem, _) = LevenbergMarquardt::new().with_ftol(1e-6).with_xtol(1e-4).with_patience(8).minimize(problem);
        let after = problem.residuals().map_or(f64::INFINITY, |r| r.norm_squared());
        if after < before { problem.values() } else { start }
    }
}

fn residual(columns: &[Vec<f64>], force: &[f64], coefficients: &DVector<f64>, block: &Block) -> Vec<f64> {
    let mut e = force[block.rows.clone()].to_vec();
    for (column, amplitude) in columns.iter().zip(coefficients.iter()) {
        for (e, x) in e.iter_mut().zip(&column[block.rows.clone()]) {
            *e -= amplitude * x;
        }
    }
    e
}

/// All points of the grid; shapes that are given in `fixed` are held at their value.
fn grid(shapes: &[Shape], fixed: Option<&[f64]>) -> Vec<Vec<f64>> {
    let mut points = vec![Vec::new()];
    for (i, shape) in shapes.iter().enumerate() {
        let values: Vec<f64> = match fixed.and_then(|s| s.get(i)) {
            Some(v) => vec![*v],
            None if shape.points < 2 => vec![shape.low],
            None => {
                let ratio = shape.high / shape.low;
                (0..shape.points).map(|k| shape.low * ratio.powf(k as f64 / (shape.points - 1) as f64)).collect()
            }
        };
        points = points.iter().flat_map(|p| values.iter().map(|v| [p.as_slice(), &[*v]].concat())).collect();
    }
    points
}

/// The residual as a function of the logarithms of the shapes alone, amplitudes solved for inside (variable projection).
struct Projected<'a> {
    machine: &'a Machine,
    structure: &'a Structure<'a>,
    blocks: &'a [Block],
    shapes: &'a [Shape],
    bounds: &'a [Bound],
    logs: DVector<f64>,
}

impl Projected<'_> {
    fn values_at(&self, logs: &DVector<f64>) -> Vec<f64> {
        self.shapes.iter().zip(logs.iter()).map(|(s, l)| l.exp().clamp(s.low, s.high)).collect()
    }
    fn values(&self) -> Vec<f64> {
        self.values_at(&self.logs)
    }
    fn residuals_at(&self, logs: &DVector<f64>) -> Option<DVector<f64>> {
        let columns = self.machine.columns(self.structure, &self.values_at(logs));
        let fit = solve(&self.machine.gram(&columns, self.blocks), self.bounds)?;
        let mut all = Vec::new();
        for block in self.blocks {
            let balance = &self.machine.balances[block.record];
            all.extend(residual(&columns[block.record], &balance.force, &fit.coefficients, block));
        }
        Some(DVector::from_vec(all))
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Projected<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, logs: &DVector<f64>) {
        self.logs.copy_from(logs);
    }
    fn params(&self) -> DVector<f64> {
        self.logs.clone()
    }
    fn residuals(&self) -> Option<DVector<f64>> {
        self.residuals_at(&self.logs)
    }
    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let step = 0.02;
        let here = self.residuals()?;
        let mut jacobian = DMatrix::zeros(here.len(), self.logs.len());
        for k in 0..self.logs.len() {
            let mut moved = self.logs.clone();
            moved[k] += step;
            jacobian.set_column(k, &((self.residuals_at(&moved)? - &here) / step));
        }
        Some(jacobian)
    }
}
