//! The samples of a stretch of a recording, in columns.

use std::io;
use std::ops::Range;

use ipc_types::{CardKind, SAMPLE, Sample};
use recording::column::{Column, Storage};
use recording::mcap_read::{Recorded, Recording};
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

/// The samples of a stretch in memory: a column for each signal.
#[derive(Debug)]
pub struct Samples {
    /// The rig file of the recording.
    pub rig: RigFile,
    signals: Vec<Signal>,
    /// Places of the samples on the grid of acquisition; they rise.
    pub ticks: Vec<u64>,
    /// When each was taken (ns, CLOCK_MONOTONIC).
    pub times_ns: Vec<u64>,
    columns: Vec<Vec<f64>>,
    /// Whether the card was simulated.
    pub simulated: bool,
}

impl Samples {
    /// Those that were taken in `times` (ns, CLOCK_MONOTONIC).
    ///
    /// # Errors
    /// Where the recording has no samples or no rig file, or cannot be read.
    pub fn read(recording: &Recording, times: Range<u64>) -> anyhow::Result<Self> {
        let read = StoredSamples::read(recording, times, &Storage::Memory)?;
        let since = |first: u64, column: Column| -> io::Result<Vec<u64>> {
            let rows = column.into_vec()?.into_iter();
            Ok(rows.map(|since| first + since as u64).collect())
        };
        Ok(Self {
            rig: read.rig,
            signals: read.signals,
            ticks: since(read.first.tick, read.ticks)?,
            times_ns: since(read.first.at_ns, read.times)?,
            columns: read.columns.into_iter().map(Column::into_vec).collect::<io::Result<_>>()?,
            simulated: read.simulated,
        })
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
}

/// Place of a sample on the grid of acquisition, and when it was taken (ns, CLOCK_MONOTONIC).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Instant {
    pub(crate) tick: u64,
    pub(crate) at_ns: u64,
}

/// The samples of a stretch, which may be longer than the memory: a column for each signal.
#[derive(Debug)]
pub(crate) struct StoredSamples {
    /// The rig file of the recording.
    pub(crate) rig: RigFile,
    pub(crate) signals: Vec<Signal>,
    /// The first sample and the last one; zeros where there is none.
    pub(crate) first: Instant,
    pub(crate) last: Instant,
    /// Ticks since the first one; they rise.
    pub(crate) ticks: Column,
    /// When each sample was taken, since the first one (ns).
    pub(crate) times: Column,
    pub(crate) columns: Vec<Column>,
    /// Whether the card was simulated.
    pub(crate) simulated: bool,
    /// Whether a sample after the stretch is there, and so all of its own that there will be.
    pub(crate) beyond: bool,
    /// Samples that are missing before the first one of the stretch, since the one before it, and
    /// after the last one: they may belong to the stretch.
    pub(crate) missing_around: u64,
    /// The longest gap between two samples, in ticks.
    pub(crate) longest_gap: u64,
}

impl StoredSamples {
    /// Those that were taken in `times` (ns, CLOCK_MONOTONIC).
    ///
    /// # Errors
    /// Where the recording has no samples or no rig file, or cannot be read, and those of the
    /// storage.
    pub(crate) fn read(
        recording: &Recording,
        times: Range<u64>,
        storage: &Storage,
    ) -> anyhow::Result<Self> {
        let mut read = Self::empty(recording, storage)?;
        let mut before = None;
        recording.each(SAMPLE.topic.name, |found: Recorded<Sample>| {
            read.take(&found.message, &times, &mut before)
        })?;
        Ok(read)
    }

