//! Interpolation, differentiation and low-pass of band-limited signals by their Fourier transform.
//!
//! A record is not periodic, so its end is joined to its start by odd extensions of both that fade
//! into each other. Their influence decays within [`LowPass::settling`] samples of either end,
//! which callers leave out. In between, the result is exact for signals whose spectrum ends below
//! half the sampling frequency (Whittaker-Shannon interpolation).

use std::cell::RefCell;
use std::f64::consts::{PI, TAU};

use plant::fourier::Planner;
use realfft::num_complex::Complex;

/// Largest number of samples that join end and start.
const JOIN: usize = 512;

thread_local! {
    /// Plans are costly; one serves all signals of the same length.
    static PLANNER: RefCell<Planner> = RefCell::new(Planner::new());
}

/// The Fourier transform of some rows at frequencies from 0 to half the sampling frequency; `None`
/// if it fails.
pub fn transform(mut rows: Vec<f64>) -> Option<Vec<Complex<f64>>> {
    let plan = PLANNER.with_borrow_mut(|planner| planner.forward(rows.len()));
    let mut bins = plan.make_output_vec();
    plan.process(&mut rows, &mut bins).ok()?;
    Some(bins)
}

/// Returns the rows with this transform, as [`transform`] gives it; `None` if it fails.
pub fn inverse_transform(mut bins: Vec<Complex<f64>>, samples: usize) -> Option<Vec<f64>> {
    let plan = PLANNER.with_borrow_mut(|planner| planner.inverse(samples));
    let mut rows = plan.make_output_vec();
    plan.process(&mut bins, &mut rows).ok()?;
    rows.iter_mut().for_each(|row| *row /= samples as f64);
    Some(rows)
}

/// The Fourier transform of a signal.
pub struct Spectrum {
    bins: Vec<Complex<f64>>,
    length: usize,
    samples: usize,
}

/// The smallest even number not below `least` with no prime factors but 2, 3 and 5: transforms of
/// such lengths are fast.
fn smooth_length(least: usize) -> usize {
    let smooth = |n: &usize| {
        let mut rest = *n;
        for factor in [2, 3, 5] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1
    };
    (least.div_ceil(2)..).find(smooth).unwrap_or(least) * 2
}

impl Spectrum {
    /// The transform of a signal of at least two samples.
    pub fn of(signal: &[f64]) -> Option<Self> {
        let n = signal.len();
        let (first, last) = (*signal.first()?, *signal.last()?);
        if n < 2 {
            return None;
        }
        let join = JOIN.min(n - 1);
        let length = smooth_length(n + join);
        let gap = length - n;
        let mut work = signal.to_vec();
        for j in 1..=gap {
            let onward = 2.0 * last - signal[n - 1 - j.min(n - 1)];
            let back = 2.0 * first - signal[(gap + 1 - j).min(n - 1)];
            let weight = 0.5 * (1.0 + (PI * j as f64 / (gap + 1) as f64).cos());
            work.push(weight * onward + (1.0 - weight) * back);
        }
        Some(Self { bins: transform(work)?, length, samples: n })
    }

    /// The signal, or its derivative of that order, at `factor` times the sampling frequency, from
    /// the first sample to the last, with a weight for each frequency (Hz). `None` if the transform
    /// fails.
    pub fn wave(
        &self,
        factor: usize,
        derivative: u32,
        sampling: f64,
        weight: impl Fn(f64) -> f64,
    ) -> Option<Vec<f64>> {
        let length = self.length * factor;
        let plan = PLANNER.with_borrow_mut(|planner| planner.inverse(length));
        let mut bins = plan.make_input_vec();
        let nyquist = self.length / 2;
        for (k, (to, from)) in bins.iter_mut().zip(&self.bins).enumerate() {
            let frequency = k as f64 * sampling / self.length as f64;
            let turn = Complex::new(0.0, TAU * frequency).powu(derivative);
            // The bin at half the sampling frequency represents two bins of the finer signal.
            let share = if k == nyquist && factor > 1 { 0.5 } else { 1.0 };
            *to = *from * turn * (share * weight(frequency) / self.length as f64);
        }
        for edge in [0, length / 2] {
            if let Some(bin) = bins.get_mut(edge) {
                bin.im = 0.0;
            }
        }
        let mut out = plan.make_output_vec();
        plan.process(&mut bins, &mut out).ok()?;
        out.truncate((self.samples - 1) * factor + 1);
        Some(out)
    }

