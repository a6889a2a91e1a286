//! The published learning law.

use crate::spectral::{Spectral, advance};

/// Eq. 4.3.2 and 4.3.3. The thesis prints the delay; gains and cut-off are "kept low" and "selected
/// heuristically".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published {
    /// γ_p, change of the reference per error (1).
    pub gamma_p: f64,
    /// γ_d, change of the reference per change of the error since the block before (1): the
    /// differences of the thesis's proof (eq. 4.3.11) are between blocks.
    pub gamma_d: f64,
    /// Cut-off of the low pass on the error (Hz).
    pub cutoff_hz: f64,
    /// The transmission's delay (s): 30 ms in § 4.3, `N_d` = 60 samples at 2 kHz.
    pub delay_s: f64,
}

impl Published {
    /// `N_d`: the delay in samples of a loop at `rate_hz` (Hz), rounded.
    pub fn delay_samples(&self, rate_hz: f64) -> usize {
        (self.delay_s * rate_hz).round().max(0.0) as usize
    }
}

/// The law with what it remembers: the filtered and shifted error of the block before.
#[derive(Clone, Debug)]
pub(crate) struct PublishedRule {
    law: Published,
    delay_samples: usize,
    before: Option<Vec<f64>>,
}

impl PublishedRule {
    pub(crate) fn new(law: Published, rate_hz: f64) -> Self {
        Self { law, delay_samples: law.delay_samples(rate_hz), before: None }
    }

    /// Learns from one cycle's error, which is used up.
    pub(crate) fn learn(
        &mut self,
        spectral: &mut Spectral,
        mut error: Vec<f64>,
        reference: &mut [f64],
    ) {
        spectral.low_pass(&mut error, self.law.cutoff_hz);
        advance(&mut error, self.delay_samples);
        for (n, (value, now)) in reference.iter_mut().zip(&error).enumerate() {
            let before = self.before.as_ref().map_or(*now, |before| before[n]);
            *value += self.law.gamma_p * now + self.law.gamma_d * (now - before);
        }
        self.before = Some(error);
    }

    /// The filtered and shifted error of the block before.
    pub(crate) fn before(&self) -> Option<&Vec<f64>> {
        self.before.as_ref()
    }

    /// Takes that of an earlier run for it.
    pub(crate) fn remember(&mut self, before: Option<Vec<f64>>) {
        self.before = before;
    }

    /// Forgets the block before: nothing can be compared with it.
    pub(crate) fn forget(&mut self) {
        self.before = None;
    }
}
