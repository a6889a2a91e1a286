//! Nonparametric functions of one variable, fitted to a residual that no listed effect explains.

use plant::effects::one_channel::Motion;

use crate::effects::{Axis, Effect, Instant, Regressor, Term, View};

/// Number of intervals between knots over which a function continues beyond its ends.
const EXTRAPOLATED: f64 = 3.0;

/// A variable on which a residual may depend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variable {
    /// Position.
    Position,
    /// Position, with the sign of the velocity.
    PositionByDirection,
    /// Velocity.
    Velocity,
    /// Acceleration.
    Acceleration,
    /// Time since the start.
    Time,
}

impl Variable {
    /// All variables.
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
    pub fn values(self, signals: &Motion) -> &[f64] {
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

/// A piecewise linear function of one variable, as hat functions over knots.
#[derive(Clone, Debug)]
pub struct Spline {
    variable: Variable,
    declaration: Effect,
    /// Abscissae of the knots, ascending.
    pub knots: Vec<f64>,
}

impl Spline {
    /// Knots over the range of the values (those of the fitted rows: elsewhere nothing determines
    /// them), halfway between even spacing (which leaves knots without data) and equal numbers of
    /// rows (which leaves the ends coarse). `None` if the variable does not vary.
    pub fn over(variable: Variable, mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let (low, high) = (*values.first()?, *values.last()?);
        let n = variable.knots();
        let knot = |i: usize| {
            let share = i as f64 / (n - 1) as f64;
            0.5 * (low + (high - low) * share)
                + 0.5 * values[(share * (values.len() - 1) as f64) as usize]
        };
        let uses_sign = variable == Variable::PositionByDirection;
        let declaration = Effect { uses_sign, ..Effect::NONE };
        (high > low).then(|| Self { variable, declaration, knots: (0..n).map(knot).collect() })
    }

    /// What it is a function of.
    pub const fn variable(&self) -> Variable {
        self.variable
    }

    /// The knot below a value, and the position of the value between it and the next, 0 to 1.
    /// Beyond the ends the function continues in a straight line, over at most three intervals.
    fn place(&self, value: f64) -> (usize, f64) {
        let left = self.knots.partition_point(|k| *k <= value).clamp(1, self.knots.len() - 1) - 1;
        let share = (value - self.knots[left]) / (self.knots[left + 1] - self.knots[left]);
        (left, share.clamp(-EXTRAPOLATED, 1.0 + EXTRAPOLATED))
    }
}

impl Regressor for Spline {
    fn declaration(&self) -> &Effect {
        &self.declaration
    }

    fn terms(&self, axis: &Axis) -> Vec<Term> {
        self.knots.iter().map(|k| Term::free(&format!("at {k}"), axis.units.force)).collect()
    }

    fn is_force(&self) -> bool {
        // In a simulation the acceleration is the unknown.
        self.variable != Variable::Acceleration
    }

    fn columns(&self, view: &View<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        let values = self.variable.values(view.signals);
        let mut columns = vec![vec![0.0; values.len()]; self.knots.len()];
        for (row, value) in values.iter().enumerate() {
            let (left, share) = self.place(*value);
            let weight =
                if self.variable == Variable::PositionByDirection { view.sign[row] } else { 1.0 };
            columns[left][row] = weight * (1.0 - share);
            columns[left + 1][row] = weight * share;
        }
        columns
    }

    fn force(&self, now: &Instant, _: &[f64], _: &[f64], out: &mut [f64]) {
        let (value, weight) = match self.variable {
            Variable::Position => (now.position, 1.0),
            Variable::PositionByDirection => (now.position, now.sign),
            Variable::Velocity => (now.velocity, 1.0),
            Variable::Time => (now.time, 1.0),
            Variable::Acceleration => (0.0, 0.0),
        };
        let (left, share) = self.place(value);
        out[..self.knots.len()].fill(0.0);
        (out[left], out[left + 1]) = (weight * (1.0 - share), weight * share);
    }
}
