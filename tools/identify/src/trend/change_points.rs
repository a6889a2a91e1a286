//! Change points of a piecewise constant mean, by optimal partitioning.
//!
//! Of all partitions into segments of at least [`SHORTEST`] points, that with the least
//!
//! ```text
//! Σ over segments Σ (xᵢ - mean)²/σᵢ²  +  penalty · (number of change points)
//! ```
//!
//! is found exactly, by dynamic programming over the last change point (Jackson et al. 2005; PELT
//! prunes the same recursion). The `σᵢ` tell the weights; their common scale is taken from the
//! scatter of successive points, since the stated standard deviations hold errors that all
//! recordings share, and since a machine may vary more from day to day than its recordings tell.

use super::statistics::Point;

/// Fewest points in a segment.
pub const SHORTEST: usize = 3;
/// Fewest points in which a change point is looked for.
pub const FEWEST: usize = 2 * SHORTEST;
/// Share of the largest successive differences that does not count for the scatter: those over
/// change points are among them.
const TRIMMED: f64 = 0.2;
/// Least scatter, in stated standard deviations: points that are all alike have none.
const LEAST_SCATTER: f64 = 1e-6;

/// Sums that give the cost of any segment at once.
#[derive(Clone, Debug, Default)]
pub struct Costs {
    /// Sums up to each point of weight, weight times value, weight times squared value.
    sums: Vec<[f64; 3]>,
}

impl Costs {
    /// Of a series of points.
    pub fn of(points: &[Point]) -> Self {
        let mut costs = Self::default();
        costs.set(points);
        costs
    }

    /// As [`Self::of`], in memory that is there already.
    pub fn set(&mut self, points: &[Point]) {
        // Values from the first one on: squares of large values lose the small differences.
        let origin = points.first().map_or(0.0, |point| point.value);
        let mut sum = [0.0; 3];
        self.sums.clear();
        self.sums.push(sum);
        for point in points {
            let (weight, value) = (point.deviation.powi(-2), point.value - origin);
            sum = [sum[0] + weight, sum[1] + weight * value, sum[2] + weight * value * value];
            self.sums.push(sum);
        }
    }

    /// Number of points.
    pub fn count(&self) -> usize {
        self.sums.len().saturating_sub(1)
    }

    /// `Σ (xᵢ - mean)²/σᵢ²` over points `from..to`.
    pub fn cost(&self, from: usize, to: usize) -> f64 {
        let [weight, first, second] =
            std::array::from_fn(|k| self.sums[to][k] - self.sums[from][k]);
        (second - first * first / weight).max(0.0)
    }

    /// Cost of all segments between these change points.
    pub fn cost_of(&self, change_points: &[usize]) -> f64 {
        let ends = change_points.iter().copied().chain([self.count()]);
        let mut from = 0;
        ends.map(|to| self.cost(std::mem::replace(&mut from, to), to)).sum()
    }

    /// The best partition for a penalty per change point: the first points of all segments but the
    /// first.
    pub fn partition(&self, penalty: f64) -> Vec<usize> {
        let count = self.count();
        // Least cost of the points before `to`, and where its last segment begins.
        let mut best = vec![(f64::INFINITY, 0); count + 1];
        best[0].0 = -penalty;
        for to in SHORTEST..=count {
            for from in std::iter::once(0).chain(SHORTEST..=to - SHORTEST) {
                let cost = best[from].0 + penalty + self.cost(from, to);
                if cost < best[to].0 {
                    best[to] = (cost, from);
                }
            }
        }
        let mut change_points = Vec::new();
        let mut at = best[count].1;
        while at > 0 {
            change_points.push(at);
            at = best[at].1;
        }
        change_points.reverse();
        change_points
    }

    /// The largest penalty at which [`Self::partition`] finds a change point: the largest decrease
    /// of the cost per change point over all partitions, by Dinkelbach's iteration.
    pub fn strongest(&self) -> f64 {
        let whole = self.cost(0, self.count());
        let mut strongest = 0.0;
        loop {
            let found = self.partition(strongest);
            let gain = match found.len() {
                0 => return strongest,
                changes => (whole - self.cost_of(&found)) / changes as f64,
            };
            if gain <= strongest * (1.0 + 1e-9) {
                return strongest.max(gain);
            }
            strongest = gain;
        }
    }
}

