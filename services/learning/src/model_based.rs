//! Model-based learning law: the inverse of the identified frequency response.

use realfft::num_complex::Complex;

use crate::spectral::Spectral;

/// Frequency response from the master's reference to the slave, at the harmonics of one cycle;
/// `None` where it is not identified.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Response(Vec<Option<Complex<f64>>>);

impl Response {
    /// Values at harmonic 0 (the mean), 1, 2, ... Values that are not finite become `None`.
    pub fn new(values: Vec<Option<Complex<f64>>>) -> Self {
        Self(values.into_iter().map(|value| value.filter(|value| value.is_finite())).collect())
    }

    /// The response at a harmonic.
    pub fn at(&self, harmonic: usize) -> Option<Complex<f64>> {
        self.0.get(harmonic).copied().flatten()
    }

    /// Real and imaginary part at harmonic 0, 1, 2, ...
    pub fn parts(&self) -> Vec<Option<(f64, f64)>> {
        self.0.iter().map(|value| value.map(|value| (value.re, value.im))).collect()
    }

    /// Creates a response from real and imaginary parts.
    pub fn from_parts(parts: &[Option<(f64, f64)>]) -> Self {
        Self::new(parts.iter().map(|part| part.map(|(re, im)| Complex::new(re, im))).collect())
    }

    /// Number of harmonics at which the response is identified.
    pub fn known(&self) -> usize {
        self.0.iter().flatten().count()
    }

    /// Sets the response at a harmonic to output over input (complex amplitudes in the same unit).
    /// With an output of magnitude `least` or less it becomes `None`.
    pub fn set(&mut self, harmonic: usize, input: Complex<f64>, output: Complex<f64>, least: f64) {
        let quotient = output / input;
        if harmonic >= self.0.len() {
            self.0.resize(harmonic + 1, None);
        }
        self.0[harmonic] = (output.norm() > least && quotient.is_finite()).then_some(quotient);
    }
}

/// Settings of the model-based law.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelBased {
    /// The identified response. Harmonics without one are not changed.
    pub response: Response,
    /// Learning gain: fraction of the inverse applied in a block, above 0 to 1 (1).
    pub gain: f64,
    /// ρ of the regularised inverse `conj(G) / (|G|² + ρ²)`: responses weaker than this are hardly
    /// inverted (1).
    pub regularisation: f64,
}

impl ModelBased {
    /// Adds the correction to the reference. With gain 1, no regularisation and an exact response
    /// it would cancel the error of the cycle.
    pub(crate) fn update(
        &self,
        spectral: &mut Spectral,
        mut error: Vec<f64>,
        reference: &mut [f64],
    ) {
        let floor = self.regularisation.powi(2);
        spectral.shape(&mut error, |harmonic| {
            let inverse = |at: Complex<f64>| self.gain * at.conj() / (at.norm_sqr() + floor);
            self.response.at(harmonic).map_or(Complex::default(), inverse)
        });
        for (value, correction) in reference.iter_mut().zip(&error) {
            *value += correction;
        }
    }
}
