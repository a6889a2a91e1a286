//! Learning through the inverse of the identified response.

use realfft::num_complex::Complex;

use crate::spectral::Spectral;

/// From the master's reference to the slave, at the harmonics of one cycle; `None` where it is not
/// known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Response(Vec<Option<Complex<f64>>>);

impl Response {
    /// Values at harmonic 0 (the mean), 1, 2, ... What is not finite counts as not known.
    pub fn new(values: Vec<Option<Complex<f64>>>) -> Self {
        Self(values.into_iter().map(|value| value.filter(|value| value.is_finite())).collect())
    }

    /// The response at a harmonic.
    pub fn at(&self, harmonic: usize) -> Option<Complex<f64>> {
        self.0.get(harmonic).copied().flatten()
    }

    /// Real and imaginary part at harmonic 0, 1, 2, ...: for keeping.
    pub fn parts(&self) -> Vec<Option<(f64, f64)>> {
        self.0.iter().map(|value| value.map(|value| (value.re, value.im))).collect()
    }

    /// The response of such parts.
    pub fn from_parts(parts: &[Option<(f64, f64)>]) -> Self {
        Self::new(parts.iter().map(|part| part.map(|(re, im)| Complex::new(re, im))).collect())
    }

    /// How many harmonics it is known at.
    pub fn known(&self) -> usize {
        self.0.iter().flatten().count()
    }

    /// Takes down the response at a harmonic: output over input, complex amplitudes in one unit. An
    /// output of `least` or less is too small to tell: the response there stays unknown.
    pub fn learn(
        &mut self,
        harmonic: usize,
        input: Complex<f64>,
        output: Complex<f64>,
        least: f64,
    ) {
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
    /// The response from the master's reference to the slave, identified at the harmonics of the
    /// movement. Where it is not known nothing is learnt.
    pub response: Response,
    /// Share of the inverse that is applied in a block, above 0 to 1 (1).
    pub gain: f64,
    /// ρ of the inverse `conj(G) / (|G|² + ρ²)`: a response weaker than this is not trusted to be
    /// inverted (1).
    pub regularisation: f64,
}

impl ModelBased {
    /// Adds to the reference what takes the error of a cycle to 0, were the plant as its response
    /// says; the error is used up.
    pub(crate) fn learn(
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
