//! Samples thinned to the rows with which a model is simulated beside a machine.

/// Interval of the rows (s). With true parameters the error rises by 5 % at most over steps of 0.5
/// ms in most records, by 30 % in a few; with fitted parameters not at all.
pub const PACE_S: f64 = 2e-3;

/// Samples in a row, for samples each `step_s` (s); 0 where they are further apart.
pub fn samples_in_row(step_s: f64) -> usize {
    (PACE_S / step_s * (1.0 + 1e-6)) as usize
}

/// What was held between samples, by its mean over the `every` samples of a row; `at` gives them.
pub fn held(every: usize, at: impl Fn(usize) -> f64) -> f64 {
    (0..every).map(at).sum::<f64>() / every as f64
}

/// A position at the first sample of a row, by a centred average over `every` samples; `at` gives
/// them by their distance from that one.
pub fn centred(every: usize, at: impl Fn(isize) -> f64) -> f64 {
    if every < 2 {
        return at(0);
    }
    let reach = every as isize / 2;
    // For an even number the two ends have half weight.
    let outer = if every.is_multiple_of(2) { 0.5 } else { 1.0 };
    let inner: f64 = (1 - reach..reach).map(&at).sum();
    (inner + outer * (at(-reach) + at(reach))) / every as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_hold_two_milliseconds() {
        assert_eq!([5e-4, 1e-3, 2e-3, 1e-2].map(samples_in_row), [4, 2, 1, 0]);
    }

    #[test]
    fn an_average_keeps_a_line_and_has_weight_one() {
        for every in 1..9 {
            assert!((centred(every, |at| 3.0 + 0.5 * at as f64) - 3.0).abs() < 1e-12, "{every}");
        }
        assert_eq!(held(4, |at| at as f64), 1.5);
    }
}
