//! A linear system of second order with dead time, fitted to a measured response (the "frequency
//! response method" of § 3.3.1 and § 3.3.4, whose results are eq. 3.3.1 and 3.3.2).
//!
//! `H(s) = (b₁ s + b₀)/(s² + a₁ s + a₀) e^{-s T}`. The start is linear: for a given dead time, `H`
//! times its denominator is linear in the coefficients; iterated with the weight of the last
//! denominator, the fit does not favour high frequencies (Sanathanan and Koerner, IEEE Trans.
//! Autom. Control 8, 1963). Levenberg-Marquardt from several dead times then minimises the squared
//! complex error.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{Complex, DMatrix, DVector, Dyn, Owned, SVector, U5};

use super::Response;

/// Dead times from which the search starts, s.
const DEAD_TIMES_S: [f64; 6] = [0.0, 2e-3, 5e-3, 10e-3, 20e-3, 40e-3];
/// Repetitions of the weighted linear fit.
const REPETITIONS: usize = 12;

/// `(b₁ s + b₀)/(s² + a₁ s + a₀) e^{-s T}`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearSystem {
    /// `[b₀, b₁]`, 1/s² and 1/s.
    pub numerator: [f64; 2],
    /// `[a₀, a₁]`, 1/s² and 1/s; that of `s²` is 1.
    pub denominator: [f64; 2],
    /// Dead time `T`, s.
    pub dead_time_s: f64,
}

/// A response could not be fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FitError {
    /// Fewer points than coefficients.
    #[error("a linear fit has 5 coefficients: give at least 5 frequencies, not {0}")]
    TooFew(usize),
    /// A frequency, gain or phase is not finite, or a frequency is not positive.
    #[error("point {0} of the response is no number, or its frequency is not positive")]
    NotFinite(usize),
    /// No start converged.
    #[error("no linear system of second order comes near this response")]
    NotFound,
}

impl LinearSystem {
    /// Eq. 3.3.1: 10 m of hose.
    pub const TEN_METRES: Self =
        Self { numerator: [1000.0, 7.0], denominator: [1300.0, 7.0], dead_time_s: 0.012 };
    /// Eq. 3.3.2: 1 m of hose.
    pub const ONE_METRE: Self =
        Self { numerator: [8.0e4, 0.0], denominator: [95_500.0, 18.0], dead_time_s: 0.0 };

    /// `H(j 2π f)`.
    pub fn at(&self, frequency_hz: f64) -> Complex<f64> {
        let s = Complex::new(0.0, std::f64::consts::TAU * frequency_hz);
        (s * self.numerator[1] + self.numerator[0])
            / (s * s + s * self.denominator[1] + self.denominator[0])
            * (-s * self.dead_time_s).exp()
    }

    /// Magnitude.
    pub fn gain(&self, frequency_hz: f64) -> f64 {
        self.at(frequency_hz).norm()
    }

    /// Phase, rad, not wrapped between `0` and a few turns of lag: the dead time's share is added
    /// unwrapped.
    pub fn phase_rad(&self, frequency_hz: f64) -> f64 {
        let without = Self { dead_time_s: 0.0, ..*self };
        without.at(frequency_hz).arg() - std::f64::consts::TAU * frequency_hz * self.dead_time_s
    }

    /// Phase lag as a time, s.
    pub fn lag_s(&self, frequency_hz: f64) -> f64 {
        -self.phase_rad(frequency_hz) / (std::f64::consts::TAU * frequency_hz)
    }

    /// Static gain, `b₀/a₀`.
    pub fn low_frequency_gain(&self) -> f64 {
        self.numerator[0] / self.denominator[0]
    }

    /// Undamped natural frequency `√a₀/2π`, Hz; NaN for a system without one.
    pub fn natural_frequency_hz(&self) -> f64 {
        self.denominator[0].sqrt() / std::f64::consts::TAU
    }

    /// Damping ratio `a₁/(2 √a₀)`.
    pub fn damping_ratio(&self) -> f64 {
        0.5 * self.denominator[1] / self.denominator[0].sqrt()
    }

