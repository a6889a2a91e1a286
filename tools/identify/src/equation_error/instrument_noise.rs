//! What the noise of the position leaves in the error of the force.

use std::f64::consts::TAU;

use super::block_roles::Block;
use super::model::{Column, Fitted, RegressionModel, Structure};
use super::signals::ForceBalance;
use crate::filter::magnitude;

/// Steps of the integral over frequencies, up to [`BAND`] cut-off frequencies.
const STEPS: usize = 200;
/// Beyond twice the cut-off the low-pass leaves a 256th.
const BAND: f64 = 2.0;
/// A speed below so many standard deviations of its noise is none.
const AT_REST: f64 = 3.0;

impl RegressionModel {
    /// Returns the mean square of the force that noise of the position leaves, over some rows: as
    /// white noise through mass, damping and stiffness, declared or added, and the low-pass. 0
    /// where the noise is not known.
    pub fn noise_square(
        &self,
        structure: &Structure<'_>,
        fitted: &Fitted,
        blocks: &[Block],
    ) -> f64 {
        let amplitude = |column: Column| {
            let declared = self.parameters.iter().position(|own| own.column == column);
            let at = declared.or_else(|| self.place_of(structure, column));
            at.map_or(0.0, |at| fitted.fit.coefficients[at])
        };
        let [mass, damping, stiffness] =
            [Column::Acceleration, Column::Velocity, Column::Position].map(amplitude);
        let response = |w: f64| (stiffness - mass * w * w).powi(2) + (damping * w).powi(2);
        let (mut sum, mut rows) = (0.0, 0usize);
        for block in blocks {
            let balance = &self.balances[block.record];
            let noise = balance.position_noise_in(&block.rows);
            sum += block.rows.len() as f64 * passed(balance, noise, response);
            rows += block.rows.len();
        }
        sum / rows.max(1) as f64
    }

    /// The amplitude of an effect that multiplies what the declared model does not have.
    fn place_of(&self, structure: &Structure<'_>, column: Column) -> Option<usize> {
        let at = structure.effects.iter().position(|own| {
            own.declaration().lifts.map(Column::of) == Some(column) && !self.frees(*own)
        })?;
        let before = structure.effects[..at].iter().map(|own| self.terms_of(*own).len());
        Some(self.parameters.len() + before.sum::<usize>())
    }

    /// Whether the machine stands still in a row, as far as the noise of its position tells: dry
    /// friction then takes any value below its limit, and no model says which.
    pub fn at_rest(&self, block: &Block) -> Vec<bool> {
        let balance = &self.balances[block.record];
        let least = AT_REST * passed(balance, balance.position_noise(), |w| w * w).sqrt();
        let velocity = balance.signals.rows(&balance.signals.velocity);
        velocity[block.rows.clone()].iter().map(|speed| speed.abs() < least).collect()
    }
}

/// Mean square of noise of the position of a standard deviation (m or rad) behind the low-pass and
/// a response, given by its square at an angular frequency (rad/s).
fn passed(balance: &ForceBalance, noise: f64, squared_response: impl Fn(f64) -> f64) -> f64 {
    let density = 2.0 * balance.sampling * noise.powi(2);
    let most = (BAND * balance.cut_off).min(0.499 / balance.sampling);
    let step = most / STEPS as f64;
    let at = |index: usize| {
        let f = (index as f64 + 0.5) * step;
        magnitude(balance.cut_off, 1.0 / balance.sampling, f).powi(2) * squared_response(TAU * f)
    };
    density * step * (0..STEPS).map(at).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equation_error::signals::{CutOff, noise_of, sixth_differences};

    /// Normal values.
    fn noise(count: usize) -> impl Iterator<Item = f64> {
        let mut state = 7u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(99);
            ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        (0..count).map(move |_| (-2.0 * uniform().ln()).sqrt() * (TAU * uniform()).cos())
    }

    #[test]
    fn noise_is_told_from_movement() {
        let wave = |row: usize| 0.3 * (TAU * 5.0 * row as f64 * 1e-3).sin();
        let noisy: Vec<f64> = noise(20_000).enumerate().map(|(i, n)| wave(i) + 1e-6 * n).collect();
        let white_noise = |signal: &[f64]| noise_of(&sixth_differences(signal));
        assert!((white_noise(&noisy) / 1e-6 - 1.0).abs() < 0.05, "{}", white_noise(&noisy));
        assert_eq!(white_noise(&[]), 0.0);
    }

    #[test]
    fn noise_of_the_acceleration_is_what_the_integral_says() {
        let time: Vec<f64> = (0..40_000).map(|row| row as f64 * 1e-3).collect();
        let position: Vec<f64> = noise(40_000).map(|n| 1e-6 * n).collect();
        let limit = CutOff { highest: 40.0, share: 0.1 };
        let balance = ForceBalance::new("", &time, &position, &position, limit).unwrap();
        let mean_square = |of: &[f64]| of.iter().map(|v| v * v).sum::<f64>() / of.len() as f64;
        let rows = |of: &[f64]| mean_square(&balance.signals.rows(of));
        let noise = balance.position_noise();
        let passed = |response: fn(f64) -> f64| passed(&balance, noise, response);
        let acceleration = rows(&balance.signals.acceleration) / passed(|w| w.powi(4));
        let velocity = rows(&balance.signals.velocity) / passed(|w| w * w);
        assert!((acceleration - 1.0).abs() < 0.06, "{acceleration}");
        assert!((velocity - 1.0).abs() < 0.06, "{velocity}");
    }
}
