//! Numbers held within bounds, and a sign without a step.

/// A value held within ± a limit. Not `clamp`, which panics where the limit is not a number or
/// negative.
pub(super) fn within(value: f64, limit: f64) -> f64 {
    value.max(-limit).min(limit)
}

/// Within ± a limit; what is no number stays none.
pub(super) fn bounded(value: f64, limit: f64) -> f64 {
    if value.is_nan() { value } else { within(value, limit) }
}

/// The sign of a speed, smooth while it is below `reversal`: `x (3 - x²) / 2`.
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
    fn the_sign_passes_through_zero_without_a_step() {
        assert_eq!(
            [soft_sign(0.0, 0.2), soft_sign(0.2, 0.2), soft_sign(-9.0, 0.2)],
            [0.0, 1.0, -1.0]
        );
        assert!((soft_sign(0.1, 0.2) - 0.6875).abs() < 1e-12);
        assert_eq!([soft_sign(0.0, 0.0), soft_sign(f64::NAN, 1.0)], [0.0, 0.0]);
    }
}
