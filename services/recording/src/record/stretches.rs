//! The samples of a recording, one after the other, and the stretches of them that make a record:
//! with the same zeros, and of one pass of a record that was replayed.

use std::io;
use std::ops::Range;

use ipc_types::{CARD_FIFO, CardKind, Sample};

use super::{Finding, FindingKind, TIME};
use crate::column::{Column, Storage};

/// A channel of the samples that is wanted as a column.
pub(super) struct Channel {
    pub(super) name: String,
    pub(super) index: usize,
    pub(super) present: fn(&Sample, usize) -> bool,
    pub(super) read: fn(&Sample, usize) -> f64,
}

/// Whether the card may deliver a scan again to an acquisition that takes over.
const fn read_again(newest: u64, tick: u64) -> bool {
    tick < newest && newest - tick <= CARD_FIFO as u64
}

/// What was read of the samples: a row for each.
pub(super) struct Columns {
    pub(super) storage: Storage,
    /// Number of each sample in the file, from 1.
    pub(super) rows: Column,
    /// Ticks since the first sample of its stretch, or its time in a record that was replayed (s).
    pub(super) time: Column,
    pub(super) channels: Vec<(Channel, Column)>,
}

/// One pass through a record that was replayed; of other samples a whole stretch.
#[derive(Clone, Debug)]
pub(super) struct Pass {
    pub(super) rows: Range<usize>,
    /// Number of its first sample in the file.
    first_row: u64,
    /// Samples in which each channel is present.
    pub(super) present: Vec<usize>,
}

/// A stretch of samples whose positions count from the same zeros.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    rows: Range<usize>,
    first: Sample,
    last: Sample,
    first_row: u64,
    /// Whether the record's axes are homed in it.
    homed: bool,
    /// The pass that goes on, and the longest of those before it.
    pass: Pass,
    longest: Option<Pass>,
    passes: usize,
}

/// Takes samples one after the other.
pub(super) struct Samples {
    columns: Columns,
    /// The axes of the record, a bit each.
    axes: u8,
    /// Samples that were left out because they occur twice.
    pub(super) repeated: u64,
    first: Option<Sample>,
    last_row: u64,
    /// The stretch that goes on, and the best of those before it.
    stretch: Option<Stretch>,
    best: Option<Stretch>,
    stretches: usize,
}

impl Samples {
    pub(super) fn new(channels: Vec<Channel>, axes: u8, storage: &Storage) -> Self {
        let column = || Column::new(storage);
        let columns = Columns {
            storage: storage.clone(),
            rows: column(),
            time: column(),
            channels: channels.into_iter().map(|channel| (channel, column())).collect(),
        };
        Self {
            columns,
            axes,
            repeated: 0,
            first: None,
            last_row: 0,
            stretch: None,
            best: None,
            stretches: 0,
        }
    }

    /// The first sample.
    pub(super) const fn first(&self) -> Option<&Sample> {
        self.first.as_ref()
    }

    /// Samples that were taken, without repetitions.
    pub(super) fn len(&self) -> usize {
        self.columns.rows.len()
    }

    /// Number of the last of them in the file.
    pub(super) const fn last_row(&self) -> u64 {
        self.last_row
    }

    /// Takes a sample with its number in the file.
    ///
    /// # Errors
    /// Those of the storage.
    pub(super) fn take(&mut self, row: u64, sample: &Sample) -> io::Result<()> {
        let at = self.len();
        let zeros = |sample: &Sample| (sample.homing_sequence, sample.homed & self.axes);
        let last = self.stretch.as_ref().map(|stretch| stretch.last);
        // An acquisition that takes over reads again the scans that its predecessor had not
        // acknowledged to the card.
        if last.is_some_and(|last| {
            last.tick == sample.tick
                || last.incarnation != sample.incarnation && read_again(last.tick, sample.tick)
        }) {
            self.repeated += 1;
            return Ok(());
        }
        let channels = self.columns.channels.len();
        let pass = || Pass { rows: at..at, first_row: row, present: vec![0; channels] };
        let goes_on = last.is_some_and(|last| zeros(&last) == zeros(sample));
        match &mut self.stretch {
            Some(stretch) if goes_on => {
                if stretch.is_replayed() && sample.record_time_s < stretch.last.record_time_s {
                    stretch.next_pass(pass());
                }
            }
            _ => {
                let wanted = self.axes & ((1u8 << sample.axes.min(7)) - 1);
                let next = Stretch {
                    rows: at..at,
                    first: *sample,
                    last: *sample,
                    first_row: row,
                    homed: sample.homed & self.axes == wanted,
                    pass: pass(),
                    longest: None,
                    passes: 1,
                };
                self.close();
                self.stretch = Some(next);
                self.stretches += 1;
            }
        }
        self.first.get_or_insert(*sample);
        self.last_row = row;
        let Some(stretch) = &mut self.stretch else { return Ok(()) };
        stretch.last = *sample;
        stretch.rows.end = at + 1;
        stretch.pass.rows.end = at + 1;
        self.columns.time.push(stretch.time_of(sample))?;
        self.columns.rows.push(row as f64)?;
        let channels = self.columns.channels.iter_mut().zip(&mut stretch.pass.present);
        for ((Channel { index, present, read, .. }, values), there) in channels {
            values.push(read(sample, *index))?;
            *there += usize::from(present(sample, *index));
        }
        Ok(())
    }

