//! Signals for the live plots: of every 20 ms the least and the largest value (of innovations: of
//! every 250 ms), so that a narrow peak is seen and fast signals are not aliased.

use ipc_types::{AXES, Innovation, Sample};
use recorder::Signal;
use serde::Serialize;

/// Bins a second.
const RATE: u32 = 50;
/// Bins of a batch: ten batches a second.
const BINS: usize = 5;
/// Rows of innovations in a bin: a quarter of a second.
const ROWS: u32 = 62;
/// Bins of a batch of innovations.
const ROW_BINS: usize = 2;

/// A batch of bins.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Batch {
    /// Middle of each bin (s), since the console's first sample.
    pub(crate) t_s: Vec<f64>,
    /// Of each signal the least value of each bin; `null` where the sample does not have it.
    pub(crate) least: Vec<Vec<Option<f32>>>,
    /// Of each signal the largest.
    pub(crate) largest: Vec<Vec<Option<f32>>>,
}

impl Batch {
    fn empty(count: usize, bins: usize) -> Self {
        let none = || vec![Vec::with_capacity(bins); count];
        Self { t_s: Vec::with_capacity(bins), least: none(), largest: none() }
    }
}

/// Gathers values into batches of bins.
struct Binner {
    /// Values in one bin.
    bin: u32,
    /// Bins of a batch.
    bins: usize,
    /// Time of the first value (ns).
    origin_ns: Option<u64>,
    bin_began_ns: u64,
    in_bin: u32,
    least: Vec<f32>,
    largest: Vec<f32>,
    batch: Batch,
}

impl Binner {
    /// For `count` signals; bins of `bin` values, batches of `bins`.
    fn new(count: usize, bin: u32, bins: usize) -> Self {
        Self {
            bin: bin.max(1),
            bins,
            origin_ns: None,
            bin_began_ns: 0,
            in_bin: 0,
            least: vec![f32::NAN; count],
            largest: vec![f32::NAN; count],
            batch: Batch::empty(count, bins),
        }
    }

    /// Adds the signals' values at a time; a batch when one is full.
    fn take(&mut self, time_ns: u64, values: impl IntoIterator<Item = f64>) -> Option<Batch> {
        if self.in_bin == 0 {
            self.bin_began_ns = time_ns;
            self.least.fill(f32::NAN);
            self.largest.fill(f32::NAN);
        }
        for ((value, least), largest) in
            values.into_iter().zip(&mut self.least).zip(&mut self.largest)
        {
            // Of a number and NaN both give the number.
            let value = value as f32;
            (*least, *largest) = (least.min(value), largest.max(value));
        }
        self.in_bin += 1;
        if self.in_bin < self.bin {
            return None;
        }
        self.in_bin = 0;
        let origin_ns = *self.origin_ns.get_or_insert(self.bin_began_ns);
        let middle_ns = (self.bin_began_ns + time_ns) / 2;
        self.batch.t_s.push(middle_ns.saturating_sub(origin_ns) as f64 * 1e-9);
        let value = |value: f32| value.is_finite().then_some(value);
        let count = self.least.len();
        for at in 0..count {
            self.batch.least[at].push(value(self.least[at]));
            self.batch.largest[at].push(value(self.largest[at]));
        }
        (self.batch.t_s.len() == self.bins)
            .then(|| std::mem::replace(&mut self.batch, Batch::empty(count, self.bins)))
    }
}

/// Gathers samples into batches.
pub(crate) struct Plotter {
    signals: Vec<Signal>,
    binner: Binner,
}

impl Plotter {
    /// For signals of samples that come at this rate (Hz).
    pub(crate) fn new(signals: Vec<Signal>, rate_hz: u32) -> Self {
        let binner = Binner::new(signals.len(), rate_hz / RATE, BINS);
        Self { signals, binner }
    }

    /// Adds a sample; a batch when one is full.
    pub(crate) fn take(&mut self, sample: &Sample) -> Option<Batch> {
        let values = self.signals.iter().map(|signal| signal.value(sample));
        self.binner.take(sample.scan_time_ns, values)
    }
}

/// Gathers innovations into batches: of master and slave (°), two bins each half second.
pub(crate) struct InnovationPlotter {
    axes: [Binner; AXES],
    rate_hz: u32,
}

impl InnovationPlotter {
    /// For samples that come at this rate (Hz).
    pub(crate) fn new(rate_hz: u32) -> Self {
        Self { axes: std::array::from_fn(|_| Binner::new(2, ROWS, ROW_BINS)), rate_hz }
    }

    /// Adds a row; a batch when one of its axis is full.
    pub(crate) fn take(&mut self, row: &Innovation) -> Option<Batch> {
        let time_ns = row.tick.saturating_mul(1_000_000_000) / u64::from(self.rate_hz.max(1));
        let slave = if row.slave_present == 0 { f64::NAN } else { row.slave };
        let values = [row.master, slave].map(f64::to_degrees);
        self.axes.get_mut(usize::from(row.axis))?.take(time_ns, values)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use std::path::Path;

    use super::*;

    #[test]
    fn a_peak_of_one_sample_is_in_the_batch_and_absent_values_are_none() {
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let signals = recorder::signals(&rig);
        let master = signals.iter().position(|signal| signal.name.ends_with("_master")).unwrap();
        let slave = signals.iter().position(|signal| signal.name.ends_with("_slave")).unwrap();
        let mut plotter = Plotter::new(signals, 2000);
        let mut batches = Vec::new();
        for tick in 0..400_u64 {
            let mut sample =
                Sample { tick, scan_time_ns: 1000 + tick * 500_000, ..Sample::default() };
            sample.master_present = 1;
            sample.master_position[0] = if tick == 123 { 1.5 } else { 0.25 };
            batches.extend(plotter.take(&sample));
        }
        let [first, second] = batches.as_slice() else { panic!("{} batches", batches.len()) };
        assert_eq!(first.t_s.len(), BINS);
        assert!((first.t_s[1] - first.t_s[0] - 0.02).abs() < 1e-9);
        assert!((second.t_s[0] - first.t_s[4] - 0.02).abs() < 1e-9);
        assert_eq!(first.largest[master], [0.25, 0.25, 0.25, 1.5, 0.25].map(Some));
        assert_eq!(first.least[master], [0.25; 5].map(Some));
        assert_eq!(first.least[slave], [None; 5]);
    }

    #[test]
    fn innovations_are_binned_by_axis_in_degrees() {
        let mut plotter = InnovationPlotter::new(2000);
        let row = |at: u64, axis| Innovation {
            tick: 1_000_000 + 8 * at,
            master: if at == 70 { -0.01 } else { 0.002 },
            axis,
            ..Innovation::default()
        };
        let mut batches = Vec::new();
        for at in 0..124 {
            // Another axis does not disturb.
            assert_eq!(plotter.take(&row(at, 1)).is_some(), at == 123);
            batches.extend(plotter.take(&row(at, 0)));
        }
        let [batch] = batches.as_slice() else { panic!("{} batches", batches.len()) };
        assert!((batch.t_s[1] - batch.t_s[0] - 0.248).abs() < 1e-9);
        let degrees = |rad: f64| Some(rad.to_degrees() as f32);
        assert_eq!(batch.least[0], [degrees(0.002), degrees(-0.01)]);
        assert_eq!(batch.largest[0], [degrees(0.002); 2]);
        // Without a slave encoder there is none of the slave.
        assert_eq!(batch.least[1], [None; 2]);
        // A row of an axis that no rig has is none.
        assert_eq!(plotter.take(&row(0, 9)), None);
    }
}
