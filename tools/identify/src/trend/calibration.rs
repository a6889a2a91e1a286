//! Limits beyond which a change is told, by simulation of a quantity that does not change.
//!
//! Both statistics are free of the scale of the scatter: the strongest penalty at which there is a
//! change point, over the squared scatter of successive points, and Student's t of the slope. So
//! each series of recordings gets limits for its own number of points and its own weights, from
//! series of independent normal errors with a fixed seed.

use rand::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::change_points::{Costs, FEWEST, scatter};
use super::statistics::{Point, drift};

/// Seed of the simulated series.
const SEED: u64 = 0x7265_6e64;
/// Simulated series of one thread.
const BATCH: u64 = 500;
/// Evaluated segments of all simulated series, which their number follows.
const WORK: u64 = 400_000_000;
/// Fewest and most simulated batches.
const BATCHES: (u64, u64) = (8, 80);

/// Limits of the statistics of one quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Penalty per change point, in squared scatters ([`scatter`]).
    pub penalty: f64,
    /// Largest `|t|` of a slope that may be chance.
    pub t: f64,
}

impl Limits {
    /// Limits for points with these times and weights, of which each is exceeded with at most so
    /// large a probability where nothing changes. `None` for fewer than [`FEWEST`] points.
    pub fn of(points: &[Point], probability: f64) -> Option<Self> {
        let count = points.len() as u64;
        if points.len() < FEWEST {
            return None;
        }
        let batches = (WORK / (count * count * BATCH)).clamp(BATCHES.0, BATCHES.1);
        let statistics: Vec<[f64; 2]> =
            (0..batches).into_par_iter().flat_map_iter(|batch| simulated(points, batch)).collect();
        let [penalty, t] = [0, 1].map(|which| {
            let of = statistics.iter().map(|both| both[which]);
            exceeded(of.collect(), probability)
        });
        Some(Self { penalty, t })
    }
}

/// The value that a share `probability` of these exceeds at most.
fn exceeded(mut values: Vec<f64>, probability: f64) -> f64 {
    let above = (probability * values.len() as f64) as usize;
    let at = above.min(values.len().saturating_sub(1));
    let (_, limit, _) = values.select_nth_unstable_by(at, |a, b| b.total_cmp(a));
    *limit
}

/// Both statistics of each series of a batch.
fn simulated(points: &[Point], batch: u64) -> Vec<[f64; 2]> {
    let mut generator = Pcg64Mcg::seed_from_u64(SEED ^ (batch << 32));
    let mut series = points.to_vec();
    let mut costs = Costs::default();
    let mut of_one = |_| {
        for point in &mut series {
            let normal: f64 = StandardNormal.sample(&mut generator);
            point.value = normal * point.deviation;
        }
        costs.set(&series);
        let t = drift(&series).map_or(0.0, |drift| drift.t.abs());
        [costs.strongest() / scatter(&series).powi(2), t]
    };
    (0..BATCH).map(&mut of_one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Series that the calibration has not seen, with errors of another scale than stated.
    fn false_alarms(count: usize, probability: f64, series: u64) -> [u64; 2] {
        let deviation = |at: usize| 1.0 + 0.3 * (at % 4) as f64;
        let point = |at: usize| Point { time: at as f64, value: 0.0, deviation: deviation(at) };
        let points: Vec<Point> = (0..count).map(point).collect();
        let limits = Limits::of(&points, probability).unwrap();
        let mut generator = Pcg64Mcg::seed_from_u64(99);
        let mut alarms = [0; 2];
        for _ in 0..series {
            let mut own = points.clone();
            for point in &mut own {
                let normal: f64 = StandardNormal.sample(&mut generator);
                point.value = 40.0 + 0.2 * normal * point.deviation;
            }
            let penalty = limits.penalty * scatter(&own).powi(2);
            alarms[0] += u64::from(!Costs::of(&own).partition(penalty).is_empty());
            alarms[1] += u64::from(drift(&own).unwrap().t.abs() > limits.t);
        }
        alarms
    }

    #[test]
    fn a_constant_quantity_has_a_change_point_in_at_most_one_percent() {
        for count in [6, 12, 40] {
            let series = 4000;
            let alarms = false_alarms(count, 0.01, series);
            println!("{count} points: {alarms:?} of {series}");
            // 1 % of 4000, and three standard deviations of such a count more.
            assert!(alarms.iter().all(|own| *own <= 40 + 19), "{count} points: {alarms:?}");
            // The limits are not so high that nothing is ever told.
            assert!(alarms.iter().all(|own| *own >= 40 - 19), "{count} points: {alarms:?}");
        }
    }

    #[test]
    fn the_limit_of_a_slope_is_that_of_student() {
        let point = |at: usize| Point { time: at as f64, value: 0.0, deviation: 1.0 };
        let points: Vec<Point> = (0..12).map(point).collect();
        let limits = Limits::of(&points, 0.01).unwrap();
        // Two-sided 1 % of 10 degrees of freedom.
        assert!((limits.t - 3.169).abs() < 0.15, "{limits:?}");
        assert!(Limits::of(&points[..5], 0.01).is_none());
        assert_eq!(limits, Limits::of(&points, 0.01).unwrap());
    }
}
