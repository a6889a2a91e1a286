//! What a nonparametric function looks like, in words: a spring, a wall or foam that is touched,
//! friction that grows less than in proportion to speed.
//!
//! A resemblance is no name: it says what to look for on the machine.

use crate::effects::Units;
use crate::equation_error::spline::Variable;
use crate::outcome_tables::short;
use crate::regression::{Gram, solve};

/// Largest share of a function's variance that its simple form may leave.
const MOST_LEFT: f64 = 0.1;
/// A form with one more parameter must leave less than this share of what the simpler one leaves.
const SIMPLER_LEFT: f64 = 0.5;
/// Exponents of speed between these count as proportional.
const PROPORTIONAL: (f64, f64) = (0.8, 1.25);
/// Exponents of speed that are tried.
const EXPONENTS: std::ops::RangeInclusive<i32> = 1..=30;

/// Abscissa, value and standard deviation.
type Row = [f64; 3];

/// Describes a function that the model lacks from its table; `None` where it looks like nothing
/// that is listed here. Values are forces that the motion needs: positive along the position for a
/// spring, along the velocity for friction.
pub(super) fn resemblance(variable: Variable, table: &[Row], units: &Units) -> Option<String> {
    let rows: Vec<Row> = table.iter().copied().filter(|row| row[2].is_finite()).collect();
    match variable {
        Variable::Position => spring(&rows, units),
        Variable::Velocity => friction(&rows),
        _ => None,
    }
}

/// A spring, or a contact at one end of the travel.
fn spring(rows: &[Row], units: &Units) -> Option<String> {
    let line = fit(rows, |x| x)?;
    let hinge = |from: f64, side: f64| Some((fit(rows, |x| (side * (x - from)).max(0.0))?, from));
    // At least two rows lie on either side.
    let inner = rows.get(2..rows.len().checked_sub(2)?)?;
    let contact = inner
        .iter()
        .flat_map(|row| [hinge(row[0], 1.0), hinge(row[0], -1.0)])
        .flatten()
        .min_by(|a, b| a.0.left.total_cmp(&b.0.left));
    if let Some((contact, from)) = contact
        && contact.left < MOST_LEFT
        && contact.left < SIMPLER_LEFT * line.left
    {
        let (stiffness, at) = (short(contact.factor.abs()), short(from));
        let (per, unit) = (units.stiffness, units.position);
        return Some(format!("like a wall or foam of {stiffness} {per} touched at {at} {unit}"));
    }
    (line.left < MOST_LEFT && line.factor > 0.0)
        .then(|| format!("like a spring of {} {}", short(line.factor), units.stiffness))
}

/// Friction as a power of speed.
fn friction(rows: &[Row]) -> Option<String> {
    let power = |tenths: i32| {
        let exponent = 0.1 * f64::from(tenths);
        Some((fit(rows, |speed| speed.signum() * speed.abs().powf(exponent))?, exponent))
    };
    let (best, exponent) =
        EXPONENTS.filter_map(power).min_by(|a, b| a.0.left.total_cmp(&b.0.left))?;
    if best.left > MOST_LEFT || best.factor <= 0.0 {
        return None;
    }
    let grows = match exponent {
        low if low < PROPORTIONAL.0 => "less than in proportion to speed",
        high if high > PROPORTIONAL.1 => "more than in proportion to speed",
        _ => "in proportion to speed",
    };
    Some(format!("like friction that grows {grows} (about its power of {exponent:.1})"))
}

/// A constant and a factor times a form.
struct FormFit {
    factor: f64,
    /// Share of the variance that is left.
    left: f64,
}

fn fit(rows: &[Row], form: impl Fn(f64) -> f64) -> Option<FormFit> {
    let values: Vec<f64> = rows.iter().map(|row| row[1]).collect();
    let columns = [vec![1.0; rows.len()], rows.iter().map(|row| form(row[0])).collect()];
    let gram = |columns: &[Vec<f64>]| {
        let mut gram = Gram::empty(columns.len());
        gram.add(columns, &values, 0..values.len());
        gram
    };
    let free = [(f64::NEG_INFINITY, f64::INFINITY); 2];
    let all = solve(&gram(&columns[..1]), &free[..1])?.squares;
    let fit = solve(&gram(&columns), &free)?;
    let left = fit.squares / all.max(f64::MIN_POSITIVE);
    Some(FormFit { factor: fit.coefficients[1], left })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(variable: Variable, value: impl Fn(f64) -> f64) -> Option<String> {
        let table: Vec<Row> = (-10..=10)
            .map(|knot| 0.1 * f64::from(knot))
            .map(|x| [x, value(x) + 0.01 * (7.0 * x).sin(), 0.01])
            .collect();
        resemblance(variable, &table, &Units::ROTARY)
    }

    #[test]
    fn springs_and_contacts_are_told_with_their_stiffness() {
        let spring = told(Variable::Position, |x| 4.5 * x - 0.3).unwrap();
        assert!(spring.starts_with("like a spring of 4.49"), "{spring}");
        let wall = told(Variable::Position, |x| 20.0 * (x - 0.5).max(0.0)).unwrap();
        assert!(wall.contains("wall or foam of 20") && wall.contains("at 0.5"), "{wall}");
        let left = told(Variable::Position, |x| 8.0 * (x + 0.4).min(0.0)).unwrap();
        assert!(left.contains("of 7.99") && left.contains("at -0.4"), "{left}");
        assert_eq!(told(Variable::Position, |x| (9.0 * x).sin()), None);
        assert_eq!(told(Variable::Position, |x| -4.5 * x), None);
    }

    #[test]
    fn friction_is_told_by_how_it_grows() {
        let told = |exponent: f64| {
            told(Variable::Velocity, |v| 2.0 * v.signum() * v.abs().powf(exponent)).unwrap()
        };
        assert!(told(0.5).contains("less than in proportion"), "{}", told(0.5));
        assert!(told(1.0).contains("grows in proportion"), "{}", told(1.0));
        assert!(told(2.0).contains("more than in proportion"), "{}", told(2.0));
    }

    #[test]
    fn a_table_of_few_rows_resembles_nothing() {
        assert_eq!(resemblance(Variable::Position, &[[0.0, 1.0, 0.1]], &Units::ROTARY), None);
        assert_eq!(resemblance(Variable::Velocity, &[], &Units::ROTARY), None);
    }
}
