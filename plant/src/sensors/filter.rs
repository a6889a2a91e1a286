//! Second-order sections, and a Butterworth band-pass composed of them.

use std::f64::consts::PI;

/// One second-order section, transposed direct form II.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Biquad {
    forward: [f64; 3],
    feedback: [f64; 2],
    memory: [f64; 2],
}

impl Biquad {
    /// Low-pass with the corner frequency `frequency`, a fraction of the sampling rate (0 to 0.5),
    /// and the quality factor `quality`; bilinear transform, exact at the corner.
    pub fn low_pass(frequency: f64, quality: f64) -> Self {
        let (cosine, alpha) = Self::corner(frequency, quality);
        Self::scaled([0.5 * (1.0 - cosine), 1.0 - cosine, 0.5 * (1.0 - cosine)], cosine, alpha)
    }

    /// High-pass; arguments as for [`Self::low_pass`].
    pub fn high_pass(frequency: f64, quality: f64) -> Self {
        let (cosine, alpha) = Self::corner(frequency, quality);
        Self::scaled([0.5 * (1.0 + cosine), -(1.0 + cosine), 0.5 * (1.0 + cosine)], cosine, alpha)
    }

    /// The next output.
    #[inline]
    pub fn update(&mut self, input: f64) -> f64 {
        let output = self.forward[0] * input + self.memory[0];
        self.memory[0] = self.forward[1] * input - self.feedback[0] * output + self.memory[1];
        self.memory[1] = self.forward[2] * input - self.feedback[1] * output;
        output
    }

    fn corner(frequency: f64, quality: f64) -> (f64, f64) {
        let (sine, cosine) = (2.0 * PI * frequency).sin_cos();
        (cosine, sine / (2.0 * quality))
    }

    fn scaled(forward: [f64; 3], cosine: f64, alpha: f64) -> Self {
        let scale = 1.0 / (1.0 + alpha);
        Self {
            forward: forward.map(|value| value * scale),
            feedback: [-2.0 * cosine * scale, (1.0 - alpha) * scale],
            memory: [0.0; 2],
        }
    }
}

/// Quality factors of the two sections of a fourth-order Butterworth filter, `1 / 2 cos(π/8)` and
/// `1 / 2 cos(3π/8)`.
const FOURTH_ORDER: [f64; 2] = [0.541_196_100_146_197, 1.306_562_964_876_376_5];

/// A causal band-pass: a fourth-order Butterworth high-pass followed by a fourth-order Butterworth
/// low-pass; -3 dB at each corner frequency and 24 dB per octave beyond. For corner frequencies
/// well apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandPass {
    sections: [Biquad; 4],
}

impl BandPass {
    /// With corner frequencies `low` and `high`, fractions of the sampling rate,
    /// `0 < low < high < 0.5`.
    pub fn new(low: f64, high: f64) -> Self {
        let [wide, narrow] = FOURTH_ORDER;
        Self {
            sections: [
                Biquad::high_pass(low, wide),
                Biquad::high_pass(low, narrow),
                Biquad::low_pass(high, wide),
                Biquad::low_pass(high, narrow),
            ],
        }
    }

    /// The next output.
    #[inline]
    pub fn update(&mut self, input: f64) -> f64 {
        self.sections.iter_mut().fold(input, |signal, section| section.update(signal))
    }

    /// Rms output for white noise of unit variance: the root of the energy of the impulse response
    /// over `samples`.
    pub fn noise_gain(&self, samples: usize) -> f64 {
        let mut filter = *self;
        let first = filter.update(1.0);
        (1..samples).fold(first * first, |sum, _| sum + filter.update(0.0).powi(2)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::{BandPass, Biquad};
    use std::f64::consts::FRAC_1_SQRT_2;

    /// Amplitude of the output for a sine of unit amplitude, after the transient.
    fn gain(mut update: impl FnMut(f64) -> f64, frequency: f64) -> f64 {
        let (mut sine, mut cosine) = (0.0, 0.0);
        // 1000 samples hold whole periods of every frequency used here.
        for index in 0..41_000 {
            let angle = std::f64::consts::TAU * frequency * f64::from(index);
            let output = update(angle.sin());
            if index >= 40_000 {
                sine += output * angle.sin() / 500.0;
                cosine += output * angle.cos() / 500.0;
            }
        }
        sine.hypot(cosine)
    }

    #[test]
    fn corners_and_slopes() {
        let section = |frequency: f64| {
            let mut low = Biquad::low_pass(0.1, FRAC_1_SQRT_2);
            gain(|input| low.update(input), frequency)
        };
        assert!((section(0.1) - FRAC_1_SQRT_2).abs() < 1e-9);
        assert!((section(0.001) - 1.0).abs() < 1e-6);
        let band = |frequency: f64| {
            let mut band = BandPass::new(0.005, 0.2);
            gain(|input| band.update(input), frequency)
        };
        assert!((band(0.005) - FRAC_1_SQRT_2).abs() < 1e-3, "{}", band(0.005));
        assert!((band(0.2) - FRAC_1_SQRT_2).abs() < 1e-3, "{}", band(0.2));
        assert!((band(0.03) - 1.0).abs() < 1e-3);
        // Analog prototype at (tan π 0.005 / tan π 0.001)⁴ below its corner.
        assert!((band(0.001) * 625.0 - 1.0).abs() < 5e-3, "{}", band(0.001));
        assert!(band(0.4) < 0.01);
    }
}