    /// The frequency (Hz) below which this share of the energy lies, excluding the mean.
    pub fn energy_below(&self, share: f64, sampling: f64) -> f64 {
        let energy: Vec<f64> = self.bins.iter().skip(1).map(Complex::norm_sqr).collect();
        let total: f64 = energy.iter().sum();
        let mut sum = 0.0;
        let below = energy.iter().take_while(|e| {
            sum += **e;
            sum < share * total
        });
        (below.count() + 1) as f64 * sampling / self.length as f64
    }
}

/// Number of octaves of [`octave_powers`].
pub const OCTAVES: usize = 8;
/// Rows of a segment of [`octave_powers`].
const SEGMENT: usize = 512;

/// Number of bins in each octave of [`octave_powers`].
const OCTAVE_BINS: [usize; OCTAVES] = [128, 64, 32, 16, 8, 4, 2, 2];

/// Share of the mean square of white noise that lies in each octave of [`octave_powers`].
pub fn white_shares() -> [f64; OCTAVES] {
    OCTAVE_BINS.map(|bins| bins as f64 / (SEGMENT / 2) as f64)
}

/// The mean square of a signal in each octave of frequency, the highest first: from half to a
/// quarter of the sampling frequency, and so on; the last one takes what is below. Averaged over
/// segments of 512 rows that overlap by half, under a sine window (Welch's method). `None` for
/// shorter signals.
pub fn octave_powers(signal: &[f64]) -> Option<[f64; OCTAVES]> {
    let (mut powers, mut segments) = ([0.0; OCTAVES], 0.0);
    let begins = (0..signal.len()).step_by(SEGMENT / 2);
    for rows in begins.filter_map(|from| signal.get(from..from + SEGMENT)) {
        let weight = |row: usize| (PI * (row as f64 + 0.5) / SEGMENT as f64).sin();
        let mean = rows.iter().sum::<f64>() / SEGMENT as f64;
        let bins = transform(
            rows.iter().enumerate().map(|(row, value)| weight(row) * (value - mean)).collect(),
        )?;
        let mut from = bins.len();
        for (power, count) in powers.iter_mut().zip(OCTAVE_BINS) {
            *power += bins[from - count..from].iter().map(Complex::norm_sqr).sum::<f64>();
            from -= count;
        }
        segments += 1.0;
    }
    // A bin stands for a negative frequency, too, and the window has a mean square of 1/2.
    let scale = 4.0 / (SEGMENT * SEGMENT) as f64;
    (segments > 0.0).then(|| powers.map(|power| scale * power / segments))
}

/// Logarithms of [`octave_powers`]; finite where nothing is left.
pub fn octave_logarithms(signal: &[f64]) -> Option<[f64; OCTAVES]> {
    let powers = octave_powers(signal)?;
    Some(powers.map(|power| power.max(f64::MIN_POSITIVE).ln()))
}

/// Power over frequency (Hz) of a signal, with bins four times finer than its length resolves. Rows
/// that are to be left out must be 0.
pub fn periodogram(signal: &[f64], sampling: f64) -> Vec<(f64, f64)> {
    let length = smooth_length(4 * signal.len().max(1));
    let mut work = signal.to_vec();
    work.resize(length, 0.0);
    let bins = transform(work).unwrap_or_default();
    bins.iter()
        .enumerate()
        .map(|(k, bin)| (k as f64 * sampling / length as f64, bin.norm_sqr()))
        .collect()
}

/// A zero-phase low-pass: 1 up to the cut-off, 0 above 1.25 times the cut-off, a half cosine in
/// between.
#[derive(Clone, Copy, Debug)]
pub struct LowPass {
    /// Highest frequency that passes unchanged (Hz).
    pub cut_off: f64,
    /// Sampling frequency (Hz).
    pub sampling: f64,
}

impl LowPass {
    /// Weight at a frequency (Hz).
    pub fn weight(&self, frequency: f64) -> f64 {
        let share = ((frequency / self.cut_off - 1.0) / 0.25).clamp(0.0, 1.0);
        0.5 * (1.0 + (PI * share).cos())
    }

    /// Number of samples with edge transients at each end: sixteen periods of the cut-off.
    pub fn settling(&self) -> usize {
        (16.0 * self.sampling / self.cut_off).ceil() as usize
    }

