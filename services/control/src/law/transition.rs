//! Motion states, and smooth transitions between them.

/// Position, velocity and acceleration of a reference (rad or m, and per s and s²).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    pub(super) position: f64,
    pub(super) velocity: f64,
    pub(super) acceleration: f64,
}

impl Motion {
    pub(super) const fn at_rest(position: f64) -> Self {
        Self { position, velocity: 0.0, acceleration: 0.0 }
    }

    pub(super) const fn is_finite(&self) -> bool {
        self.position.is_finite() && self.velocity.is_finite() && self.acceleration.is_finite()
    }

    /// The state `time_s` later, with constant acceleration.
    pub(super) fn extrapolated(&self, time_s: f64) -> Self {
        Self {
            position: self.position + time_s * (self.velocity + 0.5 * time_s * self.acceleration),
            velocity: self.velocity + time_s * self.acceleration,
            acceleration: self.acceleration,
        }
    }

    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            position: self.position + other.position,
            velocity: self.velocity + other.velocity,
            acceleration: self.acceleration + other.acceleration,
        }
    }

    pub(super) fn minus(&self, other: &Self) -> Self {
        Self {
            position: self.position - other.position,
            velocity: self.velocity - other.velocity,
            acceleration: self.acceleration - other.acceleration,
        }
    }
}

/// Ratio of the peak to the mean speed of a minimum-jerk movement (1): 15/8.
pub(super) const PEAK_OVER_MEAN: f64 = 1.875;

/// Quintic polynomial from a given motion state at time 0 to rest at position zero at `duration_s`.
/// From rest it is the minimum-jerk movement.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Quintic {
    duration_s: f64,
    /// Coefficients of the powers 0 to 5 of `t / duration_s` (rad or m).
    coefficients: [f64; 6],
}

impl Quintic {
    fn new(duration_s: f64, start: &Motion) -> Self {
        let t = duration_s;
        let (p, v, a) = (start.position, start.velocity * t, start.acceleration * t * t);
        let coefficients = [
            p,
            v,
            0.5 * a,
            -10.0 * p - 6.0 * v - 1.5 * a,
            15.0 * p + 8.0 * v + 1.5 * a,
            -6.0 * p - 3.0 * v - 0.5 * a,
        ];
        Self { duration_s, coefficients }
    }

    /// The motion state at `time_s`; `None` once the movement has ended.
    fn at(&self, time_s: f64) -> Option<Motion> {
        let t = self.duration_s;
        let x = time_s / t;
        if x >= 1.0 {
            return None;
        }
        let [c0, c1, c2, c3, c4, c5] = self.coefficients;
        Some(Motion {
            position: c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5)))),
            velocity: (c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / t,
            acceleration: (2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))) / (t * t),
        })
    }
}

/// An offset that starts in a given motion state and decays to zero. Added to a new target, it
/// makes the reference continuous in position and velocity (and in acceleration, unless the initial
/// acceleration is clipped).
///
/// It is the sum of two movements, so that a high speed is not kept over a long distance. `braking`
/// brings the initial velocity to rest within `stop_s`, over the distance that constant
/// deceleration would take (its peak deceleration is 1.5 times the mean). `approach` covers the
/// remaining distance by a minimum-jerk movement. From zero initial acceleration the offset is
/// never faster than its initial speed plus the peak speed of `approach`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Transition {
    begin_ns: u64,
    braking: Quintic,
    approach: Quintic,
    peak_speed: f64,
}

/// Highest initial acceleration of an offset, relative to `speed / stop_s` (1).
const BRAKING_ACCELERATION: f64 = 4.0;

/// Signed displacement while `velocity` (rad/s or m/s) decays to zero within `stop_s` (s): that of
/// constant deceleration (rad or m).
pub(super) fn stopping_displacement(velocity: f64, stop_s: f64) -> f64 {
    0.5 * velocity * stop_s
}

