//! Whether an effect can be seen in the records of a machine with one channel.
//!
//! The force is compared with that which the declared model needs for the recorded motion, its
//! constants fitted within their tolerances, behind a low-pass: once as it is, and once less what
//! the effect takes of it, which the simulator knows. Fitted on all records but the last (on the
//! first two thirds of a single one), evaluated on the rest.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::machine::{Declared, Machine};
use crate::detectability::bounded_least_squares;

/// Least gain of an effect that can be seen.
pub const LEAST_GAIN: f64 = 0.25;
/// Least share of the force that it explains on rows held out.
pub const LEAST_SHARE: f64 = 0.05;

/// A record as judged: columns, and the force less what other effects take.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Position as recorded.
    pub position: Vec<f64>,
    /// Dry friction over its level.
    pub direction: Vec<f64>,
    /// Force.
    pub force: Vec<f64>,
}

/// How well an effect can be seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Visibility {
    /// Rms of the force on rows held out.
    pub force: f64,
    /// Rms error of the declared model with the effect known.
    pub floor: f64,
    /// The same without the effect.
    pub without: f64,
}

impl Visibility {
    /// Excess of the error over the floor.
    pub fn gain(&self) -> f64 {
        self.without / self.floor.max(1e-12 * self.force) - 1.0
    }

    /// The share of the force that the effect explains.
    pub fn share(&self) -> f64 {
        (self.without.powi(2) - self.floor.powi(2)).max(0.0).sqrt() / self.force.max(1e-300)
    }

    /// Whether a good method should find it.
    pub fn seen(&self) -> bool {
        self.gain() >= LEAST_GAIN && self.share() >= LEAST_SHARE
    }
}

/// Rms of the force and of the error of the declared model on rows held out.
pub fn error(machine: &Machine, declared: &[Declared], records: &[Judged]) -> (f64, f64) {
    let (mut columns, mut forces, mut held) = (Vec::new(), Vec::new(), Vec::new());
    for (number, record) in records.iter().enumerate() {
        let (rows, force) = filtered(machine, record);
        let count = rows.len();
        for (index, (row, force)) in rows.into_iter().zip(force).enumerate() {
            columns.push(row);
            forces.push(force);
            held.push(if records.len() > 1 {
                number + 1 == records.len()
            } else {
                3 * index >= 2 * count
            });
        }
    }
    let terms = terms(machine);
    let pick = |wanted: bool| {
        let rows: Vec<usize> = (0..held.len()).filter(|row| held[*row] == wanted).collect();
        let matrix =
            DMatrix::from_fn(rows.len(), terms.len(), |row, term| columns[rows[row]][terms[term]]);
        (matrix, DVector::from_fn(rows.len(), |row, _| forces[rows[row]]))
    };
    let bounds: Vec<[f64; 2]> = declared
        .iter()
        .map(|known| [known.value - known.spread, known.value + known.spread])
        .collect();
    let (matrix, force) = pick(false);
    // Columns of one size, for the descent.
    let sizes: Vec<f64> =
        (0..terms.len()).map(|term| matrix.column(term).norm().max(1e-300)).collect();
    let scaled = DMatrix::from_fn(matrix.nrows(), terms.len(), |row, term| {
        matrix[(row, term)] / sizes[term]
    });
    let limits: Vec<[f64; 2]> = bounds
        .iter()
        .zip(&sizes)
        .map(|(bound, size)| [bound[0].max(lowest(bound)) * size, bound[1] * size])
        .collect();
    let found = bounded_least_squares(&scaled, &(-&force), &limits);
    let fitted = DVector::from_fn(terms.len(), |term, _| found[term] / sizes[term]);
    let (matrix, force) = pick(true);
    let rest = &force - &matrix * fitted;
    let count = (force.len() as f64).sqrt().max(1.0);
    (force.norm() / count, rest.norm() / count)
}

/// Constants other than an offset are not negative.
fn lowest(bound: &[f64; 2]) -> f64 {
    if bound[0] + bound[1] > 0.0 { 0.0 } else { f64::NEG_INFINITY }
}

/// The columns of the declared constants, in the order of the declaration.
fn terms(machine: &Machine) -> Vec<usize> {
    let mut terms = Vec::new();
    if machine.mass > 0.0 {
        terms.push(0);
    }
    terms.push(1);
    if machine.stiffness > 0.0 {
        terms.push(2);
    }
    if machine.coulomb > 0.0 {
        terms.push(3);
    }
    terms.push(4);
    terms
}

/// Low-passed columns (acceleration, velocity, position, direction, one) and force.
fn filtered(machine: &Machine, record: &Judged) -> (Vec<[f64; 5]>, Vec<f64>) {
    let rate = machine.row_hz;
    // A Gaussian of two thirds of the cut-off has about the noise bandwidth of a steep filter.
    let width = rate * 2.0_f64.ln().sqrt() / (std::f64::consts::TAU * machine.cut_hz() / 1.5);
    let half = (4.0 * width).ceil() as usize;
    let weights: Vec<f64> = (0..=2 * half)
        .map(|at| (-0.5 * ((at as f64 - half as f64) / width).powi(2)).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    let low = |values: &[f64], at: usize| -> f64 {
        let near = &values[at - half..=at + half];
        near.iter().zip(&weights).map(|(value, weight)| value * weight).sum::<f64>() / sum
    };
    let stride = (rate / (4.0 * machine.cut_hz())).floor().max(1.0) as usize;
    let (mut rows, mut forces) = (Vec::new(), Vec::new());
    let mut at = half + 1;
    while at + half + 1 < record.force.len() {
        let [before, now, after] = [at - 1, at, at + 1].map(|place| low(&record.position, place));
        rows.push([
            (after - 2.0 * now + before) * rate * rate,
            0.5 * (after - before) * rate,
            now,
            low(&record.direction, at),
            1.0,
        ]);
        forces.push(low(&record.force, at));
        at += stride;
    }
    (rows, forces)
}
