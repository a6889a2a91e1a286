//! Fits a structure: amplitudes by bounded least squares, shapes on a grid and then by
//! Levenberg-Marquardt.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};

use super::block_roles::Block;
use super::grid_prescreen::grid_prescreen;
use super::model::{Fitted, RegressionModel, Structure, residual};
use crate::effects::Shape;
use crate::regression::{Bound, Fit, Uncertainty, solve, uncertainty};

/// Shortest cluster of the sandwich covariance (s).
const CLUSTER_S: f64 = 0.2;
/// Shortest cluster in periods of the cut-off, much longer than the correlation caused by the
/// low-pass.
const CLUSTER_PERIODS: f64 = 8.0;

/// A grid with more points than this is first screened coarsely.
const LARGEST_GRID: usize = 24;

/// What to do with known nonlinear parameters (shapes).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShapeSearch {
    /// They are held.
    Fixed,
    /// They are the starting point of the refinement.
    Refine,
    /// As [`ShapeSearch::Refine`], without refinement: for a screening whose winners are refined
    /// elsewhere.
    GridOnly,
}

impl RegressionModel {
    /// Fits amplitudes and shapes on `blocks`. Shapes beyond the `known` ones are searched on their
    /// grid (amplitudes by bounded least squares at each point); the best point is refined by
    /// Levenberg-Marquardt on the projected residual. `None` where the columns are collinear in
    /// these rows.
    pub fn fit(
        &self,
        structure: &Structure<'_>,
        blocks: &[Block],
        known: &[f64],
        shape_search: ShapeSearch,
    ) -> Option<Fitted> {
        let shapes = self.shapes(structure);
        let bounds = self.bounds(structure);
        let mut values =
            self.search_grid(structure, blocks, &shapes, &bounds, (known, shape_search))?;
        if shape_search == ShapeSearch::Refine && shapes.iter().any(|s| s.points > 1) {
            values = self.refine(structure, blocks, &shapes, &bounds, values);
        }
        let columns = self.columns(structure, &values);
        let gram = self.gram(&columns, blocks);
        let fit = solve(&gram, &bounds)?;
        let scores = self.scores(&columns, &fit, blocks);
        let Uncertainty { std, correlation } = uncertainty(&gram, &fit, &scores);
        Some(Fitted { fit, std, correlation, shapes: values, columns, outputs: Vec::new() })
    }

    /// The best point of the grid over all shapes that are not known, and over the smoothing speed
    /// where something new depends on it.
    fn search_grid(
        &self,
        structure: &Structure<'_>,
        blocks: &[Block],
        shapes: &[Shape],
        bounds: &[Bound],
        (known, shape_search): (&[f64], ShapeSearch),
    ) -> Option<Vec<f64>> {
        let places = self.places(structure);
        let settled = places.iter().take_while(|place| place.end <= known.len().max(1)).count();
        // An effect without shapes counts as settled, but may be new all the same.
        let last_is_new = structure.effects.last().is_some_and(|e| e.declaration().uses_sign);
        let smoothing = match known.first() {
            Some(held) if shape_search == ShapeSearch::Fixed || !last_is_new => vec![*held],
            _ => grid(&shapes[..1]).into_iter().flatten().collect(),
        };
        if smoothing.len() == 1 && settled == structure.effects.len() {
            let rest = known.get(1..).unwrap_or(&[]);
            return Some([smoothing.as_slice(), rest].concat());
        }
        let from = places.get(settled).map_or(shapes.len(), |place| place.start);
        let mut best: Option<(f64, Vec<f64>)> = None;
        for smoothing in smoothing {
            let leading = [&[smoothing], known.get(1..from).unwrap_or(&[])].concat();
            let before = Structure {
                effects: structure.effects[..settled].to_vec(),
                model: structure.model.clone(),
            };
            // The sign is that of the whole structure: the settled part alone may not need it.
            let signs: Vec<Vec<f64>> =
                self.balances.iter().map(|b| self.sign(structure, smoothing, b)).collect();
            let settled_columns = self.columns(&before, &leading);
            let mut points = grid(&shapes[from..]);
            if points.len() > LARGEST_GRID {
                points = grid_prescreen(
                    self,
                    structure,
                    blocks,
                    &before,
                    (&settled_columns, &signs, points),
                )?;
            }
            for own in points {
                let all = [leading.as_slice(), &own].concat();
                let columns: Vec<Vec<Vec<f64>>> = settled_columns
                    .iter()
                    .enumerate()
                    .map(|(record, done)| {
                        let new =
                            self.columns_from(settled, structure, (record, &signs[record]), &all);
                        [done.as_slice(), &new].concat()
                    })
                    .collect();
                let Some(fit) = solve(&self.gram(&columns, blocks), bounds) else { continue };
                if best.as_ref().is_none_or(|b| fit.squares < b.0) {
                    best = Some((fit.squares, all));
                }
            }
        }
        best.map(|b| b.1)
    }