/// Scatter of successive points, in their stated standard deviations, without the largest fifth of
/// the differences. It is too small by a factor that depends on the number of points alone, which
/// the calibration of penalties takes into account.
pub fn scatter(points: &[Point]) -> f64 {
    let difference = |pair: &[Point]| {
        let variance = pair[0].deviation.powi(2) + pair[1].deviation.powi(2);
        (pair[1].value - pair[0].value).powi(2) / variance
    };
    let mut squares: Vec<f64> = points.windows(2).map(difference).collect();
    squares.sort_by(f64::total_cmp);
    let trimmed = ((TRIMMED * squares.len() as f64).ceil() as usize).min(squares.len());
    let kept = &squares[..squares.len() - trimmed];
    (kept.iter().sum::<f64>() / kept.len().max(1) as f64).sqrt().max(LEAST_SCATTER)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn series(values: &[f64]) -> Vec<Point> {
        let point = |(at, value): (usize, &f64)| Point {
            time: at as f64,
            value: *value,
            deviation: 0.5 + 0.1 * (at % 3) as f64,
        };
        values.iter().enumerate().map(point).collect()
    }

    #[test]
    fn a_constant_has_none_and_each_step_is_found_where_it_is() {
        let flat = [3.0; 12];
        assert!(Costs::of(&series(&flat)).partition(1.0).is_empty());
        let mut one = flat;
        one[5..].fill(9.0);
        assert_eq!(Costs::of(&series(&one)).partition(10.0), [5]);
        let mut two = one;
        two[9..].fill(3.0);
        assert_eq!(Costs::of(&series(&two)).partition(10.0), [5, 9]);
        // Two points are no segment.
        let mut late = flat;
        late[10..].fill(30.0);
        assert_eq!(Costs::of(&series(&late)).partition(10.0), [9]);
        assert!(Costs::of(&series(&flat[..5])).partition(0.0).is_empty());
    }

    #[test]
    fn differences_that_vanish_beside_the_values_are_seen() {
        let values: Vec<f64> = (0..12).map(|at| 1e9 + f64::from(u8::from(at >= 6))).collect();
        assert_eq!(Costs::of(&series(&values)).partition(2.0), [6]);
    }

    #[test]
    fn steps_hardly_change_the_scatter() {
        let noise = crate::test_noise::noise(3, 20);
        let mut stepped = noise.clone();
        stepped[8..].iter_mut().for_each(|value| *value += 100.0);
        let [flat, stepped] = [noise, stepped].map(|values| scatter(&series(&values)));
        assert!(stepped < 1.5 * flat, "{flat} {stepped}");
        assert!(scatter(&series(&[1.0; 8])) > 0.0 && scatter(&[]) > 0.0);
    }

    /// All partitions, one by one.
    fn least(costs: &Costs, penalty: f64, from: usize) -> f64 {
        let count = costs.count();
        let whole = costs.cost(from, count);
        let parts = (from + SHORTEST..=count.saturating_sub(SHORTEST))
            .map(|at| costs.cost(from, at) + penalty + least(costs, penalty, at));
        parts.fold(whole, f64::min)
    }

    proptest! {
        #[test]
        fn no_partition_is_better(
            values in prop::collection::vec(-5.0..5.0f64, 6..13), penalty in 0.0..20.0f64
        ) {
            let costs = Costs::of(&series(&values));
            let found = costs.partition(penalty);
            let cost = costs.cost_of(&found) + penalty * found.len() as f64;
            prop_assert!((cost - least(&costs, penalty, 0)).abs() < 1e-9);
            let ends: Vec<usize> =
                std::iter::once(0).chain(found).chain([values.len()]).collect();
            prop_assert!(ends.windows(2).all(|pair| pair[1] - pair[0] >= SHORTEST));
        }

        #[test]
        fn the_strongest_penalty_separates_some_from_none(
            values in prop::collection::vec(-5.0..5.0f64, 6..20)
        ) {
            let costs = Costs::of(&series(&values));
            let strongest = costs.strongest();
            prop_assert!(costs.partition(1.001 * strongest + 1e-9).is_empty());
            prop_assume!(strongest > 1e-6);
            prop_assert!(!costs.partition(0.999 * strongest).is_empty());
        }

        #[test]
        fn neither_shift_nor_scale_moves_a_change_point(
            values in prop::collection::vec(-5.0..5.0f64, 6..20),
            shift in -1e3..1e3f64, scale in 0.1..10.0f64
        ) {
            let points = series(&values);
            let other: Vec<Point> = points.iter().map(|own| Point {
                value: shift + scale * own.value, deviation: scale * own.deviation, ..*own
            }).collect();
            let [own, moved] = [&points, &other].map(|points| {
                Costs::of(points).strongest() / scatter(points).powi(2)
            });
            prop_assert!((own - moved).abs() < 1e-5 * (1.0 + own), "{own} {moved}");
        }
    }
}
