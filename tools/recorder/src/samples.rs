//! The samples of a stretch of a recording, in columns.

use std::ops::Range;

use ipc_types::{CardKind, SAMPLE, Sample};
use recording::mcap_read::Recording;
use rig::RigFile;

use crate::signals::{Signal, Source, rig_file, signals};

/// The measurements of an axis; NaN where a sample does not have one.
#[derive(Clone, Copy, Debug)]
pub struct AxisColumns<'a> {
    /// Position of the motor (rad or m).
    pub master: &'a [f64],
    /// Position of the handle (rad or m); `None` where the rig does not measure it.
    pub slave: Option<&'a [f64]>,
    /// Torque or force of the hand on the handle (N·m or N); `None` where the rig does not measure
    /// it.
    pub torque: Option<&'a [f64]>,
    /// Volts at the motor.
    pub motor_v: &'a [f64],
}

/// The samples of a stretch: a column for each signal.
#[derive(Debug)]
pub struct Samples {
    /// The rig file of the recording.
    pub rig: RigFile,
    pub(crate) signals: Vec<Signal>,
    /// Places of the samples on the grid of acquisition; they rise.
    pub ticks: Vec<u64>,
    /// When each was taken (ns, CLOCK_MONOTONIC).
    pub times_ns: Vec<u64>,
    pub(crate) columns: Vec<Vec<f64>>,
    /// Whether the card was simulated.
    pub simulated: bool,
    /// Whether a sample after the stretch is there, and so all of its own that there will be.
    pub(crate) beyond: bool,
    /// Samples that are missing before the first one of the stretch, since the one before it, and
    /// after the last one: they may belong to the stretch.
    pub(crate) missing_around: u64,
}

impl Samples {
    /// Those that were taken in `times` (ns, CLOCK_MONOTONIC).
    ///
    /// # Errors
    /// Where the recording has no samples or no rig file, or cannot be read.
    pub fn read(recording: &Recording, times: Range<u64>) -> anyhow::Result<Self> {
        let rig = rig_file(recording)?;
        let signals = signals(&rig);
        let mut samples = Self {
            columns: vec![Vec::new(); signals.len()],
            rig,
            signals,
            ticks: Vec::new(),
            times_ns: Vec::new(),
            simulated: false,
            beyond: false,
            missing_around: 0,
        };
        let mut before: Option<u64> = None;
        for message in recording.messages::<Sample>(SAMPLE.topic.name)? {
            let sample = message?.message;
            if sample.scan_time_ns < times.start {
                before = Some(sample.tick);
            }
            if sample.scan_time_ns >= times.end && !samples.beyond {
                samples.beyond = true;
                samples.missing_around += missing_between(samples.ticks.last(), sample.tick);
            }
            // A merged recording may hold a sample twice.
            let repeated = samples.times_ns.last().is_some_and(|last| sample.scan_time_ns <= *last)
                || samples.ticks.last().is_some_and(|last| sample.tick <= *last);
            if !repeated && times.contains(&sample.scan_time_ns) {
                if samples.ticks.is_empty() {
                    samples.missing_around += missing_between(before.as_ref(), sample.tick);
                }
                samples.push(&sample);
            }
        }
        Ok(samples)
    }

    /// The longest gap between two samples, in ticks.
    pub(crate) fn longest_gap(&self) -> u64 {
        self.ticks.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(0)
    }

    /// The measurements of an axis; `None` where the rig has no such axis.
    pub fn of_axis(&self, axis: usize) -> Option<AxisColumns<'_>> {
        let column = |source: Source| {
            let at = self.signals.iter().position(|signal| signal.source == source)?;
            self.columns.get(at).map(Vec::as_slice)
        };
        Some(AxisColumns {
            master: column(Source::Master(axis))?,
            slave: column(Source::Slave(axis)),
            torque: column(Source::Torque(axis)),
            motor_v: column(Source::MotorVolts(axis))?,
        })
    }

    fn push(&mut self, sample: &Sample) {
        self.simulated |= sample.backend == CardKind::Simulated.code();
        self.ticks.push(sample.tick);
        self.times_ns.push(sample.scan_time_ns);
        for (column, signal) in self.columns.iter_mut().zip(&self.signals) {
            column.push(signal.value(sample));
        }
    }
}

/// Ticks between one sample and the next.
fn missing_between(before: Option<&u64>, next: u64) -> u64 {
    before.map_or(0, |before| next.saturating_sub(*before).saturating_sub(1))
}

/// For each row of an even table from the first tick to the last the index of its sample; `None`
/// where it is missing.
pub fn rows_of(ticks: &[u64]) -> impl Iterator<Item = Option<usize>> {
    let ends = ticks.first().zip(ticks.last());
    let rows = ends.map(|(first, last)| *first..=*last);
    let mut next = 0;
    rows.into_iter().flatten().map(move |tick| {
        let found = ticks.get(next) == Some(&tick);
        next += usize::from(found);
        found.then(|| next - 1)
    })
}