    /// Keeps the stretch that goes on, where it is the best so far: the longest, among those with
    /// homed axes if there is one, the last of equal ones.
    fn close(&mut self) {
        let rank = |stretch: &Stretch| (stretch.homed, stretch.rows.len());
        let Some(ended) = self.stretch.take() else { return };
        if self.best.as_ref().is_none_or(|best| rank(&ended) >= rank(best)) {
            self.best = Some(ended);
        }
    }

    /// The stretch to keep, and what was read, of all; what is left out is a finding. `None`
    /// without samples.
    pub(super) fn finish(mut self, findings: &mut Vec<Finding>) -> Option<(Stretch, Columns)> {
        self.close();
        let all = self.len();
        let stretch = self.best?;
        let left_out = |kind, first_row, rows: usize, text| Finding {
            column: TIME.to_owned(),
            kind,
            first_row,
            rows: rows as u64,
            text,
        };
        let kept = stretch.rows.len();
        if self.stretches > 1 {
            let text = format!(
                "positions count from {} different zeros (homing): kept the longest stretch, \
                 {kept} samples",
                self.stretches
            );
            findings.push(left_out(FindingKind::Rezeroed, stretch.first_row, all - kept, text));
        }
        if stretch.passes > 1 {
            let pass = stretch.pass();
            let text = format!(
                "the record was replayed {} times: kept the longest pass, {} samples",
                stretch.passes,
                pass.rows.len()
            );
            let rows = kept - pass.rows.len();
            findings.push(left_out(FindingKind::Looped, pass.first_row, rows, text));
        }
        Some((stretch, self.columns))
    }
}

impl Stretch {
    /// Whether its samples are those of a record.
    pub(super) fn is_replayed(&self) -> bool {
        self.first.backend == CardKind::Replay.code()
    }

    /// The longest pass, the first of equal ones.
    pub(super) fn pass(&self) -> &Pass {
        let longest = self.longest.as_ref();
        longest.filter(|longest| longest.rows.len() >= self.pass.rows.len()).unwrap_or(&self.pass)
    }

    fn next_pass(&mut self, next: Pass) {
        let ended = std::mem::replace(&mut self.pass, next);
        self.passes += 1;
        if self.longest.as_ref().is_none_or(|longest| ended.rows.len() > longest.rows.len()) {
            self.longest = Some(ended);
        }
    }

    fn time_of(&self, sample: &Sample) -> f64 {
        if self.is_replayed() {
            return sample.record_time_s;
        }
        match sample.tick.checked_sub(self.first.tick) {
            Some(ticks) => ticks as f64,
            None => -((self.first.tick - sample.tick) as f64),
        }
    }

    /// The grid's period (s). Ticks are multiples of it, and its rate is a whole number of Hz, so
    /// that the mean over the stretch, rounded, is exact.
    pub(super) fn period_s(&self) -> Option<f64> {
        let Self { first, last, .. } = self;
        let ticks = last.tick.checked_sub(first.tick).filter(|&ticks| ticks > 0)?;
        let span_ns = last.scan_time_ns.checked_sub(first.scan_time_ns).filter(|&span| span > 0)?;
        let hz = (ticks as f64 / (span_ns as f64 * 1e-9)).round();
        (hz >= 1.0).then(|| 1.0 / hz)
    }
}
