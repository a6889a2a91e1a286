//! How punctual a loop was: histograms of wake lateness and execution time, and the message of them.

use hdrhistogram::Histogram;
use ipc_types::{LoopTiming, Process};

use crate::clock::SECOND_NS;
use crate::grid::{Grid, Wake};
use crate::realtime::Grants;

/// Lowest value that the histograms tell apart (ns).
const LOWEST_NS: u64 = 100;
/// Highest value; longer ones are counted as this (ns).
const HIGHEST_NS: u64 = 10 * SECOND_NS;

/// p50, p99, p99.9 and max of a histogram.
fn percentiles(histogram: &Histogram<u64>) -> [u64; 4] {
    if histogram.is_empty() {
        return [0; 4];
    }
    [
        histogram.value_at_quantile(0.5),
        histogram.value_at_quantile(0.99),
        histogram.value_at_quantile(0.999),
        histogram.max(),
    ]
}

/// Collects the timing of one loop. Allocates only when made.
#[derive(Debug)]
pub struct LoopMeter {
    process: Process,
    grants: Grants,
    pid: u32,
    cycles: u64,
    published_at_ns: u64,
    wake: [Histogram<u64>; 2],
    execution: [Histogram<u64>; 2],
}

impl LoopMeter {
    /// A meter for a process. Errors only if the histogram's bounds were refused, which these are not.
    pub fn new(process: Process, grants: Grants) -> Result<Self, hdrhistogram::CreationError> {
        let histogram = || Histogram::new_with_bounds(LOWEST_NS, HIGHEST_NS, 2);
        Ok(Self {
            process,
            grants,
            pid: std::process::id(),
            cycles: 0,
            published_at_ns: 0,
            wake: [histogram()?, histogram()?],
            execution: [histogram()?, histogram()?],
        })
    }

    /// Cycles run since start.
    pub fn cycles(&self) -> u64 {
        self.cycles
    }

    /// Records one cycle that ended at `end_ns`.
    pub fn record(&mut self, wake: &Wake, end_ns: u64) {
        self.cycles += 1;
        for histogram in &mut self.wake {
            histogram.saturating_record(wake.late_ns());
        }
        for histogram in &mut self.execution {
            histogram.saturating_record(end_ns.saturating_sub(wake.woke_ns));
        }
    }

    /// The message, once a second; `None` in between. Begins a new interval.
    pub fn due(&mut self, grid: &Grid, now_ns: u64) -> Option<LoopTiming> {
        if self.published_at_ns == 0 {
            self.published_at_ns = now_ns;
        }
        if now_ns < self.published_at_ns + SECOND_NS {
            return None;
        }
        self.published_at_ns = now_ns;
        let message = LoopTiming {
            period_ns: grid.period_ns(),
            phase_ns: grid.phase_ns(),
            cycles: self.cycles,
            missed_periods: grid.missed(),
            wake_late_ns: percentiles(&self.wake[0]),
            execution_ns: percentiles(&self.execution[0]),
            total_wake_late_ns: percentiles(&self.wake[1]),
            total_execution_ns: percentiles(&self.execution[1]),
            pid: self.pid,
            source: self.process.code(),
            profile: self.grants.profile.code(),
            memory_locked: u8::from(self.grants.memory_locked),
            kept_awake: u8::from(self.grants.kept_awake),
            ..LoopTiming::default()
        };
        self.wake[0].reset();
        self.execution[0].reset();
        Some(message)
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::Profile;

    use super::*;

    #[test]
    fn interval_is_reset_and_total_is_not() {
        let mut grid = Grid::new(1_000_000, 0);
        let grants = Grants { profile: Profile::Realtime, memory_locked: false, kept_awake: true };
        let mut meter = LoopMeter::new(Process::Control, grants).unwrap();
        let mut now = SECOND_NS;
        let mut messages = Vec::new();
        for cycle in 0..2100u64 {
            now = grid.due(now) + if cycle == 10 { 50_000 } else { 1_000 };
            let wake = grid.wake(now).unwrap();
            meter.record(&wake, now + 20_000);
            messages.extend(meter.due(&grid, now));
        }
        assert_eq!(messages.len(), 2);
        assert!(messages[0].wake_late_ns[3].abs_diff(50_000) < 1_000, "{:?}", messages[0]);
        assert!(messages[1].wake_late_ns[3].abs_diff(1_000) < 50);
        assert!(messages[1].total_wake_late_ns[3].abs_diff(50_000) < 1_000);
        assert!(messages[1].execution_ns[0].abs_diff(20_000) < 400);
        assert_eq!(messages[1].missed_periods, 0);
    }
}
