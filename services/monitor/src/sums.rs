//! Sums over innovations and directions, from which every estimate follows.

use nalgebra::{DMatrix, DVector};

use crate::bank::{CHANNELS, Innovations};

/// Sums over some rows, by channel: of products of directions, of directions with the innovation,
/// and of the innovation's square.
#[derive(Clone, Debug)]
pub struct Sums {
    products: [DMatrix<f64>; CHANNELS],
    with: [DVector<f64>; CHANNELS],
    squares: [f64; CHANNELS],
    rows: u32,
    scratch: DVector<f64>,
}

impl Sums {
    /// Empty sums for so many directions.
    pub fn new(directions: usize) -> Self {
        let matrix = || DMatrix::zeros(directions, directions);
        let vector = || DVector::zeros(directions);
        Self {
            products: [matrix(), matrix()],
            with: [vector(), vector()],
            squares: [0.0; CHANNELS],
            rows: 0,
            scratch: vector(),
        }
    }

    /// Number of rows.
    pub const fn rows(&self) -> u32 {
        self.rows
    }

    /// Empties them.
    pub fn clear(&mut self) {
        self.scale(0.0);
        self.rows = 0;
    }

    /// Adds a row. Does not allocate.
    pub fn add(&mut self, row: &Innovations) {
        for channel in 0..CHANNELS {
            for (own, direction) in self.scratch.iter_mut().zip(&row.directions) {
                *own = direction[channel];
            }
            let innovation = row.linear[channel];
            // The lower triangle is enough.
            self.products[channel].syger(1.0, &self.scratch, &self.scratch, 1.0);
            self.with[channel].axpy(innovation, &self.scratch, 1.0);
            self.squares[channel] += innovation * innovation;
        }
        self.rows += 1;
    }

    /// Adds other sums. Does not allocate.
    pub fn add_sums(&mut self, other: &Self) {
        for channel in 0..CHANNELS {
            self.products[channel] += &other.products[channel];
            self.with[channel] += &other.with[channel];
            self.squares[channel] += other.squares[channel];
        }
        self.rows += other.rows;
    }

    /// Multiplies them by a factor, to forget what is old; the number of rows stays.
    pub fn scale(&mut self, factor: f64) {
        for channel in 0..CHANNELS {
            self.products[channel] *= factor;
            self.with[channel] *= factor;
            self.squares[channel] *= factor;
        }
    }

    /// Sum of the products of two directions over both channels, weighted.
    pub fn product(&self, one: usize, other: usize, weights: [f64; CHANNELS]) -> f64 {
        let at = (one.max(other), one.min(other));
        self.products.iter().zip(weights).map(|(own, weight)| weight * own[at]).sum()
    }

    /// Sum of the products of a direction and the innovation over both channels, weighted.
    pub fn with(&self, direction: usize, weights: [f64; CHANNELS]) -> f64 {
        self.with.iter().zip(weights).map(|(own, weight)| weight * own[direction]).sum()
    }

    /// Mean square of the innovation less `shares` of the first directions, by channel (rad²); 0
    /// without rows.
    pub fn energy_less(&self, shares: &DVector<f64>) -> [f64; CHANNELS] {
        let mut energies = [0.0; CHANNELS];
        for (channel, energy) in energies.iter_mut().enumerate() {
            let weights = std::array::from_fn(|at| f64::from(u8::from(at == channel)));
            let mut sum = self.squares[channel];
            for (at, share) in shares.iter().enumerate() {
                sum -= 2.0 * share * self.with(at, weights);
                for (other, other_share) in shares.iter().enumerate() {
                    sum += share * other_share * self.product(at, other, weights);
                }
            }
            *energy = (sum / f64::from(self.rows.max(1))).max(0.0);
        }
        energies
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(declared: [f64; CHANNELS], directions: [[f64; CHANNELS]; 2]) -> Innovations {
        let directions = directions.to_vec();
        Innovations { linear: declared, directions, ..Innovations::default() }
    }

    #[test]
    fn what_a_direction_explains_leaves_no_energy() {
        let mut sums = Sums::new(2);
        for step in 0..50 {
            let (one, two) = (f64::from(step).sin(), f64::from(3 * step).cos());
            // Twice the first and minus once the second direction.
            let declared = [2.0 * one - two, 4.0 * one - 0.5 * two];
            sums.add(&row(declared, [[one, 2.0 * one], [two, 0.5 * two]]));
        }
        let left = sums.energy_less(&DVector::from_vec(vec![2.0, -1.0]));
        assert!(left.iter().all(|energy| *energy < 1e-12), "{left:?}");
        let none = sums.energy_less(&DVector::zeros(2));
        let squares: f64 = (0..50)
            .map(|step| (2.0 * f64::from(step).sin() - f64::from(3 * step).cos()).powi(2))
            .sum();
        assert!((none[0] - squares / 50.0).abs() < 1e-12);
        assert_eq!(sums.product(0, 1, [1.0, 0.0]), sums.product(1, 0, [1.0, 0.0]));
    }

    #[test]
    fn sums_of_parts_are_the_sums_of_the_whole() {
        let [mut whole, mut first, mut second] = [(); 3].map(|()| Sums::new(2));
        for step in 0..20 {
            let value = f64::from(step);
            let row = row([value, -value], [[1.0, value], [value, 2.0]]);
            whole.add(&row);
            if step < 7 { first.add(&row) } else { second.add(&row) }
        }
        first.add_sums(&second);
        assert_eq!(first.rows(), whole.rows());
        assert_eq!(first.with(1, [1.0, 1.0]), whole.with(1, [1.0, 1.0]));
        first.clear();
        assert_eq!((first.rows(), first.with(1, [1.0, 1.0])), (0, 0.0));
    }
}
