//! Velocity estimation from positions.

/// First-order low pass of the difference quotient, discretised exactly for the actual spacing of
/// the samples: `v += (1 - exp(-2π f Δt)) (Δx/Δt - v)`. After a skipped cycle Δt is longer, a
/// repeated sample changes nothing, and 500 Hz and 1 kHz give the same time constant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct VelocityEstimate {
    cutoff_hz: f64,
    last: Option<(u64, f64)>,
    velocity: f64,
    weight: Weight,
}

/// The weight of a new difference quotient (1), kept for the spacing that it was computed for:
/// samples come on a grid, and an exponential takes longer than the rest of the estimate.
#[derive(Clone, Copy, Debug, Default)]
struct Weight {
    elapsed_ns: u64,
    value: f64,
}

impl Weight {
    /// The weight for a spacing above 0.
    fn of(&mut self, cutoff_hz: f64, elapsed_ns: u64) -> f64 {
        if elapsed_ns != self.elapsed_ns {
            let elapsed_s = elapsed_ns as f64 * 1e-9;
            let value = -(-std::f64::consts::TAU * cutoff_hz * elapsed_s).exp_m1();
            *self = Self { elapsed_ns, value };
        }
        self.value
    }
}

/// What is kept is no state of the estimate: it follows from spacing and cut-off frequency.
impl PartialEq for Weight {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// After a gap longer than this (s) the difference quotient is no estimate of the present velocity.
const GAP_S: f64 = 0.1;

impl VelocityEstimate {
    pub(super) const fn new(cutoff_hz: f64) -> Self {
        let weight = Weight { elapsed_ns: 0, value: 0.0 };
        Self { cutoff_hz, last: None, velocity: 0.0, weight }
    }

    pub(super) const fn velocity(&self) -> f64 {
        self.velocity
    }

    pub(super) const fn reset(&mut self) {
        self.last = None;
        self.velocity = 0.0;
    }

    /// Updates the estimate with a (finite) position and its scan time, and returns the velocity.
    pub(super) fn update(&mut self, time_ns: u64, position: f64) -> f64 {
        let Some((last_ns, last_position)) = self.last else {
            self.last = Some((time_ns, position));
            return self.velocity;
        };
        let Some(elapsed_ns) = time_ns.checked_sub(last_ns) else {
            // Samples of another acquisition process: start again.
            self.reset();
            self.last = Some((time_ns, position));
            return self.velocity;
        };
        let elapsed_s = elapsed_ns as f64 * 1e-9;
        if elapsed_ns == 0 {
            return self.velocity;
        }
        self.last = Some((time_ns, position));
        if elapsed_s > GAP_S {
            self.velocity = 0.0;
        } else {
            let weight = self.weight.of(self.cutoff_hz, elapsed_ns);
            self.velocity += weight * ((position - last_position) / elapsed_s - self.velocity);
        }
        self.velocity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_settles_with_the_time_constant_at_any_rate() {
        for period_ns in [1_000_000u64, 2_000_000] {
            let mut estimate = VelocityEstimate::new(10.0);
            let mut time = 0;
            while time <= 100_000_000 {
                estimate.update(time, 3.0 * time as f64 * 1e-9);
                let expected =
                    3.0 * (1.0 - (-std::f64::consts::TAU * 10.0 * time as f64 * 1e-9).exp());
                assert!((estimate.velocity() - expected).abs() < 1e-9, "{time}");
                time += period_ns;
            }
        }
    }

    #[test]
    fn what_is_kept_of_the_spacing_before_changes_nothing() {
        let mut kept = VelocityEstimate::new(30.0);
        let (mut time, mut fresh) = (0, kept);
        for step in 0..200u64 {
            time += if step % 5 < 3 { 2_000_000 } else { 500_000 * (1 + step % 7) };
            let position = (step as f64 * 0.7).sin();
            let expected = fresh.update(time, position);
            // As if it had never had another spacing.
            fresh.weight = Weight::default();
            assert_eq!(kept.update(time, position).to_bits(), expected.to_bits());
            assert_eq!(kept, fresh);
        }
    }

    #[test]
    fn skipped_and_repeated_samples_do_not_disturb_a_steady_motion() {
        let mut estimate = VelocityEstimate::new(30.0);
        for tick in (0..400u64).filter(|tick| tick % 7 != 3) {
            for _ in 0..1 + tick % 3 {
                estimate.update(tick * 2_000_000, 2.0 * tick as f64 * 2e-3);
            }
        }
        assert!((estimate.velocity() - 2.0).abs() < 1e-9);
    }

    #[test]
    fn a_gap_or_a_step_back_in_time_resets_the_estimate() {
        let mut estimate = VelocityEstimate::new(30.0);
        estimate.update(1_000_000_000, 0.0);
        estimate.update(1_002_000_000, 1.0);
        assert!(estimate.velocity() > 1.0);
        estimate.update(2_000_000_000, 50.0);
        assert_eq!(estimate.velocity(), 0.0);
        estimate.update(2_002_000_000, 51.0);
        estimate.update(1_000_000_000, 0.0);
        assert_eq!(estimate.velocity(), 0.0);
    }
}
