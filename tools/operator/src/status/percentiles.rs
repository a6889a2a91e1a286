//! Percentiles of a time.

use serde::Serialize;

/// p50, p99, p99.9 and the largest, µs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99 of 100 are at most this.
    pub p99: f64,
    /// 999 of 1000 are at most this.
    pub p99_9: f64,
    /// The largest.
    pub max: f64,
}

impl Percentiles {
    /// Of times in ns, by nearest rank; `None` without any.
    pub fn of_ns(mut times_ns: Vec<u64>) -> Option<Self> {
        times_ns.sort_unstable();
        let last = times_ns.len().checked_sub(1)?;
        let at = |quantile: f64| {
            let rank = (quantile * times_ns.len() as f64).ceil() as usize;
            micros(times_ns[rank.saturating_sub(1).min(last)])
        };
        Some(Self { p50: at(0.5), p99: at(0.99), p99_9: at(0.999), max: micros(times_ns[last]) })
    }

    /// The larger of each.
    #[must_use]
    pub fn worst(self, other: Self) -> Self {
        Self {
            p50: self.p50.max(other.p50),
            p99: self.p99.max(other.p99),
            p99_9: self.p99_9.max(other.p99_9),
            max: self.max.max(other.max),
        }
    }
}

impl From<[u64; 4]> for Percentiles {
    /// From the four values of a `LoopTiming` (ns).
    fn from(ns: [u64; 4]) -> Self {
        let [p50, p99, p99_9, max] = ns.map(micros);
        Self { p50, p99, p99_9, max }
    }
}

fn micros(ns: u64) -> f64 {
    ns as f64 / 1000.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_rank_on_a_known_row() {
        let row = Percentiles::of_ns((1..=1000).rev().map(|us| us * 1000).collect());
        assert_eq!(row, Some(Percentiles { p50: 500.0, p99: 990.0, p99_9: 999.0, max: 1000.0 }));
        assert_eq!(
            Percentiles::of_ns(vec![7000]),
            Some(Percentiles { p50: 7.0, p99: 7.0, p99_9: 7.0, max: 7.0 })
        );
        assert_eq!(Percentiles::of_ns(vec![]), None);
    }
}