    /// As [`Self::read`], of several stretches in one pass through the recording.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub(crate) fn read_each(
        recording: &Recording,
        stretches: Vec<Range<u64>>,
        storage: &Storage,
    ) -> anyhow::Result<Vec<Self>> {
        let mut all = Vec::with_capacity(stretches.len());
        for times in stretches {
            all.push((Self::empty(recording, storage)?, times, None));
        }
        recording.each(SAMPLE.topic.name, |found: Recorded<Sample>| {
            let mut readings = all.iter_mut();
            readings.try_for_each(|(read, times, before)| read.take(&found.message, times, before))
        })?;
        Ok(all.into_iter().map(|(read, ..)| read).collect())
    }

    fn empty(recording: &Recording, storage: &Storage) -> anyhow::Result<Self> {
        let rig = rig_file(recording)?;
        let signals = signals(&rig);
        Ok(Self {
            columns: signals.iter().map(|_| Column::new(storage)).collect(),
            rig,
            signals,
            first: Instant::default(),
            last: Instant::default(),
            ticks: Column::new(storage),
            times: Column::new(storage),
            simulated: false,
            beyond: false,
            missing_around: 0,
            longest_gap: 0,
        })
    }

    /// Takes the next sample of the recording, where it belongs to the stretch; `before` is the
    /// tick of the last one before it.
    fn take(
        &mut self,
        sample: &Sample,
        times: &Range<u64>,
        before: &mut Option<u64>,
    ) -> anyhow::Result<()> {
        let newest = self.newest();
        if sample.scan_time_ns < times.start {
            *before = Some(sample.tick);
        }
        if sample.scan_time_ns >= times.end && !self.beyond {
            self.beyond = true;
            let last = newest.map(|newest| newest.tick);
            self.missing_around += missing_between(last, sample.tick);
        }
        // A merged recording may hold a sample twice.
        let repeated = newest.is_some_and(|newest| {
            sample.scan_time_ns <= newest.at_ns || sample.tick <= newest.tick
        });
        if repeated || !times.contains(&sample.scan_time_ns) {
            return Ok(());
        }
        if newest.is_none() {
            self.missing_around += missing_between(*before, sample.tick);
        }
        self.push(sample)
    }

    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.ticks.len()
    }

    fn newest(&self) -> Option<Instant> {
        (!self.ticks.is_empty()).then_some(self.last)
    }

    fn push(&mut self, sample: &Sample) -> anyhow::Result<()> {
        let taken = Instant { tick: sample.tick, at_ns: sample.scan_time_ns };
        match self.newest() {
            Some(newest) => self.longest_gap = self.longest_gap.max(taken.tick - newest.tick),
            None => self.first = taken,
        }
        self.last = taken;
        self.simulated |= sample.backend == CardKind::Simulated.code();
        self.ticks.push((taken.tick - self.first.tick) as f64)?;
        self.times.push((taken.at_ns - self.first.at_ns) as f64)?;
        for (column, signal) in self.columns.iter_mut().zip(&self.signals) {
            column.push(signal.value(sample))?;
        }
        Ok(())
    }

    /// The first sample that was taken at this time or later (ns, CLOCK_MONOTONIC); their number
    /// where there is none.
    pub(crate) fn first_at(&self, at_ns: u64) -> io::Result<usize> {
        let mut times = self.times.cursor();
        let (mut low, mut high) = (0, self.len());
        while low < high {
            let middle = low.midpoint(high);
            if self.first.at_ns + (times.at(middle)? as u64) < at_ns {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        Ok(low)
    }

    /// Goes through an even table from the first tick to the last: `row` gets the number of each
    /// and the index of its sample; `None` where it is missing.
    ///
    /// # Errors
    /// Those of the storage and of `row`.
    pub(crate) fn rows(
        &self,
        mut row: impl FnMut(u64, Option<usize>) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let mut ticks = self.ticks.cursor();
        let mut number = 0;
        for index in 0..self.len() {
            let tick = ticks.at(index)? as u64;
            while number < tick {
                row(number, None)?;
                number += 1;
            }
            row(number, Some(index))?;
            number += 1;
        }
        Ok(())
    }
}

/// Ticks between one sample and the next.
fn missing_between(before: Option<u64>, next: u64) -> u64 {
    before.map_or(0, |before| next.saturating_sub(before).saturating_sub(1))
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
