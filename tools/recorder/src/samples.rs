//! The samples of a stretch of a recording, in columns.

use std::ops::Range;

use ipc_types::{SAMPLE, Sample};
use recording::mcap_read::Recording;
use rig::RigFile;

use crate::signals::{Signal, rig_file, signals};

/// The samples of a stretch: a column for each signal.
pub(crate) struct Samples {
    pub(crate) rig: RigFile,
    pub(crate) signals: Vec<Signal>,
    /// Places of the samples on the grid of acquisition; they rise.
    pub(crate) ticks: Vec<u64>,
    pub(crate) times_ns: Vec<u64>,
    pub(crate) columns: Vec<Vec<f64>>,
    /// Whether a sample after the stretch is there, and so all of its own that there will be.
    pub(crate) beyond: bool,
}

impl Samples {
    /// Those that were taken in `times` (ns, CLOCK_MONOTONIC).
    ///
    /// # Errors
    /// Where the recording has no samples or no rig file, or cannot be read.
    pub(crate) fn read(recording: &Recording, times: Range<u64>) -> anyhow::Result<Self> {
        let rig = rig_file(recording)?;
        let signals = signals(&rig);
        let mut samples = Self {
            columns: vec![Vec::new(); signals.len()],
            rig,
            signals,
            ticks: Vec::new(),
            times_ns: Vec::new(),
            beyond: false,
        };
        for message in recording.messages::<Sample>(SAMPLE.topic.name)? {
            let sample = message?.message;
            samples.beyond |= sample.scan_time_ns >= times.end;
            // A merged recording may hold a sample twice.
            let repeated = samples.times_ns.last().is_some_and(|last| sample.scan_time_ns <= *last)
                || samples.ticks.last().is_some_and(|last| sample.tick <= *last);
            if !repeated && times.contains(&sample.scan_time_ns) {
                samples.push(&sample);
            }
        }
        Ok(samples)
    }

    fn push(&mut self, sample: &Sample) {
        self.ticks.push(sample.tick);
        self.times_ns.push(sample.scan_time_ns);
        for (column, signal) in self.columns.iter_mut().zip(&self.signals) {
            column.push(signal.value(sample));
        }
    }
}
