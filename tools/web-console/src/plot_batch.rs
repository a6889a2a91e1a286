//! Signals for the live plots: of every 20 ms the least and the largest value, so that a narrow
//! peak is seen and fast signals are not aliased.

use ipc_types::Sample;
use recorder::Signal;
use serde::Serialize;

/// Bins a second.
const RATE: u32 = 50;
/// Bins of a batch: ten batches a second.
const BINS: usize = 5;

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

/// Gathers samples into batches.
pub(crate) struct Plotter {
    signals: Vec<Signal>,
    /// Samples in one bin.
    bin: u32,
    /// Time of the first sample (ns).
    origin_ns: Option<u64>,
    bin_began_ns: u64,
    in_bin: u32,
    least: Vec<f32>,
    largest: Vec<f32>,
    batch: Batch,
}

impl Plotter {
    /// For signals of samples that come at this rate (Hz).
    pub(crate) fn new(signals: Vec<Signal>, rate_hz: u32) -> Self {
        let count = signals.len();
        let mut plotter = Self {
            signals,
            bin: (rate_hz / RATE).max(1),
            origin_ns: None,
            bin_began_ns: 0,
            in_bin: 0,
            least: vec![f32::NAN; count],
            largest: vec![f32::NAN; count],
            batch: Batch::default(),
        };
        plotter.batch = plotter.empty();
        plotter
    }

    fn empty(&self) -> Batch {
        let none = || vec![Vec::with_capacity(BINS); self.signals.len()];
        Batch { t_s: Vec::with_capacity(BINS), least: none(), largest: none() }
    }

    /// Adds a sample; a batch when one is full.
    pub(crate) fn take(&mut self, sample: &Sample) -> Option<Batch> {
        if self.in_bin == 0 {
            self.bin_began_ns = sample.scan_time_ns;
            self.least.fill(f32::NAN);
            self.largest.fill(f32::NAN);
        }
        for ((signal, least), largest) in
            self.signals.iter().zip(&mut self.least).zip(&mut self.largest)
        {
            // Of a number and NaN both give the number.
            let value = signal.value(sample) as f32;
            (*least, *largest) = (least.min(value), largest.max(value));
        }
        self.in_bin += 1;
        if self.in_bin < self.bin {
            return None;
        }
        self.in_bin = 0;
        let origin_ns = *self.origin_ns.get_or_insert(self.bin_began_ns);
        let middle_ns = (self.bin_began_ns + sample.scan_time_ns) / 2;
        self.batch.t_s.push(middle_ns.saturating_sub(origin_ns) as f64 * 1e-9);
        let value = |value: f32| value.is_finite().then_some(value);
        for at in 0..self.signals.len() {
            self.batch.least[at].push(value(self.least[at]));
            self.batch.largest[at].push(value(self.largest[at]));
        }
        (self.batch.t_s.len() == BINS).then(|| {
            let empty = self.empty();
            std::mem::replace(&mut self.batch, empty)
        })
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
}
