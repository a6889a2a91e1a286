//! Coordinates of long vectors in a few dimensions: an orthonormal basis that grows with them.
//!
//! The solver factorises the Jacobian in every iteration, with as many rows as the residual. All
//! the vectors of one round of a fit, the columns of the Jacobian, its rank-one updates and the
//! residuals, lie in the space of the first Jacobian and of the residuals met since. Their
//! coordinates there have the same norms and products, and are a thousand times shorter.

use nalgebra::{DMatrix, DVector};

/// What is left of a vector outside the basis counts as rounding below this part of it.
const ROUNDING: f64 = 1e-10;

/// An orthonormal basis with room for further vectors.
pub(super) struct GrowingBasis {
    /// Basis vectors; those not used yet are 0.
    vectors: DMatrix<f64>,
    used: usize,
}

impl GrowingBasis {
    /// A basis of the columns of a matrix, with room for `further` vectors; `None` where the
    /// columns are too nearly dependent.
    pub(super) fn of(columns: &DMatrix<f64>, further: usize) -> Option<Self> {
        let count = columns.ncols();
        let mut basis = columns.clone();
        // Columns of unit length, so that only their angles matter.
        for mut column in basis.column_iter_mut() {
            let norm = column.norm();
            if norm > 0.0 {
                column /= norm;
            }
        }
        // The Cholesky factor of the products orthogonalises; the second time removes what rounding
        // left the first time (CholeskyQR2, Yamamoto et al., ETNA 44, 2015).
        for _ in 0..2 {
            let mut products = basis.tr_mul(&basis);
            for index in 0..count {
                // A column of zeros stays one.
                if products[(index, index)] == 0.0 {
                    products[(index, index)] = 1.0;
                }
            }
            let upper = products.cholesky()?.l().transpose();
            let inverse = upper.solve_upper_triangular(&DMatrix::identity(count, count))?;
            basis *= inverse;
        }
        let room = count + further;
        Some(Self { vectors: basis.resize_horizontally(room, 0.0), used: count })
    }

    /// Number of coordinates: one for each vector, and one for what no vector has room for.
    pub(super) fn dimensions(&self) -> usize {
        self.vectors.ncols() + 1
    }

    /// The coordinates of a vector, for which the basis grows while it has room. Beyond, the last
    /// coordinate holds the norm of what is left.
    pub(super) fn coordinates(&mut self, vector: &DVector<f64>) -> DVector<f64> {
        let known = self.vectors.columns(0, self.used);
        let mut left = vector.clone();
        let mut coordinates = DVector::zeros(self.dimensions());
        // Twice, since the first time leaves a part of the order of rounding.
        for _ in 0..2 {
            let part = known.tr_mul(&left);
            left.gemv(-1.0, &known, &part, 1.0);
            let mut into = coordinates.rows_mut(0, self.used);
            into += part;
        }
        let norm = left.norm();
        if norm <= ROUNDING * vector.norm() {
            return coordinates;
        }
        if self.used == self.vectors.ncols() {
            coordinates[self.used] = norm;
            return coordinates;
        }
        self.vectors.set_column(self.used, &(left / norm));
        coordinates[self.used] = norm;
        self.used += 1;
        coordinates
    }

    /// The coordinates of the columns from which the basis was made.
    pub(super) fn of_columns(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        self.vectors.tr_mul(columns).resize_vertically(self.dimensions(), 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(seed: f64, rows: usize) -> DVector<f64> {
        DVector::from_fn(rows, |row, _| (seed * (row as f64 + 0.3) * 0.37).sin())
    }

    #[test]
    fn norms_and_products_are_kept() {
        let columns: Vec<DVector<f64>> = [1.0, 1.7, 1.70001, 5.0]
            .map(|seed| 3.0 * seed * column(seed, 500))
            .into_iter()
            .chain([DVector::zeros(500)])
            .collect();
        let matrix = DMatrix::from_columns(&columns);
        let mut basis = GrowingBasis::of(&matrix, 2).unwrap();
        let within = basis.of_columns(&matrix);
        let further = [column(2.2, 500), 1e3 * column(7.1, 500)];
        let coordinates = further.clone().map(|vector| basis.coordinates(&vector));
        for (one, there) in further.iter().zip(&coordinates) {
            for (other, its) in columns.iter().zip(within.column_iter()) {
                let scale = one.norm() * other.norm() + 1e-12;
                assert!((one.dot(other) - there.dot(&its)).abs() < 1e-10 * scale);
            }
        }
        let products = (&matrix.tr_mul(&matrix), &within.tr_mul(&within));
        assert!((products.0 - products.1).norm() < 1e-9 * products.0.norm());
        assert!((further[0].dot(&further[1]) - coordinates[0].dot(&coordinates[1])).abs() < 1e-8);
    }

    #[test]
    fn without_room_the_norm_is_kept() {
        let matrix = DMatrix::from_columns(&[column(1.0, 300)]);
        let mut basis = GrowingBasis::of(&matrix, 1).unwrap();
        for seed in [2.0, 3.0, 4.0] {
            let vector = column(seed, 300);
            let there = basis.coordinates(&vector);
            assert_eq!(there.len(), 3);
            assert!((there.norm() - vector.norm()).abs() < 1e-10 * vector.norm());
        }
    }

    #[test]
    fn a_vector_within_the_basis_adds_nothing() {
        let matrix = DMatrix::from_columns(&[column(1.0, 300), column(2.0, 300)]);
        let mut basis = GrowingBasis::of(&matrix, 1).unwrap();
        let there = basis.coordinates(&(2.0 * column(1.0, 300) - column(2.0, 300)));
        assert_eq!((there[2], there[3], basis.used), (0.0, 0.0, 2));
    }

    #[test]
    fn equal_columns_have_no_basis() {
        let matrix = DMatrix::from_columns(&[column(1.0, 300), column(1.0, 300)]);
        assert!(GrowingBasis::of(&matrix, 1).is_none());
    }
}
