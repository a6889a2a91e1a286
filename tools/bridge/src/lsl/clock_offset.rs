//! From the rig's clock to another one.

use runtime::clock::SECOND_NS;

/// How often both clocks are read.
const READINGS: usize = 32;

/// What another clock shows when `CLOCK_MONOTONIC`, the rig's clock, shows 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ClockOffset {
    /// s
    pub(crate) offset_s: f64,
    /// Most by which the offset is wrong (s): half the time between the two readings of the rig's
    /// clock around the one of the other.
    pub(crate) uncertainty_s: f64,
}

impl ClockOffset {
    /// Reads both clocks; the best of 32 attempts, so that a few preemptions do not spoil it.
    pub(crate) fn measure(rig_ns: impl Fn() -> u64, other_s: impl Fn() -> f64) -> Self {
        let mut best = Self { offset_s: 0.0, uncertainty_s: f64::INFINITY };
        for _ in 0..READINGS {
            let before_ns = rig_ns();
            let other_s = other_s();
            let uncertainty_s = seconds(rig_ns().saturating_sub(before_ns)) / 2.0;
            if uncertainty_s < best.uncertainty_s {
                best =
                    Self { offset_s: other_s - seconds(before_ns) - uncertainty_s, uncertainty_s };
            }
        }
        best
    }

    /// A time of the rig (ns) by the other clock (s).
    pub(crate) fn by_other_s(&self, rig_ns: u64) -> f64 {
        seconds(rig_ns) + self.offset_s
    }

    /// Whether a later measurement may be of the same offset.
    pub(crate) fn agrees(&self, later: &Self) -> bool {
        let apart_s = (self.offset_s - later.offset_s).abs();
        apart_s <= self.uncertainty_s + later.uncertainty_s
    }
}

impl std::fmt::Display for ClockOffset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.9} s, within {:.9} s", self.offset_s, self.uncertainty_s)
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 / SECOND_NS as f64
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// Two clocks that are `offset_ns` apart; each reading takes its time, the next of `takes_ns`.
    fn measured(offset_ns: i64, takes_ns: &[u64]) -> ClockOffset {
        let (now, readings) = (Cell::new(5_000_000_000u64), Cell::new(0));
        let pass = || {
            let at = readings.replace(readings.get() + 1);
            now.set(now.get() + takes_ns[at % takes_ns.len()]);
            now.get()
        };
        ClockOffset::measure(pass, || seconds(pass().saturating_add_signed(offset_ns)))
    }

    #[test]
    fn the_true_offset_lies_within_the_uncertainty() {
        for offset_ns in [0, 1, -4_999_999_999, 987_654_321_000] {
            for takes_ns in [&[50][..], &[40, 900, 30], &[7, 70, 700, 7000], &[3_000_000, 20]] {
                let found = measured(offset_ns, takes_ns);
                let error_s = (found.offset_s - offset_ns as f64 / 1e9).abs();
                assert!(error_s <= found.uncertainty_s + 1e-12, "{found:?} of {offset_ns}");
            }
        }
    }

    #[test]
    fn the_shortest_attempt_counts() {
        // Readings in threes: of the rig, of the other, of the rig. One attempt in four is quick.
        let slow = [900, 900, 900];
        let takes_ns = [&slow[..], &slow, &slow, &[900, 20, 20]].concat();
        assert!((measured(0, &takes_ns).uncertainty_s - 20e-9).abs() < 1e-15);
    }

    #[test]
    fn times_are_moved_by_the_offset() {
        let offset = ClockOffset { offset_s: 0.25, uncertainty_s: 1e-7 };
        assert_eq!(offset.by_other_s(1_500_000_000), 1.75);
        assert!(offset.agrees(&ClockOffset { offset_s: 0.250_000_15, uncertainty_s: 1e-7 }));
        assert!(!offset.agrees(&ClockOffset { offset_s: 0.250_000_3, uncertainty_s: 1e-7 }));
    }
}
