//! The published learning law.

use crate::spectral::{Spectral, advance};

/// Eq. 4.3.2 and 4.3.3. The thesis prints the delay; gains and cut-off are "kept low" and "selected
/// heuristically".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published {
    /// γ_p, change of the reference per error (1).
    pub gamma_p: f64,
    /// γ_d, change of the reference per change of the error since the previous block (1): the
    /// differences in the thesis's proof (eq. 4.3.11) are between blocks.
    pub gamma_d: f64,
    /// Cut-off of the low pass on the error (Hz).
    pub cutoff_hz: f64,
    /// The transmission's delay (s): 30 ms in § 4.3, `N_d` = 60 samples at 2 kHz.
    pub delay_s: f64,
}

impl Published {
    /// `N_d`: the delay in samples at `rate_hz` (Hz), rounded.
    pub fn delay_samples(&self, rate_hz: f64) -> usize {
        (self.delay_s * rate_hz).round().max(0.0) as usize
    }

    /// Filters and advances the error of one cycle.
    pub(crate) fn low_pass_and_advance(
        &self,
        spectral: &mut Spectral,
        rate_hz: f64,
        error: &mut [f64],
    ) {
        spectral.low_pass(error, self.cutoff_hz);
        advance(error, self.delay_samples(rate_hz));
    }

    /// Updates the reference by the filtered and advanced error of this block and of the previous
    /// one.
    pub(crate) fn update(&self, error: &[f64], previous: Option<&[f64]>, reference: &mut [f64]) {
        for (n, (value, now)) in reference.iter_mut().zip(error).enumerate() {
            let before = previous.map_or(*now, |error| error[n]);
            *value += self.gamma_p * now + self.gamma_d * (now - before);
        }
    }
}