    /// Fits responses, every frequency alike (least squares of the complex error).
    ///
    /// # Errors
    /// [`FitError`].
    pub fn fit(responses: &[Response]) -> Result<Self, FitError> {
        if responses.len() < 5 {
            return Err(FitError::TooFew(responses.len()));
        }
        let finite = |point: &Response| {
            point.frequency_hz > 0.0
                && [point.frequency_hz, point.gain, point.phase_rad].iter().all(|x| x.is_finite())
        };
        if let Some(index) = responses.iter().position(|point| !finite(point)) {
            return Err(FitError::NotFinite(index));
        }
        let values: Vec<_> = responses
            .iter()
            .map(|point| Complex::from_polar(point.gain, point.phase_rad))
            .collect();
        let peak = responses
            .iter()
            .fold(responses[0], |best, point| if point.gain > best.gain { *point } else { best });
        // In units of the peak's angular frequency all coefficients are of the order of one.
        let scale = std::f64::consts::TAU * peak.frequency_hz;
        let grid: Vec<_> = responses
            .iter()
            .map(|point| std::f64::consts::TAU * point.frequency_hz / scale)
            .collect();
        let mut best: Option<(f64, SVector<f64, 5>)> = None;
        for dead_time in DEAD_TIMES_S {
            let Some(start) = linear_start(&grid, &values, dead_time * scale) else { continue };
            let problem = Problem { grid: &grid, values: &values, x: start };
            let (found, report) = LevenbergMarquardt::new().minimize(problem);
            let cost = report.objective_function;
            let stable = found.x[2] > 0.0 && found.x[3] >= 0.0 && found.x[4] >= 0.0;
            if stable && cost.is_finite() && best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, found.x));
            }
        }
        let (_, x) = best.ok_or(FitError::NotFound)?;
        Ok(Self {
            numerator: [x[0] * scale * scale, x[1] * scale],
            denominator: [x[2] * scale * scale, x[3] * scale],
            dead_time_s: x[4] / scale,
        })
    }
}

/// Coefficients `b₀, b₁, a₀, a₁` for a given dead time, by repeated weighted linear least squares.
fn linear_start(grid: &[f64], values: &[Complex<f64>], dead_time: f64) -> Option<SVector<f64, 5>> {
    let mut weights = vec![1.0; grid.len()];
    let mut x = None;
    for _ in 0..REPETITIONS {
        let mut rows = DMatrix::zeros(2 * grid.len(), 4);
        let mut right = DVector::zeros(2 * grid.len());
        for (index, ((&omega, &value), &weight)) in
            grid.iter().zip(values).zip(&weights).enumerate()
        {
            // (b₀ + b₁ s) - y (a₀ + a₁ s) = y s², with y the response less its dead time.
            let y = value * Complex::new(0.0, omega * dead_time).exp();
            let s = Complex::new(0.0, omega);
            let columns = [Complex::new(1.0, 0.0), s, -y, -y * s];
            for (column, entry) in columns.into_iter().enumerate() {
                rows[(2 * index, column)] = weight * entry.re;
                rows[(2 * index + 1, column)] = weight * entry.im;
            }
            let entry = y * s * s;
            right[2 * index] = weight * entry.re;
            right[2 * index + 1] = weight * entry.im;
        }
        let solution = rows.svd(true, true).solve(&right, 1e-12).ok()?;
        for (weight, &omega) in weights.iter_mut().zip(grid) {
            let s = Complex::new(0.0, omega);
            *weight = 1.0 / (s * s + s * solution[3] + solution[2]).norm().max(1e-6);
        }
        x = Some(SVector::<f64, 5>::new(
            solution[0],
            solution[1],
            solution[2],
            solution[3],
            dead_time,
        ));
    }
    x
}

/// The least-squares problem in scaled units; residuals are real and imaginary parts in turn.
struct Problem<'a> {
    grid: &'a [f64],
    values: &'a [Complex<f64>],
    x: SVector<f64, 5>,
}

