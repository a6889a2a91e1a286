//! Bounded linear least squares, with standard deviations that hold for correlated residuals.

use nalgebra::{DMatrix, DVector};

use crate::estimate_correlation;

/// Sums of products over a set of rows: sufficient for a fit, and additive over sets.
#[derive(Clone, Debug)]
pub struct Gram {
    /// Of columns with columns.
    pub xx: DMatrix<f64>,
    /// Of columns with the target.
    pub xy: DVector<f64>,
    /// Of the target with itself.
    pub yy: f64,
    /// Number of rows.
    pub rows: usize,
}

impl Gram {
    /// No rows.
    pub fn empty(columns: usize) -> Self {
        Self { xx: DMatrix::zeros(columns, columns), xy: DVector::zeros(columns), yy: 0.0, rows: 0 }
    }

    /// Adds the rows `range` of the columns and of the target.
    pub fn add(&mut self, columns: &[Vec<f64>], target: &[f64], range: std::ops::Range<usize>) {
        for (i, a) in columns.iter().enumerate() {
            let a = &a[range.clone()];
            for (j, b) in columns.iter().enumerate().take(i + 1) {
                let sum: f64 = a.iter().zip(&b[range.clone()]).map(|(x, y)| x * y).sum();
                self.xx[(i, j)] += sum;
                if i != j {
                    self.xx[(j, i)] += sum;
                }
            }
            self.xy[i] += a.iter().zip(&target[range.clone()]).map(|(x, y)| x * y).sum::<f64>();
        }
        self.yy += target[range.clone()].iter().map(|y| y * y).sum::<f64>();
        self.rows += range.len();
    }

    /// Sum of squared residuals of these coefficients.
    pub fn squares(&self, coefficients: &DVector<f64>) -> f64 {
        (self.yy - 2.0 * self.xy.dot(coefficients) + (&self.xx * coefficients).dot(coefficients))
            .max(0.0)
    }
}

/// Lower and upper bound of a coefficient.
pub type Bound = (f64, f64);

/// A fit: coefficients, and which of them are at a bound.
#[derive(Clone, Debug)]
pub struct Fit {
    /// In the order of the columns.
    pub coefficients: DVector<f64>,
    /// Whether the coefficient is at one of its bounds.
    pub at_bound: Vec<bool>,
    /// Sum of squared residuals over the fitted rows.
    pub squares: f64,
}

/// Ridge relative to the squared length of each column, so that empty bins of a spline do not make
/// the matrix singular.
const RIDGE: f64 = 1e-10;

/// Least squares within bounds, by the active-set method of Stark and Parker, "Bounded-variable
/// least squares: an algorithm and applications", Computational Statistics 10 (1995).
///
/// `None` where the free columns are collinear.
pub fn solve(gram: &Gram, bounds: &[Bound]) -> Option<Fit> {
    let p = gram.xy.len();
    // Columns are scaled to unit length: kg and N·s/m differ by orders of magnitude.
    let scale: Vec<f64> = (0..p).map(|i| gram.xx[(i, i)].sqrt().max(f64::MIN_POSITIVE)).collect();
    let a = DMatrix::from_fn(p, p, |i, j| {
        let value = gram.xx[(i, j)] / (scale[i] * scale[j]);
        if i == j { value + RIDGE } else { value }
    });
    let b = DVector::from_fn(p, |i, _| gram.xy[i] / scale[i]);
    let bound = |i: usize| (bounds[i].0 * scale[i], bounds[i].1 * scale[i]);
    let mut fixed: Vec<Option<f64>> = vec![None; p];
    // Coefficients beyond their bounds are fixed at them one at a time, the worst first; those
    // whose gradient points inward are freed again. Each pass lowers the sum of squares, so the
    // loop terminates; the limit is a safeguard.
    let mut x = DVector::zeros(p);
    for _ in 0..6 * p + 6 {
        x = solve_free(&a, &b, &fixed)?;
        let worst = (0..p)
            .filter(|&i| fixed[i].is_none())
            .map(|i| (i, (bound(i).0 - x[i]).max(x[i] - bound(i).1)))
            .filter(|(_, excess)| *excess > 1e-12 * b.norm())
            .max_by(|l, r| l.1.total_cmp(&r.1));
        if let Some((i, _)) = worst {
            fixed[i] = Some(x[i].clamp(bound(i).0, bound(i).1));
            continue;
        }
        let gradient = &a * &x - &b;
        let inward = (0..p).find(|&i| match fixed[i] {
            Some(v) if bound(i).0 < bound(i).1 => {
                (v == bound(i).0 && gradient[i] < -1e-9 * b.norm())
                    || (v == bound(i).1 && gradient[i] > 1e-9 * b.norm())
            }
            _ => false,
        });
        match inward {
            Some(i) => fixed[i] = None,
            None => break,
        }
    }
    let coefficients = DVector::from_fn(p, |i, _| (x[i]).clamp(bound(i).0, bound(i).1) / scale[i]);
    let at_bound = fixed.iter().map(Option::is_some).collect();
    let squares = gram.squares(&coefficients);
    Some(Fit { coefficients, at_bound, squares })
}

fn solve_free(a: &DMatrix<f64>, b: &DVector<f64>, fixed: &[Option<f64>]) -> Option<DVector<f64>> {
    let free: Vec<usize> = (0..fixed.len()).filter(|&i| fixed[i].is_none()).collect();
    let mut x = DVector::from_iterator(fixed.len(), fixed.iter().map(|v| v.unwrap_or(0.0)));
    if free.is_empty() {
        return Some(x);
    }
    let right = b - a * &x;
    let part = DMatrix::from_fn(free.len(), free.len(), |i, j| a[(free[i], free[j])]);
    let solution = part.cholesky()?.solve(&DVector::from_fn(free.len(), |i, _| right[free[i]]));
    for (i, v) in free.iter().zip(solution.iter()) {
        x[*i] = *v;
    }
    Some(x)
}

