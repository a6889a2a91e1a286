//! Feed-forward of § 4.1, fig. 4.3A.

/// Share of the peak speed below which the friction term changes sign smoothly.
pub const REVERSAL: f64 = 0.1;

/// The triangular friction term (V); it has the sign of `velocity`.
///
/// For a sine movement the magnitude is linear in phase, from `peak_v` at the extremes to `floor_v`
/// at mid-movement: with `|v| = peak_speed · sin φ`, where φ is the phase after the extreme, it is
/// `peak_v - (peak_v - floor_v) · 2 φ / π`. In the figure the sign changes in a single step of 3 V
/// at the extremes, which motor and subject would feel as a jolt. Here it changes smoothly (3s² -
/// 2|s|³) while the speed is below a tenth of its peak, that is within ±5.7° of phase, or 32 ms at
/// 1 Hz. The term then peaks at about 96 % of `peak_v`.
///
/// 0 V without a peak speed, since the phase of the movement is then unknown.
pub fn friction(velocity: f64, peak_speed: f64, peak_v: f64, floor_v: f64) -> f64 {
    let share = velocity.abs() / peak_speed;
    if !share.is_finite() || peak_speed <= 0.0 {
        return 0.0;
    }
    let phase = share.min(1.0).asin() * std::f64::consts::FRAC_2_PI;
    let magnitude = peak_v + (floor_v - peak_v) * phase;
    let s = (share / REVERSAL).min(1.0);
    magnitude * (s * s * (3.0 - 2.0 * s)).copysign(velocity)
}

/// A slew-rate limiter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Slew {
    value: f64,
}

impl Slew {
    pub(super) const fn reset(&mut self) {
        self.value = 0.0;
    }

    pub(super) fn follow(&mut self, wanted: f64, largest_step: f64) -> f64 {
        let largest_step = largest_step.max(0.0);
        self.value += (wanted - self.value).clamp(-largest_step, largest_step);
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangle_over_the_phase_of_a_sine() {
        for degree in 6..=90 {
            let phase = f64::from(degree).to_radians();
            let expected = 1.5 - 1.0 * f64::from(degree) / 90.0;
            for sign in [1.0, -1.0] {
                let volts = friction(sign * 4.0 * phase.sin(), 4.0, 1.5, 0.5);
                assert!(
                    (volts - sign * expected).abs() < 1e-9,
                    "{degree}°: {volts}, expected {expected}"
                );
            }
        }
    }

    #[test]
    fn is_continuous_at_zero_speed() {
        let mut last = friction(-0.5, 4.0, 1.5, 0.5);
        for k in -499..=500 {
            let volts = friction(f64::from(k) * 1e-3, 4.0, 1.5, 0.5);
            assert!((volts - last).abs() < 0.01);
            last = volts;
        }
        assert_eq!(friction(0.0, 4.0, 1.5, 0.5), 0.0);
    }

    #[test]
    fn is_zero_without_a_movement_or_with_invalid_input() {
        for (velocity, peak) in
            [(1.0, 0.0), (1.0, -1.0), (f64::NAN, 1.0), (1.0, f64::NAN), (0.0, 0.0)]
        {
            assert_eq!(friction(velocity, peak, 1.5, 0.5), 0.0);
        }
        assert!(
            (friction(9.0, 4.0, 1.5, 0.5) - 0.5).abs() < 1e-12,
            "above the peak speed: the floor"
        );
    }
}
