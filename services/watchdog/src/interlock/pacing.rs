//! Whether messages come faster than their rate: the least interval of a heartbeat, whose greatest
//! is the silence after which a peer is lost.

/// How many periods early a message may be. A loop on the grid that is held up for long answers
/// once late and once at once, and is then on time: three messages within one period at most.
const TOLERANCE: u64 = 3;

/// Supervises the rate of one sender by the generic cell rate algorithm (ITU-T I.371): each message
/// moves the time at which the next is expected by a period; one that comes earlier than that, by
/// more than the tolerance, is too fast.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pacing {
    expected_ns: u64,
}

impl Pacing {
    /// Takes a message of that time; returns whether it comes too fast. A sender at twice its rate
    /// is found within seven messages, one at 1.1 times its rate within 34.
    pub(super) fn too_fast(&mut self, time_ns: u64, period_ns: u64) -> bool {
        let tolerance_ns = TOLERANCE * period_ns;
        let early = time_ns.saturating_add(tolerance_ns) < self.expected_ns;
        // After an early message the count begins anew, so that the fault ends with its cause.
        let from_ns = if early { time_ns } else { self.expected_ns.max(time_ns) };
        self.expected_ns = from_ns.saturating_add(period_ns);
        early
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PERIOD: u64 = 2_000_000;

    /// How many messages at this interval (ns) until one is too fast.
    fn found_after(interval_ns: u64) -> Option<u64> {
        let mut pacing = Pacing::default();
        (0..10_000u64).find(|at| pacing.too_fast(1_000_000_000 + at * interval_ns, PERIOD))
    }

    #[test]
    fn a_sender_that_is_too_fast_is_found_soon_and_one_in_time_never() {
        assert_eq!(found_after(PERIOD), None);
        assert_eq!(found_after(PERIOD + 1), None);
        assert!(found_after(PERIOD / 2).is_some_and(|messages| messages <= 7));
        assert!(found_after(PERIOD * 10 / 11).is_some_and(|messages| messages <= 34));
        assert_eq!(found_after(0), Some(4), "as many as the tolerance, after the one in time");
    }

    #[test]
    fn the_fault_ends_with_its_cause() {
        let mut pacing = Pacing::default();
        let mut now = 1_000_000_000;
        let mut found = 0;
        for _ in 0..1000 {
            now += PERIOD / 4;
            found += u32::from(pacing.too_fast(now, PERIOD));
        }
        // Often enough for a fault that is held for a few periods to stay active.
        assert!(found >= 150, "{found}");
        now += PERIOD;
        pacing.too_fast(now, PERIOD);
        for _ in 0..1000 {
            now += PERIOD;
            assert!(!pacing.too_fast(now, PERIOD));
        }
    }

    proptest! {
        /// Any pattern of stalls of a loop on an absolute grid.
        #[test]
        fn a_late_loop_on_the_grid_is_never_too_fast(
            // Of each cycle: how late it wakes, and how long it then takes to compute.
            cycles in prop::collection::vec((0u64..30_000_000, 0u64..30_000_000, 0u8..4), 1..300),
        ) {
            let mut grid = runtime::Grid::new(PERIOD, 200_000);
            let mut pacing = Pacing::default();
            let mut now = 1_000_000_000;
            for (late, run, stalls) in cycles {
                now = grid.due(now).max(now) + if stalls & 1 == 1 { late } else { late % 100_000 };
                prop_assert!(grid.wake(now).is_some());
                now += if stalls & 2 == 2 { run } else { run % 100_000 };
                prop_assert!(!pacing.too_fast(now, PERIOD));
            }
        }
    }
}
