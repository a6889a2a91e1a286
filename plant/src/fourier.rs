//! Plans of Fourier transforms of real signals.
//!
//! They are made here for all crates: the library's transforms are generic, so each crate that
//! plans them by itself would compile all of them once more.

use std::fmt;
use std::sync::Arc;

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

/// Makes transforms, and keeps them for signals of the same length.
pub struct Planner(RealFftPlanner<f64>);

impl Planner {
    /// A planner without any plan.
    #[allow(clippy::new_without_default, reason = "nobody needs the trait")]
    pub fn new() -> Self {
        Self(RealFftPlanner::new())
    }

    /// The transform from `samples` values to `samples / 2 + 1` frequencies, not scaled.
    pub fn forward(&mut self, samples: usize) -> Arc<dyn RealToComplex<f64>> {
        self.0.plan_fft_forward(samples)
    }

    /// The transform from `samples / 2 + 1` frequencies back to `samples` values, not scaled.
    pub fn inverse(&mut self, samples: usize) -> Arc<dyn ComplexToReal<f64>> {
        self.0.plan_fft_inverse(samples)
    }
}

impl fmt::Debug for Planner {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Planner").finish_non_exhaustive()
    }
}
