//! A recorded position, smoothed, with its derivatives.

/// Half the span of the local parabola that smooths a position and gives its derivatives (s).
const REACH_S: f64 = 0.02;

/// A smoothed column and its first two derivatives.
pub(super) struct Motion {
    /// The position, smoothed.
    pub(super) position: Vec<f64>,
    /// Its rate (1/s).
    pub(super) velocity: Vec<f64>,
    /// The rate of that (1/s²).
    pub(super) acceleration: Vec<f64>,
}

impl Motion {
    /// From the least-squares parabola within [`REACH_S`] of each row; beyond its ends the column
    /// is constant.
    pub(super) fn of(column: &[f64], step_s: f64) -> Self {
        Self::within(column, step_s, REACH_S)
    }

    /// As [`Self::of`], within another half span.
    pub(super) fn within(column: &[f64], step_s: f64, reach_s: f64) -> Self {
        let reach = ((reach_s / step_s).round() as isize).max(1);
        let count = (2 * reach + 1) as f64;
        let squares = (-reach..=reach).map(|off| (off * off) as f64);
        let square: f64 = squares.clone().sum();
        let mean = square / count;
        let spread: f64 = squares.map(|square| (square - mean).powi(2)).sum();
        let last = column.len() as isize - 1;
        let at = |row: isize| column[row.clamp(0, last) as usize];
        let mut motion =
            Self { position: Vec::new(), velocity: Vec::new(), acceleration: Vec::new() };
        for row in 0..=last {
            let (mut sum, mut slope, mut bend) = (0.0, 0.0, 0.0);
            for off in -reach..=reach {
                let (value, off) = (at(row + off) - at(row), off as f64);
                sum += value;
                slope += off * value;
                bend += (off * off - mean) * value;
            }
            let bend = bend / spread;
            motion.position.push(at(row) + sum / count - bend * mean);
            motion.velocity.push(slope / square / step_s);
            motion.acceleration.push(2.0 * bend / (step_s * step_s));
        }
        motion
    }

    /// The mean of two columns.
    pub(super) fn mean(&self, other: &Self) -> Self {
        let mean = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect();
        Self {
            position: mean(&self.position, &other.position),
            velocity: mean(&self.velocity, &other.velocity),
            acceleration: mean(&self.acceleration, &other.acceleration),
        }
    }
}
