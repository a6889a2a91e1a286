//! The inertia matrix of a handle that several axes share.

use nalgebra::Matrix3;

/// Maximum number of axes.
pub const AXES: usize = 3;
/// Least allowed eigenvalue of the handle's inertia matrix, each row and column divided by the root
/// of its own axis's inertia: 1 without coupling, 0 for a handle without inertia in some direction.
/// With two axes: `|C| ≤ 0.8 √(I₁ I₂)`.
pub const LEAST_EIGENVALUE: f64 = 0.2;

/// The pairs of axes, in the order in which rig files and [`HandleCoupling::of_pairs`] have them.
pub(crate) const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// Why transmissions cannot share a handle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CouplingError {
    /// No axis, or more than [`AXES`].
    #[error("expected 1 to {AXES} axes, found {found}; leave some out")]
    Axes {
        /// Number of axes.
        found: usize,
    },
    /// An effect couples the axis of a plant that has no other.
    #[error("expected several axes, found one; leave it out")]
    Alone,
    /// Not one number per pair of axes.
    #[error(
        "expected {expected} numbers for the pairs of {axes} axes (first and second, first and \
         third, second and third), found {found}"
    )]
    Pairs {
        /// Number of axes.
        axes: usize,
        /// Number of pairs.
        expected: usize,
        /// Numbers given.
        found: usize,
    },
    /// The handle would have hardly any inertia, or a negative one, in some direction.
    #[error(
        "expected a handle with at least {LEAST_EIGENVALUE} of the axes' own inertia in every \
         direction (for two axes: a coupling of at most 0.8 times the root of the product of their \
         slaves' inertia), found {found:.3}; make the coupling smaller, or the handle's own \
         inertia larger"
    )]
    TooStrong {
        /// Least eigenvalue of the scaled inertia matrix.
        found: f64,
    },
}

/// The off-diagonal elements of the handle's inertia matrix (kg·m²).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HandleCoupling(Matrix3<f64>);

impl HandleCoupling {
    /// No coupling: the axes move as if alone.
    pub fn none() -> Self {
        Self::default()
    }

    /// Whether the axes move as if alone.
    pub fn is_none(&self) -> bool {
        self.0.iter().all(|&value| value == 0.0)
    }

    /// From one number per pair, in kg·m²: first and second axis, first and third, second and
    /// third. An empty slice is no coupling.
    ///
    /// # Errors
    /// [`CouplingError::Axes`], [`CouplingError::Pairs`].
    pub fn of_pairs(axes: usize, pairs: &[f64]) -> Result<Self, CouplingError> {
        if !(1..=AXES).contains(&axes) {
            return Err(CouplingError::Axes { found: axes });
        }
        let expected = axes * (axes - 1) / 2;
        if !pairs.is_empty() && pairs.len() != expected {
            return Err(CouplingError::Pairs { axes, expected, found: pairs.len() });
        }
        let mut coupling = Self::none();
        for (&product, pair) in pairs.iter().zip(PAIRS) {
            coupling.set(pair, product);
        }
        Ok(coupling)
    }

    /// One number per pair of so many axes, as [`HandleCoupling::of_pairs`] takes them (kg·m²).
    pub fn pairs(&self, axes: usize) -> Vec<f64> {
        let pairs = PAIRS.into_iter().filter(|&(_, column)| column < axes);
        pairs.map(|(row, column)| self.between(row, column)).collect()
    }

    /// The product of inertia between two axes (kg·m²); 0 where there are no such axes.
    pub fn between(&self, row: usize, column: usize) -> f64 {
        self.0.get((row, column)).copied().unwrap_or_default()
    }

    /// Sets the product of inertia between two axes (kg·m²); nothing where they are one axis, or
    /// there is no such axis.
    pub fn set(&mut self, (row, column): (usize, usize), product: f64) {
        if row != column && row.max(column) < AXES {
            self.0[(row, column)] = product;
            self.0[(column, row)] = product;
        }
    }

    /// Least eigenvalue of the handle's inertia matrix in units of the axes' own inertia (kg·m²);
    /// NaN where a number is not finite.
    pub fn least_eigenvalue(&self, inertia_kg_m2: &[f64]) -> f64 {
        let axes = inertia_kg_m2.len().min(AXES);
        if inertia_kg_m2.iter().chain(self.0.iter()).any(|value| !value.is_finite()) {
            return f64::NAN;
        }
        // Missing axes are uncoupled: their eigenvalue is 1.
        let scaled = Matrix3::from_fn(|row, column| match row == column {
            true => 1.0,
            false if row < axes && column < axes => {
                self.0[(row, column)] / (inertia_kg_m2[row] * inertia_kg_m2[column]).sqrt()
            }
            false => 0.0,
        });
        scaled.symmetric_eigenvalues().min()
    }

    /// The least eigenvalue, where the handle is heavy enough in every direction.
    ///
    /// # Errors
    /// [`CouplingError::TooStrong`].
    pub fn check(&self, inertia_kg_m2: &[f64]) -> Result<f64, CouplingError> {
        let found = self.least_eigenvalue(inertia_kg_m2);
        if found >= LEAST_EIGENVALUE { Ok(found) } else { Err(CouplingError::TooStrong { found }) }
    }
}
