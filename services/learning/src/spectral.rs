//! Exact operations on one cycle of a periodic signal, by its discrete Fourier transform.

use std::fmt;
use std::sync::Arc;

use plant::fourier::Planner;
use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealToComplex};

/// Order of the low pass, each way.
const ORDER: i32 = 2;

/// Transforms for cycles of a fixed number of samples. Allocates only when created.
pub struct Spectral {
    forward: Arc<dyn RealToComplex<f64>>,
    backward: Arc<dyn ComplexToReal<f64>>,
    samples: usize,
    /// Frequency of the first harmonic (Hz).
    base_hz: f64,
    input: Vec<f64>,
    scratch: Vec<Complex<f64>>,
    spectrum: Vec<Complex<f64>>,
}

impl Spectral {
    /// Creates transforms for cycles of `samples` values at `rate_hz` (Hz).
    pub fn new(samples: usize, rate_hz: f64) -> Self {
        let mut planner = Planner::new();
        let (forward, backward) = (planner.forward(samples), planner.inverse(samples));
        Self {
            samples,
            base_hz: rate_hz / samples as f64,
            input: forward.make_input_vec(),
            scratch: vec![
                Complex::default();
                forward.get_scratch_len().max(backward.get_scratch_len())
            ],
            spectrum: forward.make_output_vec(),
            forward,
            backward,
        }
    }

    /// Complex amplitudes of the cycle's harmonics, in its unit: the transform scaled by `2/N`, the
    /// mean by `1/N`. A sine of amplitude 1 at harmonic h has magnitude 1 there.
    ///
    /// # Panics
    /// If `values` is not one cycle long, like every method here.
    pub fn spectrum(&mut self, values: &[f64]) -> &[Complex<f64>] {
        self.transform(values);
        let scale = 2.0 / self.samples as f64;
        for value in &mut self.spectrum {
            *value *= scale;
        }
        self.spectrum[0] *= 0.5;
        &self.spectrum
    }

    /// Multiplies each harmonic of a cycle by `factor`, a function of the harmonic's number, in
    /// place.
    pub fn shape(&mut self, values: &mut [f64], factor: impl Fn(usize) -> Complex<f64>) {
        self.transform(values);
        for (harmonic, value) in self.spectrum.iter_mut().enumerate() {
            *value *= factor(harmonic);
        }
        let edges = [Some(0), self.samples.is_multiple_of(2).then_some(self.samples / 2)];
        for edge in edges.into_iter().flatten() {
            // The mean and the Nyquist harmonic of a real signal are real.
            self.spectrum[edge].im = 0.0;
        }
        // The lengths are those of the plan, and the two edges are real: it cannot fail.
        let _ = self.backward.process_with_scratch(
            &mut self.spectrum,
            &mut self.input,
            &mut self.scratch,
        );
        let scale = 1.0 / self.samples as f64;
        for (value, shaped) in values.iter_mut().zip(&self.input) {
            *value = scale * shaped;
        }
    }

    /// The zero-phase low pass of eq. 4.3.2: a second-order Butterworth filter run forward and
    /// backward over the repeated cycle. Its gain is `1/(1 + (f/cutoff)^4)`: one half at the
    /// cut-off (Hz).
    pub fn low_pass(&mut self, values: &mut [f64], cutoff_hz: f64) {
        let base_hz = self.base_hz;
        self.shape(values, |harmonic| {
            Complex::from(1.0 / (1.0 + (harmonic as f64 * base_hz / cutoff_hz).powi(2 * ORDER)))
        });
    }

    /// Differentiates a cycle with respect to time (per s), in place: exact for a band-limited
    /// signal. Drops the Nyquist harmonic, whose phase is undetermined.
    pub fn differentiate(&mut self, values: &mut [f64]) {
        let omega = std::f64::consts::TAU * self.base_hz;
        let samples = self.samples;
        self.shape(values, |harmonic| {
            let unclear = 2 * harmonic == samples;
            Complex::new(0.0, if unclear { 0.0 } else { omega * harmonic as f64 })
        });
    }

    fn transform(&mut self, values: &[f64]) {
        self.input.copy_from_slice(values);
        // The lengths are those of the plan: it cannot fail.
        let _ = self.forward.process_with_scratch(
            &mut self.input,
            &mut self.spectrum,
            &mut self.scratch,
        );
    }
}

impl fmt::Debug for Spectral {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("Spectral")
            .field("samples", &self.samples)
            .field("base_hz", &self.base_hz)
            .finish_non_exhaustive()
    }
}

