//! The absolute grid that every periodic process wakes on.
//!
//! tick = `CLOCK_MONOTONIC` ns / period: there is no origin to agree on, so that processes come and
//! go and still count the same ticks. A loop that wakes late skips the periods that it missed and
//! counts them; it never bursts to catch up.

use crate::clock::{now_ns, sleep_until};

/// A grid of a period and a phase within it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    period_ns: u64,
    phase_ns: u64,
    next_tick: Option<u64>,
    missed: u64,
}

/// One wake of a grid loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wake {
    /// Tick of the grid.
    pub tick: u64,
    /// When the loop should have woken for this tick (ns).
    pub scheduled_ns: u64,
    /// When the first of the ticks that this wake stands for was due: earlier, if some are skipped
    /// (ns).
    pub due_ns: u64,
    /// When the loop woke (ns).
    pub woke_ns: u64,
    /// Periods skipped just now because it was late.
    pub skipped: u64,
}

impl Wake {
    /// How late it woke, skipped periods included (ns).
    pub fn late_ns(&self) -> u64 {
        self.woke_ns.saturating_sub(self.due_ns)
    }
}

impl Grid {
    /// A grid of `period_ns` whose loop wakes `phase_ns` after each tick. A zero period is taken as
    /// 1 ns, and the phase modulo the period.
    pub fn new(period_ns: u64, phase_ns: u64) -> Self {
        let period_ns = period_ns.max(1);
        Self { period_ns, phase_ns: phase_ns % period_ns, next_tick: None, missed: 0 }
    }

    /// The grid of a rate (Hz).
    pub fn of_rate(rate_hz: u32, phase_ns: u64) -> Self {
        Self::new(crate::clock::SECOND_NS / u64::from(rate_hz.max(1)), phase_ns)
    }

    /// Period (ns).
    pub fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// Phase (ns).
    pub fn phase_ns(&self) -> u64 {
        self.phase_ns
    }

    /// Periods skipped so far.
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// When the loop wakes for a tick (ns).
    pub fn wake_time(&self, tick: u64) -> u64 {
        tick * self.period_ns + self.phase_ns
    }

    /// The first wake not before `now_ns`; fixes the grid's position. Reads no clock.
    pub fn due(&mut self, now_ns: u64) -> u64 {
        let tick = *self.next_tick.get_or_insert_with(|| {
            let tick = now_ns / self.period_ns;
            if tick * self.period_ns + self.phase_ns < now_ns { tick + 1 } else { tick }
        });
        self.wake_time(tick)
    }

    /// Accounts for a wake at `woke_ns`: `None` if it is too early (a signal came). Reads
    /// no clock.
    pub fn wake(&mut self, woke_ns: u64) -> Option<Wake> {
        let due = self.due(woke_ns);
        let tick = self.next_tick.unwrap_or(due / self.period_ns);
        if woke_ns < due {
            return None;
        }
        // Late by whole periods: the newest tick that is due is run, those before it are skipped.
        let skipped = (woke_ns - due) / self.period_ns;
        self.missed += skipped;
        let tick = tick + skipped;
        self.next_tick = Some(tick + 1);
        Some(Wake { tick, scheduled_ns: self.wake_time(tick), due_ns: due, woke_ns, skipped })
    }

    /// Sleeps until the next wake. `None` when a signal cut the sleep short, so that the caller can
    /// look at its stop flag.
    pub fn wait(&mut self) -> Option<Wake> {
        sleep_until(self.due(now_ns()));
        self.wake(now_ns())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn two_loops_agree_on_ticks_without_an_origin() {
        let mut early = Grid::new(500_000, 80_000);
        let mut late = Grid::new(500_000, 80_000);
        assert_eq!(early.due(1_000_000_000), 1_000_080_000);
        assert_eq!(early.wake(1_000_090_000).unwrap().tick, 2000);
        assert_eq!(late.due(1_000_100_000), 1_000_580_000);
        assert_eq!(late.wake(1_000_580_000).unwrap().tick, early.wake(1_000_581_000).unwrap().tick);
    }

    #[test]
    fn a_late_wake_skips_and_counts_and_does_not_burst() {
        let mut grid = Grid::new(1000, 100);
        assert_eq!(grid.due(5000), 5100);
        assert_eq!(grid.wake(5099), None);
        assert_eq!(
            grid.wake(5100).unwrap(),
            Wake { tick: 5, scheduled_ns: 5100, due_ns: 5100, woke_ns: 5100, skipped: 0 }
        );
        // due at 6100, woken at 9200: 6, 7, 8 are skipped and 9 is run
        let wake = grid.wake(9200).unwrap();
        assert_eq!((wake.tick, wake.skipped, wake.late_ns()), (9, 3, 3100));
        assert_eq!(grid.missed(), 3);
        assert_eq!(grid.due(9200), 10_100);
    }

    proptest! {
        #[test]
        fn ticks_rise_and_every_tick_is_run_or_counted(
            steps in prop::collection::vec(0u64..5000, 1..200),
        ) {
            let mut grid = Grid::new(1000, 300);
            let mut now = 1_000_000;
            let mut first = None;
            let mut last = None;
            let mut run = 0;
            for step in steps {
                now += step;
                if let Some(wake) = grid.wake(now) {
                    prop_assert!(wake.scheduled_ns <= wake.woke_ns);
                    prop_assert!(wake.woke_ns - wake.scheduled_ns < 1000);
                    let late_ns = wake.woke_ns - wake.scheduled_ns + 1000 * wake.skipped;
                    prop_assert_eq!(wake.late_ns(), late_ns);
                    prop_assert!(last.is_none_or(|last| wake.tick > last));
                    first.get_or_insert(wake.tick - wake.skipped);
                    last = Some(wake.tick);
                    run += 1;
                }
            }
            if let (Some(first), Some(last)) = (first, last) {
                prop_assert_eq!(last - first + 1, run + grid.missed());
            }
        }
    }
}
