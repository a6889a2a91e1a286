//! Fits a simulated model to measured outputs by Levenberg-Marquardt.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use rayon::prelude::*;

use super::simulation::{Force, Input, Oscillator, steps};
use crate::effects::Shape;
use crate::equation_error::block_roles::Block;
use crate::equation_error::model::{Column, Fitted, RegressionModel, Structure};
use crate::equation_error::signals::FINER;
use crate::regression::{Bound, Fit, Gram, uncertainty};
use crate::spectral::Spectrum;

/// A simulation whose output exceeds the largest measured output by this factor has diverged.
const LARGEST: f64 = 20.0;
/// Length of the clusters of the sandwich covariance, in decay times of the machine.
const CLUSTER_DECAYS: f64 = 4.0;

/// One record: measured output and oversampled input, both from the first row on.
pub struct Record {
    /// Output at the rows.
    pub output: Vec<f64>,
    /// Input.
    pub input: Input,
    /// Position and velocity at the first row.
    pub start: (f64, f64),
    largest: f64,
}

impl Record {
    /// From the columns of one record, of which `rows` samples from sample `first` on are used,
    /// with position and velocity at that sample. `natural` is the highest natural frequency to be
    /// expected (rad/s). `None` if the input has no transform.
    pub fn new(
        time: &[f64],
        (input, output): (&[f64], &[f64]),
        (first, rows): (usize, usize),
        start: (f64, f64),
        natural: f64,
    ) -> Option<Self> {
        let sampling = (time.last()? - time.first()?) / (time.len() - 1) as f64;
        let steps = steps(natural, sampling);
        let fine = Spectrum::of(input)?.wave(2 * steps, 0, 1.0 / sampling, |_| 1.0)?;
        let values = fine.get(2 * steps * first..=2 * steps * (first + rows - 1))?.to_vec();
        let output = output.get(first..first + rows)?.to_vec();
        let largest = LARGEST * output.iter().fold(0.0f64, |top, y| top.max(y.abs()));
        let input =
            Input { values, steps, step: sampling / steps as f64, start: *time.get(first)? };
        Some(Self { output, input, start, largest })
    }

    /// The sample of the first row of a force balance of band-limited signals.
    pub fn first_sample(before_rows: usize) -> usize {
        before_rows / FINER
    }
}

/// Declared model and records, shared by the fits of all structures.
pub struct OutputErrorModel<'a> {
    /// The model of the equation-error method: parameters, bounds and scales.
    pub regression: &'a RegressionModel,
    /// The records to be simulated.
    pub records: &'a [Record],
}

impl OutputErrorModel<'_> {
    /// Output less simulated output, over some rows.
    pub fn residual(&self, outputs: &[Vec<f64>], block: &Block) -> Vec<f64> {
        let (measured, model) = (&self.records[block.record].output, &outputs[block.record]);
        block.rows.clone().map(|row| measured[row] - model[row]).collect()
    }

    /// Sum of squared output errors on `blocks` at some values of the parameters. `None` if the
    /// model cannot be simulated there.
    pub fn squares(&self, structure: &Structure<'_>, blocks: &[Block], at: &Fitted) -> Option<f64> {
        Problem::new(self, structure, blocks, at, &[]).here.map(|errors| errors.norm_squared())
    }

    /// Fits amplitudes and shapes on `blocks`, starting from `start`. The terms of the structure
    /// with the indices `without` stay at 0. `None` if the model cannot be simulated at the start.
    pub fn fit(
        &self,
        structure: &Structure<'_>,
        blocks: &[Block],
        start: &Fitted,
        without: &[usize],
    ) -> Option<Fitted> {
        let problem = Problem::new(self, structure, blocks, start, without);
        let before = problem.residuals()?.norm_squared();
        let first = problem.moved.clone();
        let lm = LevenbergMarquardt::new().with_ftol(1e-5).with_xtol(1e-4).with_patience(8);
        let (mut problem, _) = lm.minimize(problem);
        let after = problem.residuals().map_or(f64::INFINITY, |r| r.norm_squared());
        if after.is_nan() || after > before {
            problem.set_params(&first);
        }
        problem.finish()
    }
}

