//! Zero-phase low-pass of uniformly sampled signals.
//!
//! The filter is a Butterworth low-pass of order 4 (two second-order sections, bilinear transform,
//! cut-off pre-warped), run forward and then backward over the record. "Order 4" is the order of
//! one pass, as published for the EMPS record: the two passes together have the magnitude
//! `|H(f)|²`, so the amplitude is halved (-6 dB, not -3 dB) at the cut-off frequency and falls by
//! 48 dB per octave, without phase shift.
//!
//! Edges: the record is extended at both ends by its reflection through the end point (odd
//! extension, three periods of the cut-off), and each pass starts in the steady state of its first
//! value. The remaining transients decay within [`ZeroPhase::settling`] samples, which callers
//! leave out.

use std::f64::consts::PI;

/// One second-order section, transposed direct form II, gain 1 at zero frequency.
#[derive(Clone, Copy, Debug)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

/// A fourth-order Butterworth low-pass, to be run forward and backward.
#[derive(Clone, Copy, Debug)]
pub struct ZeroPhase {
    sections: [Section; 2],
    pad: usize,
}

impl ZeroPhase {
    /// A filter with its cut-off frequency (of one pass, -3 dB) and the sampling frequency, both in
    /// Hz. `None` unless `0 < cut_off < sampling / 2`.
    pub fn new(cut_off: f64, sampling: f64) -> Option<Self> {
        if !(cut_off > 0.0 && cut_off < 0.5 * sampling) {
            return None;
        }
        let k = (PI * cut_off / sampling).tan();
        let section = |angle: f64| {
            // Pole pair at ±angle from the negative real axis: s² + 2 cos(angle) s + 1.
            let damping = 2.0 * angle.cos();
            let norm = 1.0 / (1.0 + damping * k + k * k);
            let b = k * k * norm;
            Section {
                b: [b, 2.0 * b, b],
                a: [2.0 * (k * k - 1.0) * norm, (1.0 - damping * k + k * k) * norm],
            }
        };
        let pad = (3.0 * sampling / cut_off).ceil() as usize;
        Some(Self { sections: [section(PI / 8.0), section(3.0 * PI / 8.0)], pad })
    }

    /// Number of samples with edge transients at each end: four periods of the cut-off.
    pub fn settling(&self) -> usize {
        self.pad * 4 / 3
    }

    /// The low-passed signal, of the length of the input.
    pub fn run(&self, signal: &[f64]) -> Vec<f64> {
        let n = signal.len();
        if n < 2 {
            return signal.to_vec();
        }
        let pad = self.pad.min(n - 1);
        let mut work = Vec::with_capacity(n + 2 * pad);
        work.extend((1..=pad).rev().map(|i| 2.0 * signal[0] - signal[i]));
        work.extend_from_slice(signal);
        work.extend((1..=pad).map(|i| 2.0 * signal[n - 1] - signal[n - 1 - i]));
        self.pass(work.iter_mut());
        self.pass(work.iter_mut().rev());
        work[pad..pad + n].to_vec()
    }

    /// Both sections in one loop: neither waits for the other's last value, and the time of the
    /// filter is that of waiting.
    fn pass<'a>(&self, signal: impl Iterator<Item = &'a mut f64>) {
        let mut signal = signal.peekable();
        let first = signal.peek().map_or(0.0, |first| **first);
        let [one, two] = self.sections;
        let mut of_one = one.settled(first);
        let mut of_two = two.settled(one.step(first, &mut of_one.clone()));
        for value in signal {
            *value = two.step(one.step(*value, &mut of_one), &mut of_two);
        }
    }
}

/// Magnitude of the filter, forward and backward, at a frequency (all in Hz).
pub fn magnitude(cut_off: f64, sampling: f64, frequency: f64) -> f64 {
    let warped = |f: f64| (PI * f / sampling).tan();
    1.0 / (1.0 + (warped(frequency) / warped(cut_off)).powi(8))
}

impl Section {
    /// State in which a constant input passes unchanged.
    fn settled(&self, input: f64) -> [f64; 2] {
        [(1.0 - self.b[0]) * input, (self.b[2] - self.a[1]) * input]
    }

    #[inline]
    fn step(&self, x: f64, state: &mut [f64; 2]) -> f64 {
        let y = self.b[0] * x + state[0];
        state[0] = self.b[1] * x - self.a[0] * y + state[1];
        state[1] = self.b[2] * x - self.a[1] * y;
        y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Amplitude and phase of the filter's answer to a sine, by projection over whole periods
    /// mid-record.
    fn answer(frequency: f64) -> (f64, f64) {
        let (fs, n) = (1000.0, 8000);
        let wave: Vec<f64> = (0..n).map(|i| (2.0 * PI * frequency * i as f64 / fs).sin()).collect();
        let out = ZeroPhase::new(40.0, fs).unwrap().run(&wave);
        let (mut s, mut c) = (0.0, 0.0);
        for (i, y) in out.iter().enumerate().skip(2000).take(4000) {
            let phase = 2.0 * PI * frequency * i as f64 / fs;
            s += y * phase.sin() / 2000.0;
            c += y * phase.cos() / 2000.0;
        }
        (s.hypot(c), c.atan2(s))
    }

    #[test]
    fn magnitude_is_that_of_butterworth_squared_and_phase_is_zero() {
        for frequency in [1.0, 10.0, 20.0, 30.0, 40.0, 50.0, 80.0] {
            let (measured, phase) = answer(frequency);
            let closed = magnitude(40.0, 1000.0, frequency);
            assert!(
                (measured - closed).abs() < 1e-9 + 1e-6 * closed,
                "{frequency} Hz: {measured} {closed}"
            );
            assert!(phase.abs() < 1e-6, "{frequency} Hz: {phase} rad");
        }
        assert!((answer(40.0).0 - 0.5).abs() < 1e-9);
    }

    #[test]
    fn constants_and_ramps_pass_unchanged_up_to_the_edges() {
        let filter = ZeroPhase::new(40.0, 1000.0).unwrap();
        for (offset, slope) in [(3.0, 0.0), (-1.0, 0.02)] {
            let ramp: Vec<f64> = (0..500).map(|i| offset + slope * f64::from(i)).collect();
            for (i, (a, b)) in filter.run(&ramp).iter().zip(&ramp).enumerate() {
                assert!((a - b).abs() < 1e-3 * (1.0 + b.abs()), "row {i}: {a} {b}");
            }
        }
    }

    #[test]
    fn time_reversal_changes_nothing_between_the_edges() {
        let filter = ZeroPhase::new(40.0, 1000.0).unwrap();
        let signal: Vec<f64> = (0..3000).map(|i| f64::from(i * i % 101)).collect();
        let mut reversed: Vec<f64> = signal.iter().rev().copied().collect();
        reversed = filter.run(&reversed);
        reversed.reverse();
        let settled = filter.settling();
        for (a, b) in filter.run(&signal)[settled..3000 - settled].iter().zip(&reversed[settled..])
        {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
    }

    #[test]
    fn impossible_cut_offs_are_refused() {
        assert!(ZeroPhase::new(500.0, 1000.0).is_none());
        assert!(ZeroPhase::new(0.0, 1000.0).is_none());
    }
}
