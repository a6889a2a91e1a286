//! Amplitudes and shapes of effects in one-channel models.

use super::machine::Axis;

/// A linear amplitude of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Name of the parameter.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Physical limits of the amplitude. Where the two are equal, the amplitude is given: it is
    /// neither fitted nor reported.
    pub bound: (f64, f64),
}

impl Term {
    /// An amplitude of any sign.
    pub fn free(name: &str, unit: impl Into<String>) -> Self {
        Self { name: name.into(), unit: unit.into(), bound: (f64::NEG_INFINITY, f64::INFINITY) }
    }
    /// An amplitude that is at least 0.
    pub fn positive(name: &str, unit: impl Into<String>) -> Self {
        Self { name: name.into(), unit: unit.into(), bound: (0.0, f64::INFINITY) }
    }
    /// The amplitudes of a wave of unknown phase.
    pub fn sine_and_cosine(axis: &Axis) -> Vec<Self> {
        ["sine", "cosine"].map(|name| Self::free(name, axis.units.force)).to_vec()
    }
    /// A column with the fixed amplitude 1.
    pub fn given() -> Self {
        Self { name: String::new(), unit: String::new(), bound: (1.0, 1.0) }
    }
    /// Whether the amplitude is given, not fitted.
    pub fn is_given(&self) -> bool {
        self.bound.0 == self.bound.1
    }
}

/// How the grid of a shape is spaced over its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spacing {
    /// Logarithmic.
    Logarithmic,
    /// By equal steps.
    Linear,
    /// Linear, from 49.9 to 50.1 Hz and then from 59.9 to 60.1 Hz.
    Mains,
}

/// A nonlinear parameter of a column: searched on a grid, then refined.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Name of the parameter.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Lowest value tried.
    pub low: f64,
    /// Highest value tried.
    pub high: f64,
    /// Points of the grid.
    pub points: usize,
    /// How they are spaced.
    pub spacing: Spacing,
}

impl Shape {
    /// A shape on a logarithmic grid.
    pub fn by_factors(
        name: &str,
        unit: impl Into<String>,
        range: (f64, f64),
        points: usize,
    ) -> Self {
        Self { spacing: Spacing::Logarithmic, ..Self::by_steps(name, unit, range, points) }
    }
    /// A shape on a linear grid.
    pub fn by_steps(
        name: &str,
        unit: impl Into<String>,
        (low, high): (f64, f64),
        points: usize,
    ) -> Self {
        Self { name: name.into(), unit: unit.into(), low, high, points, spacing: Spacing::Linear }
    }
    /// The value at a fraction of the range, 0 to 1.
    pub fn at(&self, share: f64) -> f64 {
        let share = share.clamp(0.0, 1.0);
        match self.spacing {
            Spacing::Logarithmic => self.low * (self.high / self.low).powf(share),
            Spacing::Linear => self.low + (self.high - self.low) * share,
            Spacing::Mains if share < 0.5 => 49.9 + 0.4 * share,
            Spacing::Mains => 59.9 + 0.4 * (share - 0.5),
        }
    }
    /// The fraction of the range at which a value lies, 0 to 1.
    pub fn share(&self, value: f64) -> f64 {
        let share = match self.spacing {
            Spacing::Logarithmic => (value / self.low).ln() / (self.high / self.low).ln(),
            Spacing::Linear => (value - self.low) / (self.high - self.low),
            Spacing::Mains if value < 55.0 => (value - 49.9) / 0.4,
            Spacing::Mains => 0.5 + (value - 59.9) / 0.4,
        };
        if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// A declared parameter that an effect changes, or is the same as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Declared {
    /// Mass or inertia.
    Mass,
    /// Viscous friction or damping.
    Viscous,
    /// Stiffness.
    Stiffness,
    /// Coulomb friction.
    Coulomb,
}