/// Output error as a function of the deviation of each free parameter from its start, in units of
/// its own size.
struct Problem<'a> {
    simulation: &'a OutputErrorModel<'a>,
    structure: &'a Structure<'a>,
    blocks: &'a [Block],
    start: Fitted,
    shapes: Vec<Shape>,
    bounds: Vec<Bound>,
    /// Free amplitudes: index and size.
    amplitudes: Vec<(usize, f64)>,
    /// Free shapes: indices.
    free_shapes: Vec<usize>,
    moved: DVector<f64>,
    /// Residuals at `moved`; `None` if it cannot be simulated.
    here: Option<DVector<f64>>,
}

impl<'a> Problem<'a> {
    fn new(
        simulation: &'a OutputErrorModel<'a>,
        structure: &'a Structure<'a>,
        blocks: &'a [Block],
        start: &Fitted,
        without: &[usize],
    ) -> Self {
        let regression = simulation.regression;
        let (shapes, mut bounds) = (regression.shapes(structure), regression.bounds(structure));
        let mut start = start.clone();
        for term in without {
            let at = regression.parameters.len() + term;
            bounds[at] = (0.0, 0.0);
            start.fit.coefficients[at] = 0.0;
        }
        let amplitudes: Vec<(usize, f64)> = (0..bounds.len())
            .filter(|i| bounds[*i].0 < bounds[*i].1)
            .map(|i| {
                let spread = regression.parameters.get(i).map_or(0.0, |p| 0.1 * p.spread);
                let size = start.fit.coefficients[i].abs().max(start.std[i]).max(spread);
                (i, if size > 0.0 && size.is_finite() { size } else { 1.0 })
            })
            .collect();
        let free_shapes: Vec<usize> = (0..shapes.len()).filter(|i| shapes[*i].points > 1).collect();
        let moved = DVector::zeros(amplitudes.len() + free_shapes.len());
        let mut problem = Self {
            simulation,
            structure,
            blocks,
            start,
            shapes,
            bounds,
            amplitudes,
            free_shapes,
            moved,
            here: None,
        };
        problem.here = problem.residuals_at(&problem.moved);
        problem
    }

    /// Amplitudes and shapes at a deviation from the start.
    fn values(&self, moved: &DVector<f64>) -> (DVector<f64>, Vec<f64>) {
        let mut coefficients = self.start.fit.coefficients.clone();
        let mut shapes = self.start.shapes.clone();
        for ((i, size), moved) in self.amplitudes.iter().zip(moved.iter()) {
            coefficients[*i] =
                (coefficients[*i] + size * moved).clamp(self.bounds[*i].0, self.bounds[*i].1);
        }
        for (i, moved) in self.free_shapes.iter().zip(moved.iter().skip(self.amplitudes.len())) {
            let shape = &self.shapes[*i];
            // One unit is the distance between two points of the grid.
            let share = shape.share(shapes[*i]) + moved / (shape.points - 1) as f64;
            shapes[*i] = shape.at(share);
        }
        (coefficients, shapes)
    }

    /// The deviation, limited to the bounds and ranges.
    fn within(&self, moved: &DVector<f64>) -> DVector<f64> {
        let mut inside = moved.clone();
        for (k, (i, size)) in self.amplitudes.iter().enumerate() {
            let (start, bound) = (self.start.fit.coefficients[*i], self.bounds[*i]);
            inside[k] = moved[k].clamp((bound.0 - start) / size, (bound.1 - start) / size);
        }
        for (k, i) in self.free_shapes.iter().enumerate() {
            let (shape, k) = (&self.shapes[*i], k + self.amplitudes.len());
            let (start, last) = (shape.share(self.start.shapes[*i]), (shape.points - 1) as f64);
            inside[k] = moved[k].clamp(-start * last, (1.0 - start) * last);
        }
        inside
    }

