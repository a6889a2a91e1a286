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
}

/// The law and its state: the filtered and advanced error of the previous block.
#[derive(Clone, Debug)]
pub(crate) struct PublishedRule {
    law: Published,
    delay_samples: usize,
    previous_error: Option<Vec<f64>>,
}

impl PublishedRule {
    pub(crate) fn new(law: Published, rate_hz: f64) -> Self {
        Self { law, delay_samples: law.delay_samples(rate_hz), previous_error: None }
    }

    /// Updates the reference by the error of one cycle.
    pub(crate) fn update(
        &mut self,
        spectral: &mut Spectral,
        mut error: Vec<f64>,
        reference: &mut [f64],
    ) {
        spectral.low_pass(&mut error, self.law.cutoff_hz);
        advance(&mut error, self.delay_samples);
        for (n, (value, now)) in reference.iter_mut().zip(&error).enumerate() {
            let before = self.previous_error.as_ref().map_or(*now, |error| error[n]);
            *value += self.law.gamma_p * now + self.law.gamma_d * (now - before);
        }
        self.previous_error = Some(error);
    }

    /// The filtered and advanced error of the previous block.
    pub(crate) fn previous_error(&self) -> Option<&Vec<f64>> {
        self.previous_error.as_ref()
    }

    /// Restores the error of the previous block.
    pub(crate) fn restore(&mut self, previous_error: Option<Vec<f64>>) {
        self.previous_error = previous_error;
    }

    /// Discards the error of the previous block.
    pub(crate) fn reset(&mut self) {
        self.previous_error = None;
    }
}
