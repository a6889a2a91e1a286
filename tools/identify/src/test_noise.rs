//! Noise for unit tests.

/// Reproducible white noise, uniform between -0.5 and 0.5.
pub(crate) fn noise(seed: u64, rows: usize) -> Vec<f64> {
    let mut state = seed;
    let of = (0..rows).map(|_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 33) as f64 / f64::from(1u32 << 31) - 0.5
    });
    of.collect()
}