impl Transition {
    /// An offset that brakes within `stop_s` (s) and covers the remaining distance in at least
    /// `ramp_s` (s), at no more than `speed` (rad/s or m/s).
    pub(super) fn new(
        begin_ns: u64,
        offset: &Motion,
        stop_s: f64,
        ramp_s: f64,
        speed: f64,
    ) -> Self {
        let stopping = stopping_displacement(offset.velocity, stop_s);
        // A high initial acceleration would first carry the reference away from the target, so it
        // is clipped. Only the inertia feed-forward sees it, whose slew rate is limited anyway.
        let acceleration_max = BRAKING_ACCELERATION * speed / stop_s;
        let start = Motion {
            position: -stopping,
            velocity: offset.velocity,
            acceleration: offset.acceleration.max(-acceleration_max).min(acceleration_max),
        };
        let remaining = offset.position + stopping;
        let approach_s = ramp_s.max(PEAK_OVER_MEAN * remaining.abs() / speed);
        Self {
            begin_ns,
            braking: Quintic::new(stop_s, &start),
            approach: Quintic::new(approach_s, &Motion::at_rest(remaining)),
            peak_speed: (PEAK_OVER_MEAN * remaining.abs() / approach_s).max(offset.velocity.abs()),
        }
    }

    /// The initial speed or the peak speed of the approach, whichever is larger (rad/s or m/s).
    /// It scales the friction feed-forward; the sum of both may be slightly faster.
    pub(super) const fn peak_speed(&self) -> f64 {
        self.peak_speed
    }

    /// The offset at `time_ns` (CLOCK_MONOTONIC); `None` once it has decayed.
    pub(super) fn at(&self, time_ns: u64) -> Option<Motion> {
        let time_s = time_ns.saturating_sub(self.begin_ns) as f64 * 1e-9;
        match (self.braking.at(time_s), self.approach.at(time_s)) {
            (None, None) => None,
            (braking, approach) => {
                Some(braking.unwrap_or_default().plus(&approach.unwrap_or_default()))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OFFSET: Motion = Motion { position: 0.7, velocity: -2.0, acceleration: 20.0 };

    #[test]
    fn starts_at_the_given_state_and_decays_to_zero() {
        let transition = Transition::new(5, &OFFSET, 0.25, 0.4, 2.0);
        let difference = transition.at(5).unwrap().minus(&OFFSET);
        assert!(difference.position.abs() < 1e-12 && difference.velocity.abs() < 1e-12);
        assert!(difference.acceleration.abs() < 1e-9);
        // Distance of 0.7 - 0.25 rad at no more than 2 rad/s.
        let end_ns = (PEAK_OVER_MEAN * 0.45 / 2.0 * 1e9) as u64;
        let end = transition.at(end_ns - 10).unwrap();
        assert!(
            end.position.abs() < 1e-9 && end.velocity.abs() < 1e-6 && end.acceleration.abs() < 1e-2,
            "{end:?}"
        );
        assert!(transition.at(end_ns + 20).is_none());
    }

    #[test]
    fn velocity_and_acceleration_are_the_derivatives() {
        let transition = Transition::new(0, &OFFSET, 0.25, 0.4, 2.0);
        let step = 1e-4;
        for k in (1..3999u64).filter(|k| !(2498..=2502).contains(k)) {
            let [before, here, after] =
                [k - 1, k, k + 1].map(|k| transition.at(k * 100_000).unwrap());
            assert!(
                ((after.position - before.position) / (2.0 * step) - here.velocity).abs() < 1e-4
            );
            assert!(
                ((after.velocity - before.velocity) / (2.0 * step) - here.acceleration).abs()
                    < 2e-2
            );
        }
    }

    #[test]
    fn from_rest_it_is_minimum_jerk() {
        let transition = Transition::new(0, &Motion::at_rest(1.0), 0.25, 1.0, 9.0);
        let mut peak = 0.0f64;
        for k in 0..1000u64 {
            let x = k as f64 / 1000.0;
            let offset = transition.at(k * 1_000_000).unwrap();
            let expected = 1.0 - x.powi(3) * (10.0 - 15.0 * x + 6.0 * x * x);
            assert!((offset.position - expected).abs() < 1e-12);
            peak = peak.max(offset.velocity.abs());
        }
        assert!(
            (peak - PEAK_OVER_MEAN).abs() < 1e-6
                && (transition.peak_speed() - PEAK_OVER_MEAN).abs() < 1e-12
        );
    }

    #[test]
    fn speed_never_exceeds_the_initial_speed_plus_the_limit() {
        for velocity in [-20.0, -3.0, 0.5, 12.0] {
            for position in [-3.0, 0.0, 1.0] {
                let offset = Motion { position, velocity, acceleration: 0.0 };
                let transition = Transition::new(0, &offset, 0.25, 0.5, 2.0);
                for k in 0..20_000u64 {
                    let speed =
                        transition.at(k * 1_000_000).map_or(0.0, |offset| offset.velocity.abs());
                    assert!(speed <= velocity.abs() + 2.0 + 1e-9, "{speed} of {velocity}");
                }
            }
        }
    }
}