/// How far estimated coefficients may be off.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    /// Standard deviation of each.
    pub std: Vec<f64>,
    /// Correlation of each with each; 0 for those at a bound.
    pub correlation: DMatrix<f64>,
}

/// Uncertainty by the cluster sandwich of Liang and Zeger (1986): residuals may be
/// correlated in any way within a cluster (after a low-pass they are) and have any variance;
/// clusters are independent. `scores` holds `Xᵀe` of each cluster. Coefficients at a bound get 0.
pub fn uncertainty(gram: &Gram, fit: &Fit, scores: &[DVector<f64>]) -> Uncertainty {
    let free: Vec<usize> = (0..fit.at_bound.len()).filter(|&i| !fit.at_bound[i]).collect();
    let count = fit.at_bound.len();
    let (mut std, mut correlation) = (vec![0.0; count], DMatrix::zeros(count, count));
    let scale: Vec<f64> =
        free.iter().map(|&i| gram.xx[(i, i)].sqrt().max(f64::MIN_POSITIVE)).collect();
    let k = free.len();
    let bread = DMatrix::from_fn(k, k, |i, j| {
        gram.xx[(free[i], free[j])] / (scale[i] * scale[j]) + if i == j { RIDGE } else { 0.0 }
    });
    let Some(bread) = bread.cholesky().map(|c| c.inverse()) else {
        return Uncertainty { std: vec![f64::INFINITY; count], correlation };
    };
    let mut meat = DMatrix::zeros(k, k);
    for score in scores {
        let s = DVector::from_fn(k, |i, _| score[free[i]] / scale[i]);
        meat += &s * s.transpose();
    }
    let g = scores.len() as f64;
    let small_sample = if g > k as f64 + 1.0 { g / (g - k as f64) } else { f64::INFINITY };
    let covariance = &bread * meat * &bread * small_sample;
    let of_free = estimate_correlation::correlation(&covariance);
    for (i, &index) in free.iter().enumerate() {
        std[index] = covariance[(i, i)].max(0.0).sqrt() / scale[i];
        for (j, &other) in free.iter().enumerate() {
            correlation[(index, other)] = of_free[(i, j)];
        }
    }
    Uncertainty { std, correlation }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FREE: Bound = (f64::NEG_INFINITY, f64::INFINITY);

    fn gram(columns: &[Vec<f64>], target: &[f64]) -> Gram {
        let mut g = Gram::empty(columns.len());
        g.add(columns, target, 0..target.len());
        g
    }

    #[test]
    fn exact_data_give_exact_coefficients_whatever_the_units() {
        let x: Vec<f64> = (0..50).map(|i| f64::from(i % 7) * 1e-6).collect();
        let y: Vec<f64> = (0..50).map(|i| f64::from(i % 5) * 1e3).collect();
        let target: Vec<f64> = x.iter().zip(&y).map(|(x, y)| 2e6 * x - 3e-3 * y).collect();
        let fit = solve(&gram(&[x, y], &target), &[FREE, FREE]).unwrap();
        assert!((fit.coefficients[0] / 2e6 - 1.0).abs() < 1e-8);
        assert!((fit.coefficients[1] / -3e-3 - 1.0).abs() < 1e-8);
    }

    #[test]
    fn the_bounded_solution_is_not_worse_than_a_fine_search() {
        let a: Vec<f64> = (0..40).map(|i| f64::from(i * 7 % 11) - 5.0).collect();
        let b: Vec<f64> = a.iter().enumerate().map(|(i, a)| 0.8 * a + (i % 3) as f64).collect();
        let target: Vec<f64> = a
            .iter()
            .zip(&b)
            .enumerate()
            .map(|(i, (a, b))| 3.0 * a - 2.0 * b + (i % 2) as f64)
            .collect();
        let g = gram(&[a, b], &target);
        let bounds = [(0.0, 1.5), (-0.5, 4.0)];
        let fit = solve(&g, &bounds).unwrap();
        let mut best = f64::INFINITY;
        for i in 0..=300 {
            for j in 0..=300 {
                let at = |b: Bound, k: i32| b.0 + (b.1 - b.0) * f64::from(k) / 300.0;
                best = best
                    .min(g.squares(&DVector::from_vec(vec![at(bounds[0], i), at(bounds[1], j)])));
            }
        }
        assert!(fit.squares <= best + 1e-9, "{} {best}", fit.squares);
        assert!(fit.at_bound[0]);
    }

    #[test]
    fn sandwich_covers_correlated_noise_where_the_classic_formula_does_not() {
        // Noise that is constant over clusters of 20 rows: the mean of 400 rows is as uncertain as
        // that of 20 values.
        let noise: Vec<f64> = (0..400).map(|i| f64::from((i / 20) * 7919 % 13) - 6.0).collect();
        let ones = vec![1.0; 400];
        let g = gram(&[ones], &noise);
        let fit = solve(&g, &[FREE]).unwrap();
        let scores: Vec<_> = noise
            .chunks(20)
            .map(|c| {
                DVector::from_vec(vec![c.iter().map(|e| e - fit.coefficients[0]).sum::<f64>()])
            })
            .collect();
        let values: Vec<f64> = noise.iter().step_by(20).copied().collect();
        let mean = values.iter().sum::<f64>() / 20.0;
        let expected =
            (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 19.0 / 20.0).sqrt();
        let std = uncertainty(&g, &fit, &scores).std[0];
        assert!((std / expected - 1.0).abs() < 0.01, "{std} {expected}");
    }
}
