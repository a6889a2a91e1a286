//! Limiting, and a smooth sign function.

/// Limits a value to ± `limit`. Unlike `clamp` it does not panic if the limit is negative or not a
/// number.
pub(super) fn within(value: f64, limit: f64) -> f64 {
    value.max(-limit).min(limit)
}

/// The same, but NaN stays NaN.
pub(super) fn bounded(value: f64, limit: f64) -> f64 {
    if value.is_nan() { value } else { within(value, limit) }
}

/// The sign of a speed, smoothed where its magnitude is below `reversal`: `x (3 - x²) / 2` with `x
/// = speed / reversal`.
pub(super) fn soft_sign(speed: f64, reversal: f64) -> f64 {
    let share = speed / reversal;
    if share.is_nan() {
        return 0.0;
    }
    let share = share.clamp(-1.0, 1.0);
    0.5 * share * (3.0 - share * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smooth_sign_is_continuous_at_zero() {
        assert_eq!(
            [soft_sign(0.0, 0.2), soft_sign(0.2, 0.2), soft_sign(-9.0, 0.2)],
            [0.0, 1.0, -1.0]
        );
        assert!((soft_sign(0.1, 0.2) - 0.6875).abs() < 1e-12);
        assert_eq!([soft_sign(0.0, 0.0), soft_sign(f64::NAN, 1.0)], [0.0, 0.0]);
    }
}