    /// The declared parameter of a column; 0 where none is declared.
    fn declared(&self, column: Column, coefficients: &DVector<f64>) -> f64 {
        let at = self.simulation.regression.parameters.iter().position(|p| p.column == column);
        at.map_or(0.0, |i| coefficients[i])
    }

    fn simulate(&self, moved: &DVector<f64>) -> Option<Vec<Vec<f64>>> {
        let regression = self.simulation.regression;
        let (coefficients, shapes) = self.values(moved);
        let of = |column| self.declared(column, &coefficients);
        let mut forces = Vec::new();
        let mut amplifiers = Vec::new();
        let mut at = regression.parameters.len();
        let mut dry = of(Column::Sign);
        for (effect, place) in self.structure.effects.iter().zip(regression.places(self.structure))
        {
            let terms = regression.terms_of(*effect).len();
            let (amplitudes, shapes) =
                (coefficients.as_slice()[at..at + terms].to_vec(), shapes[place].to_vec());
            at += terms;
            if effect.declaration().uses_sign {
                // Friction in proportion to the load counts at its largest.
                let load = match effect.declaration().uses_model {
                    true => regression.axis.force_peak,
                    false => 1.0,
                };
                dry += load * amplitudes.iter().map(|a| a.abs()).sum::<f64>();
            }
            match (effect.is_force(), effect.declaration().deliver) {
                _ if terms == 0 => {}
                (true, _) => forces.push(Force { effect: *effect, amplitudes, shapes }),
                (false, deliver) => amplifiers.extend(deliver.map(|own| (own, amplitudes, shapes))),
            }
        }
        let mass = of(Column::Acceleration);
        let run = |record: &Record| {
            let step = record.input.step;
            let mut delivered = None;
            for (deliver, amplitudes, shapes) in &amplifiers {
                let command = delivered.as_ref().unwrap_or(&record.input.values);
                delivered = Some(deliver(command, 0.5 * step, amplitudes, shapes));
            }
            let input = delivered.map(|values| Input { values, ..record.input.clone() });
            let uses_sign = regression.uses_sign(self.structure);
            let oscillator = Oscillator {
                mass,
                damping: of(Column::Velocity),
                stiffness: of(Column::Position),
                coulomb: of(Column::Sign),
                offset: of(Column::One),
                // With a narrower transition, friction would be too stiff for the explicit
                // integration.
                smoothing: uses_sign.then_some(shapes[0].max(dry * step / mass)),
                forces: forces.clone(),
            };
            oscillator.run(input.as_ref().unwrap_or(&record.input), record.start, record.largest)
        };
        if mass <= 0.0 {
            return None;
        }
        self.simulation.records.iter().map(run).collect()
    }

    fn errors(&self, outputs: &[Vec<f64>]) -> DVector<f64> {
        let error = |block| self.simulation.residual(outputs, block);
        DVector::from_vec(self.blocks.iter().flat_map(error).collect())
    }

    fn residuals_at(&self, moved: &DVector<f64>) -> Option<DVector<f64>> {
        self.simulate(moved).map(|outputs| self.errors(&outputs))
    }

    /// Perturbation of a free parameter for a finite difference: a thousandth of its size, away
    /// from the bound.
    fn difference(&self, k: usize) -> f64 {
        let step = 1e-3;
        let (coefficients, shapes) = self.values(&self.moved);
        let inward = match self.amplitudes.get(k) {
            Some((i, size)) => coefficients[*i] + step * size > self.bounds[*i].1,
            None => {
                let i = self.free_shapes[k - self.amplitudes.len()];
                let shape = &self.shapes[i];
                shape.share(shapes[i]) + step / (shape.points - 1) as f64 > 1.0
            }
        };
        if inward { -step } else { step }
    }