/// Advances a cycle circularly by `samples`: `e(n) = e'(n + N_d)`, § 4.3 (see `docs/errata.md`).
pub fn advance(values: &mut [f64], samples: usize) {
    if !values.is_empty() {
        values.rotate_left(samples % values.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    fn wave(samples: usize, parts: &[(usize, f64, f64)]) -> Vec<f64> {
        let value = |n: usize| {
            let angle = |h: usize| TAU * (h * n) as f64 / samples as f64;
            parts.iter().map(|(h, amplitude, phase)| amplitude * (angle(*h) + phase).sin()).sum()
        };
        (0..samples).map(value).collect()
    }

    #[test]
    fn low_pass_keeps_a_slow_sine_where_it_is() {
        let mut spectral = Spectral::new(500, 500.0);
        let slow = wave(500, &[(1, 30.0, 0.7)]);
        let mut filtered = slow.clone();
        spectral.low_pass(&mut filtered, 10.0);
        for (filtered, slow) in filtered.iter().zip(&slow) {
            // Amplitude by the closed form, phase not at all.
            assert!((filtered - slow / (1.0 + 1e-4)).abs() < 1e-10);
        }
    }

    #[test]
    fn low_pass_halves_at_the_cut_off_and_takes_away_what_is_fast() {
        let mut spectral = Spectral::new(500, 500.0);
        let mut values = wave(500, &[(10, 1.0, 0.3), (100, 1.0, 1.0)]);
        spectral.low_pass(&mut values, 10.0);
        let spectrum = spectral.spectrum(&values);
        assert!((spectrum[10].norm() - 0.5).abs() < 1e-12 && spectrum[100].norm() < 1.1e-4);
    }

    /// The same as a second-order Butterworth filter, bilinear and prewarped, run forward and
    /// backward until the start is forgotten, but for the warping of the frequency axis.
    #[test]
    fn low_pass_is_forward_and_backward_filtering() {
        let (samples, cutoff) = (2000, 6.0);
        let original = wave(samples, &[(1, 1.0, 0.2), (5, 0.5, 1.1), (20, 0.3, 2.0)]);
        let k = (std::f64::consts::PI * cutoff / samples as f64).tan();
        let norm = 1.0 / (1.0 + std::f64::consts::SQRT_2 * k + k * k);
        let (b, a1, a2) = (
            k * k * norm,
            2.0 * (k * k - 1.0) * norm,
            (1.0 - std::f64::consts::SQRT_2 * k + k * k) * norm,
        );
        let run = |values: Vec<f64>| -> Vec<f64> {
            let (mut x1, mut x2, mut y1, mut y2) = (0.0, 0.0, 0.0, 0.0);
            let filtered: Vec<f64> = (0..4 * samples)
                .map(|n| {
                    let x = values[n % samples];
                    let y = b * (x + 2.0 * x1 + x2) - a1 * y1 - a2 * y2;
                    (x2, x1, y2, y1) = (x1, x, y1, y);
                    y
                })
                .collect();
            filtered[3 * samples..].to_vec()
        };
        let mut expected = run(original.clone());
        expected.reverse();
        let mut expected = run(expected);
        expected.reverse();
        let mut values = original;
        Spectral::new(samples, samples as f64).low_pass(&mut values, cutoff);
        for (value, expected) in values.iter().zip(&expected) {
            assert!((value - expected).abs() < 1e-3, "{value}, expected {expected}");
        }
    }

    #[test]
    fn derivative_is_exact() {
        for samples in [500, 501] {
            let mut values = wave(samples, &[(1, 2.0, 0.4), (7, 0.1, 0.0)]);
            Spectral::new(samples, samples as f64 / 2.0).differentiate(&mut values);
            for (n, value) in values.iter().enumerate() {
                // A cycle of 2 s.
                let angle = TAU * n as f64 / samples as f64;
                let expected = 0.5 * TAU * (2.0 * (angle + 0.4).cos() + 0.7 * (7.0 * angle).cos());
                assert!((value - expected).abs() < 1e-9);
            }
        }
    }

    proptest! {
        #[test]
        fn advance_is_exact_and_circular(
            values in prop::collection::vec(-9.0..9.0f64, 1..80), by in 0usize..200,
        ) {
            let mut advanced = values.clone();
            advance(&mut advanced, by);
            for (n, value) in advanced.iter().enumerate() {
                prop_assert_eq!(*value, values[(n + by) % values.len()]);
            }
        }

        #[test]
        fn low_pass_is_linear_and_turns_with_its_input(
            values in prop::collection::vec(-9.0..9.0f64, 50),
            by in 0usize..50,
            scale in -3.0..3.0f64,
        ) {
            let mut spectral = Spectral::new(50, 100.0);
            let mut filtered = values.clone();
            spectral.low_pass(&mut filtered, 7.0);
            advance(&mut filtered, by);
            let mut other: Vec<f64> = values.iter().map(|value| scale * value).collect();
            advance(&mut other, by);
            spectral.low_pass(&mut other, 7.0);
            for (other, filtered) in other.iter().zip(&filtered) {
                prop_assert!((other - scale * filtered).abs() < 1e-11);
            }
        }
    }
}
