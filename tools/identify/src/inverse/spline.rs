//! Generic functions of one variable: what a residual looks like that no listed effect explains.

use crate::effects::{InverseEffect, Term, Units};
use crate::inverse::signals::Signals;

/// What a residual may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variable {
    /// Position.
    Position,
    /// Position, with the opposite sign in the other direction.
    PositionByDirection,
    /// Velocity.
    Velocity,
    /// Acceleration.
    Acceleration,
    /// Time in the run.
    Time,
}

impl Variable {
    /// Those that are tried.
    pub const ALL: [Self; 5] =
        [Self::Position, Self::PositionByDirection, Self::Velocity, Self::Acceleration, Self::Time];

    /// Its name in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::PositionByDirection => "position_by_direction",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Time => "time",
        }
    }

    /// Its values along a record.
    pub fn values(self, signals: &Signals) -> &[f64] {
        match self {
            Self::Position | Self::PositionByDirection => &signals.position,
            Self::Velocity => &signals.velocity,
            Self::Acceleration => &signals.acceleration,
            Self::Time => &signals.time,
        }
    }

    const fn knots(self) -> usize {
        match self {
            Self::Time => 10,
            _ => 16,
        }
    }
}

/// A piecewise linear function of one variable, as hat functions over evenly spaced knots.
#[derive(Clone, Debug)]
pub struct Spline {
    variable: Variable,
    /// Abscissae of the knots.
    pub knots: Vec<f64>,
}

impl Spline {
    /// Knots over the range that the records cover; `None` where the variable does not vary.
    pub fn over<'a>(variable: Variable, records: impl Iterator<Item = &'a Signals>) -> Option<Self> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in records.flat_map(|s| variable.values(s)) {
            low = low.min(*v);
            high = high.max(*v);
        }
        let n = variable.knots();
        let knots = (0..n).map(|i| low + (high - low) * i as f64 / (n - 1) as f64).collect();
        (high > low).then_some(Self { variable, knots })
    }
}

impl InverseEffect for Spline {
    fn terms(&self, units: &Units) -> Vec<Term> {
        let bound = (f64::NEG_INFINITY, f64::INFINITY);
        self.knots.iter().map(|k| Term { name: format!("at {k}"), unit: units.force.into(), bound }).collect()
    }

    fn columns(&self, signals: &Signals, sign: &[f64], _: &[f64]) -> Vec<Vec<f64>> {
        let values = self.variable.values(signals);
        let n = self.knots.len();
        let (low, width) = (self.knots[0], self.knots[1] - self.knots[0]);
        let mut columns = vec![vec![0.0; values.len()]; n];
        for (row, value) in values.iter().enumerate() {
            let at = ((value - low) / width).clamp(0.0, (n - 1) as f64);
            let left = (at as usize).min(n - 2);
            let share = at - left as f64;
            let weight = if self.variable == Variable::PositionByDirection { sign[row] } else { 1.0 };
            columns[left][row] = weight * (1.0 - share);
            columns[left + 1][row] = weight * share;
        }
        columns
    }
}