    fn finish(self) -> Option<Fitted> {
        let outputs = self.simulate(&self.moved)?;
        let errors = self.errors(&outputs);
        let jacobian = self.jacobian()?;
        let (coefficients, shapes) = self.values(&self.moved);
        let at_edge = |i: usize| {
            let (low, high) = self.bounds[i];
            coefficients[i] <= low || coefficients[i] >= high
        };
        let n = self.moved.len();
        let edge = |k: usize| self.amplitudes.get(k).is_some_and(|(i, _)| at_edge(*i));
        let columns: Vec<Vec<f64>> =
            (0..n).map(|k| jacobian.column(k).iter().map(|j| -j).collect()).collect();
        let mut gram = Gram::empty(n);
        gram.add(&columns, errors.as_slice(), 0..errors.len());
        let local = Fit {
            coefficients: DVector::zeros(n),
            // Nor has a parameter without influence on the output a standard deviation.
            at_bound: (0..n).map(|k| edge(k) || columns[k].iter().all(|c| *c == 0.0)).collect(),
            squares: errors.norm_squared(),
        };
        let scores = self.scores(&columns, &errors, &coefficients);
        let local = uncertainty(&gram, &local, &scores);
        let count = self.bounds.len();
        let (mut std, mut correlation) = (vec![0.0; count], DMatrix::zeros(count, count));
        for (k, (i, size)) in self.amplitudes.iter().enumerate() {
            std[*i] = local.std[k] * size;
            for (l, (j, _)) in self.amplitudes.iter().enumerate() {
                correlation[(*i, *j)] = local.correlation[(k, l)];
            }
        }
        let fit = Fit {
            at_bound: (0..self.bounds.len()).map(at_edge).collect(),
            coefficients: coefficients.clone(),
            squares: errors.norm_squared(),
        };
        Some(Fitted { fit, std, correlation, shapes, columns: Vec::new(), outputs })
    }

    /// `Jᵀe` by clusters longer than the memory of the machine.
    fn scores(
        &self,
        columns: &[Vec<f64>],
        errors: &DVector<f64>,
        coefficients: &DVector<f64>,
    ) -> Vec<DVector<f64>> {
        let of = |column| self.declared(column, coefficients);
        let decay = 2.0 * of(Column::Acceleration) / of(Column::Velocity).max(f64::MIN_POSITIVE);
        let input = &self.simulation.records[0].input;
        let rows = CLUSTER_DECAYS * decay / (input.step * input.steps as f64);
        let longest = (errors.len() / 20).max(1);
        let rows = (rows.ceil() as usize).clamp(1, longest);
        let score = |from: usize| {
            let to = (from + rows).min(errors.len());
            let sum = |c: &Vec<f64>| (from..to).map(|r| c[r] * errors[r]).sum::<f64>();
            DVector::from_iterator(columns.len(), columns.iter().map(sum))
        };
        (0..errors.len()).step_by(rows).map(score).collect()
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, moved: &DVector<f64>) {
        self.moved = self.within(moved);
        self.here = self.residuals_at(&self.moved);
    }
    fn params(&self) -> DVector<f64> {
        self.moved.clone()
    }
    fn residuals(&self) -> Option<DVector<f64>> {
        let rows = self.blocks.iter().map(|b| b.rows.len()).sum();
        // A model that cannot be simulated is a very bad fit, but does not end the search.
        let far = self.simulation.records.iter().map(|r| r.largest).fold(0.0, f64::max);
        Some(self.here.clone().unwrap_or_else(|| DVector::from_element(rows, far)))
    }
    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let here = self.here.as_ref()?;
        let column = |k: usize| {
            let step = self.difference(k);
            let mut moved = self.moved.clone();
            moved[k] += step;
            Some((self.residuals_at(&moved)? - here) / step)
        };
        let count = self.moved.len();
        let columns: Vec<DVector<f64>> =
            (0..count).into_par_iter().map(column).collect::<Option<_>>()?;
        Some(DMatrix::from_fn(here.len(), count, |row, k| columns[k][row]))
    }
}