    /// The low-passed signal, of the length of the input.
    pub fn run(&self, signal: &[f64]) -> Vec<f64> {
        Spectrum::of(signal)
            .and_then(|s| s.wave(1, 0, self.sampling, |f| self.weight(f)))
            .unwrap_or_else(|| signal.to_vec())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_noise::noise;

    fn tones(t: f64) -> (f64, f64, f64) {
        let mut sum = (0.3, 0.0, 0.0);
        for (frequency, size, phase) in [(7.3, 1.0, 0.4), (61.0, 0.5, 1.0), (133.7, 0.2, 2.0)] {
            let w = TAU * frequency;
            let (sine, cosine) = (w * t + phase).sin_cos();
            sum = (sum.0 + size * sine, sum.1 + size * w * cosine, sum.2 - size * w * w * sine);
        }
        sum
    }

    #[test]
    fn tones_are_interpolated_and_differentiated_exactly_away_from_the_edges() {
        let (sampling, n) = (600.0, 4000);
        let signal: Vec<f64> = (0..n).map(|i| tones(f64::from(i) / sampling).0).collect();
        let spectrum = Spectrum::of(&signal).unwrap();
        let low_pass = LowPass { cut_off: 200.0, sampling };
        for (order, size) in [(0, 1.7), (1, 400.0), (2, 2e5)] {
            let wave = spectrum.wave(4, order, sampling, |f| low_pass.weight(f)).unwrap();
            assert_eq!(wave.len(), 4 * (n as usize - 1) + 1);
            for (i, value) in wave.iter().enumerate().skip(2000).take(12_000) {
                let exact = tones(i as f64 / (4.0 * sampling));
                let exact = [exact.0, exact.1, exact.2][order as usize];
                assert!((value - exact).abs() < 1e-4 * size, "order {order}, {i}: {value} {exact}");
            }
        }
    }

    #[test]
    fn the_low_pass_removes_what_lies_above_and_nothing_below() {
        let sampling = 600.0;
        let low_pass = LowPass { cut_off: 100.0, sampling };
        for (frequency, gain) in [(20.0, 1.0), (99.0, 1.0), (126.0, 0.0), (250.0, 0.0)] {
            let wave: Vec<f64> =
                (0..6000).map(|i| (TAU * frequency * f64::from(i) / sampling).sin()).collect();
            let settled = low_pass.settling();
            for (a, b) in low_pass.run(&wave)[settled..6000 - settled].iter().zip(&wave[settled..])
            {
                assert!((a - gain * b).abs() < 2e-3, "{frequency} Hz: {a} {b}");
            }
        }
    }

    #[test]
    fn energy_and_peaks_lie_where_the_tone_is() {
        let wave: Vec<f64> = (0..3000).map(|i| (TAU * 31.4 * f64::from(i) / 500.0).sin()).collect();
        let edge = Spectrum::of(&wave).unwrap().energy_below(0.99, 500.0);
        assert!((31.0..33.0).contains(&edge), "{edge}");
        let peak =
            periodogram(&wave, 500.0).into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!((peak.0 - 31.4).abs() < 0.05, "{peak:?}");
    }

    #[test]
    fn a_tone_lies_in_its_octave_and_white_noise_halves_from_octave_to_octave() {
        let sampling = 250.0;
        let tone: Vec<f64> =
            (0..4096).map(|i| 0.7 * (TAU * 20.0 * f64::from(i) / sampling).sin()).collect();
        let powers = octave_powers(&tone).unwrap();
        // 15.6 to 31.25 Hz.
        assert!((powers[2] - 0.245).abs() < 1e-3, "{powers:?}");
        assert!(powers.iter().sum::<f64>() - powers[2] < 1e-3, "{powers:?}");
        let white = noise(1, 200_000);
        let powers = octave_powers(&white).unwrap();
        assert!((powers.iter().sum::<f64>() - 1.0 / 12.0).abs() < 1e-3, "{powers:?}");
        for (power, share) in powers.iter().zip(white_shares()) {
            assert!((power / (share / 12.0) - 1.0).abs() < 0.2, "{powers:?}");
        }
        assert!(octave_powers(&white[..511]).is_none());
    }

    #[test]
    fn lengths_are_even_and_smooth() {
        for (least, expected) in [(2, 2), (7, 8), (62, 64), (65_574, 65_610)] {
            let length = smooth_length(least);
            assert!(
                length >= least && length.is_multiple_of(2) && length <= expected,
                "{least}: {length}"
            );
        }
    }
}
