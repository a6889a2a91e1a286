//! Identifiability of declared parameters: sensitivity and collinearity of the Jacobian's columns.

use nalgebra::DMatrix;

use super::dataset::{Dataset, Fitted};
use super::free_parameter::FreeParameter;
use super::refit::SENSITIVE;

/// Below this share of the least detectable sensitivity, a parameter has no effect at all.
const NO_EFFECT: f64 = 0.01;
/// A column is collinear with the others if their projection leaves less than this share of it.
const INDEPENDENT: f64 = 0.3;
/// Least correlation (cosine) of two columns for one to be named as trading off with the other.
const SIMILAR: f64 = 0.5;

/// Sensitivity of the residual to a parameter at its fitted value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sensitivity {
    /// It changes the residual like no other parameter.
    Distinct,
    /// It changes the residual too little.
    Weak,
    /// It does not change the residual.
    Absent,
    /// A combination of others changes the residual alike; index of the most similar one among the
    /// declared parameters and those of the effects after them, if one stands out.
    Collinear(Option<usize>),
}

/// Returns the sensitivities of all declared parameters beside those of the effects.
pub fn sensitivities(
    dataset: &Dataset<'_>,
    fitted: &Fitted,
    effects: &[FreeParameter],
) -> Vec<Sensitivity> {
    let count = dataset.model.base.len();
    let all: Vec<FreeParameter> =
        (0..count).map(FreeParameter::Base).chain(effects.iter().cloned()).collect();
    let jacobian = dataset.jacobian(fitted, &all, &Dataset::weights(&fitted.residuals));
    let detectable = SENSITIVE * (jacobian.nrows() as f64).sqrt();
    let mut sensitivities = classify(&jacobian, detectable);
    sensitivities.truncate(count);
    sensitivities
}

/// Classifies every column.
fn classify(jacobian: &DMatrix<f64>, detectable: f64) -> Vec<Sensitivity> {
    let norms: Vec<f64> = jacobian.column_iter().map(|column| column.norm()).collect();
    let live: Vec<usize> = (0..norms.len()).filter(|at| norms[*at] >= detectable).collect();
    let units = DMatrix::from_fn(jacobian.nrows(), live.len(), |row, at| {
        jacobian[(row, live[at])] / norms[live[at]]
    });
    let alike = units.transpose() * &units;
    // The squared remainder of a column after projection on the others is 1 over its entry in the
    // inverse Gram matrix.
    let inverse = (alike.clone() + DMatrix::identity(live.len(), live.len()) * 1e-9).try_inverse();
    let own = |at: usize| {
        inverse.as_ref().map_or(0.0, |inverse| (1.0 / inverse[(at, at)]).max(0.0).sqrt())
    };
    norms
        .iter()
        .enumerate()
        .map(|(column, norm)| match live.iter().position(|live| *live == column) {
            None if *norm < NO_EFFECT * detectable => Sensitivity::Absent,
            None => Sensitivity::Weak,
            Some(at) if own(at) >= INDEPENDENT => Sensitivity::Distinct,
            Some(at) => {
                let others = (0..live.len()).filter(|other| *other != at);
                let most =
                    others.max_by(|a, b| alike[(at, *a)].abs().total_cmp(&alike[(at, *b)].abs()));
                Sensitivity::Collinear(
                    most.filter(|most| alike[(at, *most)].abs() >= SIMILAR).map(|most| live[most]),
                )
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_collinear_column_is_recognised_and_a_small_one_is_weak() {
        let rows = 200;
        let wave = |order: f64, row: usize| {
            (std::f64::consts::TAU * order * row as f64 / rows as f64).sin()
        };
        let jacobian = DMatrix::from_fn(rows, 6, |row, column| match column {
            0 => wave(1.0, row),
            // The first, and a small independent part.
            1 => 2.0 * wave(1.0, row) + 0.1 * wave(4.0, row),
            2 => wave(2.0, row),
            3 => 1e-2 * wave(3.0, row),
            4 => 0.0,
            // Half collinear, half independent.
            _ => wave(2.0, row) + wave(5.0, row),
        });
        let classified = classify(&jacobian, 1.0);
        assert_eq!(
            classified[..5],
            [
                Sensitivity::Collinear(Some(1)),
                Sensitivity::Collinear(Some(0)),
                Sensitivity::Distinct,
                Sensitivity::Weak,
                Sensitivity::Absent
            ]
        );
        assert_eq!(classified[5], Sensitivity::Distinct);
    }

    #[test]
    fn collinearity_with_several_columns_names_none() {
        let rows = 400;
        let wave = |order: f64, row: usize| {
            (std::f64::consts::TAU * order * row as f64 / rows as f64).sin()
        };
        let orders = [1.0, 2.0, 3.0, 4.0, 5.0];
        // The sum of five others: similar to none of them (0.45), and nothing independent.
        let jacobian = DMatrix::from_fn(rows, 6, |row, column| match orders.get(column) {
            Some(order) => wave(*order, row),
            None => orders.iter().map(|order| wave(*order, row)).sum(),
        });
        assert_eq!(classify(&jacobian, 1.0)[5], Sensitivity::Collinear(None));
    }
}
