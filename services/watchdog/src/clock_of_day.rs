//! Whether somebody sets the clock of the day. Nothing of the rig depends on it, since all its
//! times are of `CLOCK_MONOTONIC`; but what other instruments record beside the rig may.

use runtime::clock::ClockPair;

/// Least step that is reported (ns). A clock that is adjusted by its rate moves by 0.5 ms/s at
/// most.
const STEP_NS: u64 = 20_000_000;

/// Follows the clock of the day.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ClockOfDay {
    offset_ns: Option<i64>,
}

impl ClockOfDay {
    /// Takes a reading; returns by how much the clock was set since the last one (s).
    pub(crate) fn step_s(&mut self, pair: ClockPair) -> Option<f64> {
        let offset_ns = pair.offset_ns();
        let step_ns = offset_ns.wrapping_sub(self.offset_ns.replace(offset_ns)?);
        let least_ns = STEP_NS.saturating_add(pair.uncertainty_ns);
        (step_ns.unsigned_abs() > least_ns).then_some(step_ns as f64 * 1e-9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(monotonic_ns: u64, realtime_ns: u64) -> ClockPair {
        ClockPair { monotonic_ns, realtime_ns, uncertainty_ns: 100 }
    }

    #[test]
    fn a_step_is_reported_once_and_an_adjusted_rate_not() {
        const DAY: u64 = 1_700_000_000_000_000_000;
        let mut clock = ClockOfDay::default();
        assert_eq!(clock.step_s(pair(1_000, DAY)), None, "the first reading");
        for second in 1..100 {
            let realtime = DAY + second * 1_000_500_000;
            assert_eq!(clock.step_s(pair(1_000 + second * 1_000_000_000, realtime)), None);
        }
        let later = 1_000 + 100 * 1_000_000_000;
        let step = clock.step_s(pair(later, DAY + 100 * 1_000_500_000 - 3_600_000_000_000));
        assert!(step.is_some_and(|step| (step + 3600.0).abs() < 1e-3), "{step:?}");
        assert_eq!(clock.step_s(pair(later, DAY + 100 * 1_000_500_000 - 3_600_000_000_000)), None);
    }
}