impl LeastSquaresProblem<f64, Dyn, U5> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, U5>;
    type ParameterStorage = Owned<f64, U5>;

    fn set_params(&mut self, x: &SVector<f64, 5>) {
        self.x = *x;
    }

    fn params(&self) -> SVector<f64, 5> {
        self.x
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let mut residuals = DVector::zeros(2 * self.grid.len());
        for (index, (&omega, &value)) in self.grid.iter().zip(self.values).enumerate() {
            let error = self.terms(omega)[0] - value;
            residuals[2 * index] = error.re;
            residuals[2 * index + 1] = error.im;
        }
        Some(residuals)
    }

    fn jacobian(&self) -> Option<nalgebra::Matrix<f64, Dyn, U5, Self::JacobianStorage>> {
        let mut jacobian = nalgebra::OMatrix::<f64, Dyn, U5>::zeros(2 * self.grid.len());
        for (index, &omega) in self.grid.iter().enumerate() {
            for (column, entry) in self.terms(omega)[1..].iter().enumerate() {
                jacobian[(2 * index, column)] = entry.re;
                jacobian[(2 * index + 1, column)] = entry.im;
            }
        }
        Some(jacobian)
    }
}

impl Problem<'_> {
    /// The response at `s = jω`, and its derivatives by `b₀, b₁, a₀, a₁, T`.
    fn terms(&self, omega: f64) -> [Complex<f64>; 6] {
        let [b0, b1, a0, a1, dead_time] = self.x.into();
        let s = Complex::new(0.0, omega);
        let below = s * s + s * a1 + a0;
        let late = (-s * dead_time).exp() / below;
        let response = (s * b1 + b0) * late;
        [response, late, s * late, -response / below, -response * s / below, -s * response]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampled(system: LinearSystem, to_hz: f64) -> Vec<Response> {
        (1..=60)
            .map(|index| {
                let frequency_hz = to_hz * f64::from(index) / 60.0;
                let value = system.at(frequency_hz);
                Response {
                    frequency_hz,
                    gain: value.norm(),
                    phase_rad: value.arg(),
                    efficiency: 0.0,
                }
            })
            .collect()
    }

    #[test]
    fn finds_the_printed_systems_again() {
        for (system, to_hz) in [(LinearSystem::TEN_METRES, 24.0), (LinearSystem::ONE_METRE, 120.0)]
        {
            let found = LinearSystem::fit(&sampled(system, to_hz)).unwrap();
            for (found, truth) in [
                (found.numerator[0], system.numerator[0]),
                (found.denominator[0], system.denominator[0]),
                (found.denominator[1], system.denominator[1]),
            ] {
                assert!((found / truth - 1.0).abs() < 1e-6, "{found} {truth}");
            }
            assert!((found.numerator[1] - system.numerator[1]).abs() < 1e-4, "{found:?}");
            assert!((found.dead_time_s - system.dead_time_s).abs() < 1e-8, "{found:?}");
            let square = |point: &Response| {
                let measured = Complex::from_polar(point.gain, point.phase_rad);
                (found.at(point.frequency_hz) - measured).norm_sqr()
            };
            let points = sampled(system, to_hz);
            let mean = points.iter().map(square).sum::<f64>() / points.len() as f64;
            assert!(mean.sqrt() < 1e-8);
        }
    }

    #[test]
    fn known_values_of_the_printed_systems() {
        let (ten, one) = (LinearSystem::TEN_METRES, LinearSystem::ONE_METRE);
        assert!((ten.low_frequency_gain() - 0.769).abs() < 5e-4);
        assert!((ten.lag_s(1.0) - 0.0106).abs() < 5e-5, "{}", ten.lag_s(1.0));
        assert!((one.natural_frequency_hz() - 49.18).abs() < 5e-3);
    }

    #[test]
    fn a_noisy_response_gives_a_near_system() {
        let truth = LinearSystem::TEN_METRES;
        let mut points = sampled(truth, 24.0);
        for (index, point) in points.iter_mut().enumerate() {
            let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
            point.gain += 0.01 * sign;
            point.phase_rad += 0.01 * sign;
        }
        let found = LinearSystem::fit(&points).unwrap();
        assert!(
            (found.natural_frequency_hz() / truth.natural_frequency_hz() - 1.0).abs() < 0.02,
            "{found:?}"
        );
        assert!((found.dead_time_s - truth.dead_time_s).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn errors_give_the_reason() {
        let points = sampled(LinearSystem::ONE_METRE, 100.0);
        assert_eq!(LinearSystem::fit(&points[..4]), Err(FitError::TooFew(4)));
        let mut broken = points;
        broken[7].gain = f64::NAN;
        assert_eq!(LinearSystem::fit(&broken), Err(FitError::NotFinite(7)));
    }
}
