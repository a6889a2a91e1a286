//! How punctual a loop was: histograms of wake lateness and execution time; what its process
//! missed; and the message of both.

use std::fmt;

use hdrhistogram::Histogram;
use ipc_types::{LoopTiming, Process};
use serde::Serialize;

use crate::clock::SECOND_NS;
use crate::grid::{Grid, Wake};
use crate::ports::Counters;
use crate::realtime::Grants;

/// Lowest value that the histograms tell apart (ns).
const LOWEST_NS: u64 = 100;
/// Highest value; longer ones are counted as this (ns).
const HIGHEST_NS: u64 = 10 * SECOND_NS;

/// An empty histogram of durations (ns).
pub(crate) fn new_histogram() -> Result<Histogram<u64>, hdrhistogram::CreationError> {
    Histogram::new_with_bounds(LOWEST_NS, HIGHEST_NS, 2)
}

/// p50, p99, p99.9 and max of a histogram.
pub(crate) fn percentiles(histogram: &Histogram<u64>) -> [u64; 4] {
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

/// What a process missed, or could not hand on, since it started.
///
/// ```
/// use runtime::{Counters, Losses};
/// let (samples, tokens) = (Counters { lost: 2, ..Counters::default() }, Counters::default());
/// let losses = Losses::default().received(samples).received(tokens).sent(1);
/// assert_eq!((losses.lost, losses.undelivered), (2, 1));
/// assert_eq!(losses.to_string(), "2 messages lost on the way to it, 1 of its own not delivered");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Losses {
    /// Messages of other processes that are missing in their sequence.
    pub lost: u64,
    /// Messages of other processes whose sequence repeated or went backwards.
    pub out_of_turn: u64,
    /// Senders that died while they were being connected.
    pub connections_failed: u64,
    /// Own messages that a subscriber did not get.
    pub undelivered: u64,
    /// What found a queue between the process's own threads full.
    pub dropped: u64,
    /// Setpoints that were not followed.
    pub refused: u64,
}

impl Losses {
    /// Those that a process told.
    pub fn told_by(timing: &LoopTiming) -> Self {
        let &LoopTiming {
            lost,
            out_of_turn,
            connections_failed,
            undelivered,
            dropped,
            refused,
            ..
        } = timing;
        Self { lost, out_of_turn, connections_failed, undelivered, dropped, refused }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// With what a subscriber saw.
    #[must_use]
    pub fn received(self, counters: Counters) -> Self {
        Self {
            lost: self.lost + counters.lost,
            out_of_turn: self.out_of_turn + counters.backwards,
            connections_failed: self.connections_failed + counters.connections_failed,
            ..self
        }
    }

    /// With what a publisher could not deliver ([`crate::Publisher::undelivered`]).
    #[must_use]
    pub fn sent(self, undelivered: u64) -> Self {
        Self { undelivered: self.undelivered + undelivered, ..self }
    }

    /// The message with them in it.
    #[must_use]
    pub fn told_in(self, timing: LoopTiming) -> LoopTiming {
        let Self { lost, out_of_turn, connections_failed, undelivered, dropped, refused } = self;
        LoopTiming {
            lost,
            out_of_turn,
            connections_failed,
            undelivered,
            dropped,
            refused,
            ..timing
        }
    }
}

impl fmt::Display for Losses {
    /// Those that there are.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = [
            (self.lost, "messages lost on the way to it"),
            (self.out_of_turn, "out of turn"),
            (self.connections_failed, "senders dead while being connected"),
            (self.undelivered, "of its own not delivered"),
            (self.dropped, "dropped at a full queue of its own"),
            (self.refused, "setpoints refused"),
        ];
        let mut said = all.into_iter().filter(|(count, _)| *count > 0);
        match said.next() {
            Some((count, what)) => write!(f, "{count} {what}")?,
            None => f.write_str("nothing lost")?,
        }
        said.try_for_each(|(count, what)| write!(f, ", {count} {what}"))
    }
}

/// Collects the timing of one loop. Allocates only when made.
#[derive(Debug)]
pub(crate) struct LoopMeter {
    process: Process,
    grants: Grants,
    pid: u32,
    cycles: u64,
    published_at_ns: u64,
    wake: [Histogram<u64>; 2],
    execution: [Histogram<u64>; 2],
}

impl LoopMeter {
    /// A meter for a process. Errors only if the histogram's bounds were refused, which these are
    /// not.
    pub(crate) fn new(
        process: Process,
        grants: Grants,
    ) -> Result<Self, hdrhistogram::CreationError> {
        Ok(Self {
            process,
            grants,
            pid: std::process::id(),
            cycles: 0,
            published_at_ns: 0,
            wake: [new_histogram()?, new_histogram()?],
            execution: [new_histogram()?, new_histogram()?],
        })
    }

    /// Records one cycle that ended at `end_ns`.
    pub(crate) fn record(&mut self, wake: &Wake, end_ns: u64) {
        self.cycles += 1;
        for histogram in &mut self.wake {
            histogram.saturating_record(wake.late_ns());
        }
        for histogram in &mut self.execution {
            histogram.saturating_record(end_ns.saturating_sub(wake.woke_ns));
        }
    }

    /// The message, once a second; `None` in between. Begins a new interval.
    pub(crate) fn due(&mut self, grid: &Grid, now_ns: u64) -> Option<LoopTiming> {
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
    fn losses_pass_through_the_message() {
        let saw = Counters { received: 9, lost: 1, backwards: 2, connections_failed: 3 };
        let losses = Losses::default().received(saw).received(saw).sent(4);
        let losses = Losses { dropped: 5, refused: 6, ..losses };
        assert_eq!(Losses::told_by(&losses.told_in(LoopTiming::default())), losses);
        assert_eq!(
            [losses.lost, losses.out_of_turn, losses.connections_failed, losses.undelivered],
            [2, 4, 6, 4]
        );
        let all = "2 messages lost on the way to it, 4 out of turn, 6 senders dead while being \
                   connected, 4 of its own not delivered, 5 dropped at a full queue of its own, \
                   6 setpoints refused";
        assert_eq!(losses.to_string(), all);
        assert!(Losses::default().is_empty() && !losses.is_empty());
        assert_eq!(Losses::default().to_string(), "nothing lost");
    }

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
