//! Histogram of how late a loop wakes on this machine, at the priority of a rig's loops.

use std::time::Duration;

use hdrhistogram::{CreationError, Histogram};
use ipc_types::Process;
use serde::{Deserialize, Serialize};

use crate::bare_loop::on_every_processor;
use crate::grid::Wake;
use crate::realtime::loop_priority;
use crate::timing::{new_histogram, percentiles};

/// Upper ends of the bins (µs); what is later is counted in a last bin without an end.
pub const BIN_ENDS_US: [u64; 12] = [5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 50_000];

/// Wake lateness of bare 1 kHz loops, one on each processor at a time, at acquisition's priority.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct WakeLateness {
    /// Median (ns).
    pub p50_ns: u64,
    /// 99th percentile (ns).
    pub p99_ns: u64,
    /// 99.9th percentile (ns).
    pub p99_9_ns: u64,
    /// Latest wake (ns).
    pub longest_ns: u64,
    /// Wakes measured.
    pub wakes: u64,
    /// Periods skipped because a wake was late by more than one.
    pub skipped: u64,
    /// Processors measured.
    pub processors: u32,
    /// Whether the loops ran in `SCHED_FIFO`.
    pub fifo: bool,
    /// Wakes in each bin, whose upper ends are [`BIN_ENDS_US`]; the last is of those beyond.
    pub bins: Vec<u64>,
}

/// What one loop records.
struct Recorded {
    late: Histogram<u64>,
    skipped: u64,
}

impl WakeLateness {
    /// Measures for `duration` on every processor that this process may run on.
    ///
    /// # Errors
    /// If a histogram cannot be made.
    pub fn measure(duration: Duration) -> Result<Self, CreationError> {
        let empty = new_histogram()?;
        let new = || Recorded { late: empty.clone(), skipped: 0 };
        let record = |recorded: &mut Recorded, wake: &Wake| {
            recorded.late.saturating_record(wake.late_ns());
            recorded.skipped += wake.skipped;
        };
        let loops = on_every_processor(duration, loop_priority(Process::Acquisition), new, record);
        let mut all = empty.clone();
        let mut found = Self { fifo: !loops.is_empty(), ..Self::default() };
        for (recorded, fifo) in &loops {
            // Both have the same bounds, so that nothing is out of range.
            let _added = all.add(&recorded.late);
            found.skipped += recorded.skipped;
            found.processors += 1;
            found.fifo &= fifo;
        }
        [found.p50_ns, found.p99_ns, found.p99_9_ns, found.longest_ns] = percentiles(&all);
        found.wakes = all.len();
        found.bins = bins(&all);
        Ok(found)
    }
}

fn bins(histogram: &Histogram<u64>) -> Vec<u64> {
    let mut counts = vec![0; BIN_ENDS_US.len() + 1];
    for recorded in histogram.iter_recorded() {
        let late_us = recorded.value_iterated_to() / 1000;
        let bin = BIN_ENDS_US.iter().position(|end| late_us < *end).unwrap_or(BIN_ENDS_US.len());
        counts[bin] += recorded.count_at_value();
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_wake_is_in_one_bin() {
        let mut histogram = new_histogram().unwrap();
        for late_ns in [0, 4_900, 5_100, 60_000, 60_100, 49_000_000, 60_000_000] {
            histogram.record(late_ns).unwrap();
        }
        let counts = bins(&histogram);
        assert_eq!(counts, [2, 1, 0, 0, 2, 0, 0, 0, 0, 0, 0, 1, 1]);
    }

    #[test]
    fn a_short_measurement_has_ordered_percentiles() {
        let found = WakeLateness::measure(Duration::from_millis(50)).unwrap();
        assert!(found.processors >= 1 && found.wakes >= 1, "{found:?}");
        assert_eq!(found.bins.iter().sum::<u64>(), found.wakes);
        let WakeLateness { p50_ns, p99_ns, p99_9_ns, longest_ns, .. } = found;
        assert!(p50_ns <= p99_ns && p99_ns <= p99_9_ns && p99_9_ns <= longest_ns);
    }
}