    /// `Xᵀe` by clusters.
    fn scores(&self, columns: &[Vec<Vec<f64>>], fit: &Fit, blocks: &[Block]) -> Vec<DVector<f64>> {
        let mut scores = Vec::new();
        for block in blocks {
            let balance = &self.balances[block.record];
            let seconds = CLUSTER_S.max(CLUSTER_PERIODS / balance.cut_off);
            let length = ((seconds / balance.row_step()).ceil() as usize).max(1);
            let e = residual(&columns[block.record], &balance.force, &fit.coefficients, block);
            for (i, part) in e.chunks(length).enumerate() {
                let from = block.rows.start + i * length;
                scores.push(DVector::from_iterator(
                    fit.coefficients.len(),
                    columns[block.record]
                        .iter()
                        .map(|c| part.iter().zip(&c[from..]).map(|(e, x)| e * x).sum::<f64>()),
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
        let free: Vec<usize> = (0..shapes.len()).filter(|i| shapes[*i].points > 1).collect();
        let shares = free.iter().map(|i| shapes[*i].share(start[*i]));
        let shares = DVector::from_iterator(free.len(), shares);
        let problem = Projected {
            regression: self,
            structure,
            blocks,
            shapes,
            bounds,
            free,
            start: start.clone(),
            shares,
        };
        let before = problem.residuals().map_or(f64::INFINITY, |r| r.norm_squared());
        let (problem, _) = LevenbergMarquardt::new()
            .with_ftol(1e-6)
            .with_xtol(1e-4)
            .with_patience(8)
            .minimize(problem);
        let after = problem.residuals().map_or(f64::INFINITY, |r| r.norm_squared());
        if after < before { problem.values_at(&problem.shares) } else { start }
    }
}

/// All points of the grid.
fn grid(shapes: &[Shape]) -> Vec<Vec<f64>> {
    let mut points = vec![Vec::new()];
    for shape in shapes {
        let last = (shape.points.max(2) - 1) as f64;
        let values: Vec<f64> =
            (0..shape.points.max(1)).map(|k| shape.at(k as f64 / last)).collect();
        points = points
            .iter()
            .flat_map(|p| values.iter().map(|v| [p.as_slice(), &[*v]].concat()))
            .collect();
    }
    points
}

/// The residual as a function of the shapes alone, with the amplitudes solved for at each point
/// (variable projection). Shapes are expressed as fractions of their range.
struct Projected<'a> {
    regression: &'a RegressionModel,
    structure: &'a Structure<'a>,
    blocks: &'a [Block],
    shapes: &'a [Shape],
    bounds: &'a [Bound],
    free: Vec<usize>,
    start: Vec<f64>,
    shares: DVector<f64>,
}

impl Projected<'_> {
    fn values_at(&self, shares: &DVector<f64>) -> Vec<f64> {
        let mut values = self.start.clone();
        for (i, share) in self.free.iter().zip(shares.iter()) {
            values[*i] = self.shapes[*i].at(*share);
        }
        values
    }
    fn residuals_at(&self, shares: &DVector<f64>) -> Option<DVector<f64>> {
        let columns = self.regression.columns(self.structure, &self.values_at(shares));
        let fit = solve(&self.regression.gram(&columns, self.blocks), self.bounds)?;
        let mut all = Vec::new();
        for block in self.blocks {
            let balance = &self.regression.balances[block.record];
            all.extend(residual(&columns[block.record], &balance.force, &fit.coefficients, block));
        }
        Some(DVector::from_vec(all))
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Projected<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, shares: &DVector<f64>) {
        self.shares.copy_from(shares);
    }
    fn params(&self) -> DVector<f64> {
        self.shares.clone()
    }
    fn residuals(&self) -> Option<DVector<f64>> {
        self.residuals_at(&self.shares)
    }
    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let here = self.residuals()?;
        let mut jacobian = DMatrix::zeros(here.len(), self.shares.len());
        for (k, i) in self.free.iter().enumerate() {
            // A fiftieth of the distance to the next point of the grid, inward at the upper end.
            let step = 0.02 / (self.shapes[*i].points - 1) as f64;
            let step = if self.shares[k] + step > 1.0 { -step } else { step };
            let mut moved = self.shares.clone();
            moved[k] += step;
            jacobian.set_column(k, &((self.residuals_at(&moved)? - &here) / step));
        }
        Some(jacobian)
    }
}
