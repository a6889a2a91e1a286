//! What the records show of each declared parameter: whether it does anything, and whether another
//! does the same.

use nalgebra::DMatrix;

use super::fit::{Fitted, View};
use super::knob::Knob;
use super::refit::SEEN;

/// Below this share of what shows, a parameter does nothing at all.
const NOTHING: f64 = 0.01;
/// A parameter of which the others leave less than this share is one that they stand in for.
const OWN: f64 = 0.3;
/// Two numbers whose slopes are less alike do not stand for one another by themselves.
const ALIKE: f64 = 0.5;

/// What is seen of a parameter at its fitted value, whatever its deviation is.
#[derive(Clone, Debug, PartialEq)]
pub enum Sight {
    /// It changes what the records show, and nothing else does so.
    Clear,
    /// It changes too little.
    Flat,
    /// It changes nothing.
    Dead,
    /// Others change the same together; the most alike of them, where one by itself is.
    Traded(Option<Knob>),
}

/// Of all declared parameters, beside the knobs of effects.
pub fn sights(view: &View<'_>, fitted: &Fitted, effects: &[Knob]) -> Vec<Sight> {
    let count = view.machine.base.len();
    let all: Vec<Knob> = (0..count).map(Knob::Base).chain(effects.iter().cloned()).collect();
    let slopes = view.slopes(fitted, &all, &View::weights(&fitted.residuals));
    let shown = SEEN * (slopes.nrows() as f64).sqrt();
    let told = told(&slopes, shown);
    told.into_iter().take(count).map(|told| told.map(|at| all[at].clone())).collect()
}

/// The same with columns in the place of knobs.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Told {
    Clear,
    Flat,
    Dead,
    Traded(Option<usize>),
}

impl Told {
    fn map(self, knob: impl Fn(usize) -> Knob) -> Sight {
        match self {
            Self::Clear => Sight::Clear,
            Self::Flat => Sight::Flat,
            Self::Dead => Sight::Dead,
            Self::Traded(like) => Sight::Traded(like.map(knob)),
        }
    }
}

/// What of each column is its own.
fn told(slopes: &DMatrix<f64>, shown: f64) -> Vec<Told> {
    let norms: Vec<f64> = slopes.column_iter().map(|column| column.norm()).collect();
    let live: Vec<usize> = (0..norms.len()).filter(|at| norms[*at] >= shown).collect();
    let units = DMatrix::from_fn(slopes.nrows(), live.len(), |row, at| {
        slopes[(row, live[at])] / norms[live[at]]
    });
    let alike = units.transpose() * &units;
    // What the others leave of a column, squared, is one over its entry in the inverse.
    let inverse = (alike.clone() + DMatrix::identity(live.len(), live.len()) * 1e-9).try_inverse();
    let own = |at: usize| {
        inverse.as_ref().map_or(0.0, |inverse| (1.0 / inverse[(at, at)]).max(0.0).sqrt())
    };
    norms
        .iter()
        .enumerate()
        .map(|(column, norm)| match live.iter().position(|live| *live == column) {
            None if *norm < NOTHING * shown => Told::Dead,
            None => Told::Flat,
            Some(at) if own(at) >= OWN => Told::Clear,
            Some(at) => {
                let others = (0..live.len()).filter(|other| *other != at);
                let most =
                    others.max_by(|a, b| alike[(at, *a)].abs().total_cmp(&alike[(at, *b)].abs()));
                Told::Traded(
                    most.filter(|most| alike[(at, *most)].abs() >= ALIKE).map(|most| live[most]),
                )
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_that_another_stands_in_for_is_traded_and_a_small_one_is_flat() {
        let rows = 200;
        let wave = |order: f64, row: usize| {
            (std::f64::consts::TAU * order * row as f64 / rows as f64).sin()
        };
        let slopes = DMatrix::from_fn(rows, 6, |row, column| match column {
            0 => wave(1.0, row),
            // The first, and a little of its own.
            1 => 2.0 * wave(1.0, row) + 0.1 * wave(4.0, row),
            2 => wave(2.0, row),
            3 => 1e-2 * wave(3.0, row),
            4 => 0.0,
            // Half of it is another's, and half its own.
            _ => wave(2.0, row) + wave(5.0, row),
        });
        let told = told(&slopes, 1.0);
        assert_eq!(
            told[..5],
            [Told::Traded(Some(1)), Told::Traded(Some(0)), Told::Clear, Told::Flat, Told::Dead]
        );
        assert_eq!(told[5], Told::Clear);
    }

    #[test]
    fn several_that_stand_in_together_have_no_name() {
        let rows = 400;
        let wave = |order: f64, row: usize| {
            (std::f64::consts::TAU * order * row as f64 / rows as f64).sin()
        };
        let orders = [1.0, 2.0, 3.0, 4.0, 5.0];
        // The last is the sum of five others: like none of them (0.45), and nothing of its own.
        let slopes = DMatrix::from_fn(rows, 6, |row, column| match orders.get(column) {
            Some(order) => wave(*order, row),
            None => orders.iter().map(|order| wave(*order, row)).sum(),
        });
        assert_eq!(told(&slopes, 1.0)[5], Told::Traded(None));
    }
}
