//! Disturbance observer: the part of the motor's voltage that did not accelerate it.
//!
//! With the nominal inertia `J` (V·s² per unit) and the voltage `u` at the motor, `d = u - J v̇` is
//! what friction, hand and line take. It is estimated through a first-order filter,
//! `d̂ = Q (u - c + g J v) - g J v` with `Q = g / (s + g)`, so that no acceleration has to be
//! measured; `c` is the share that friction compensation already supplies (Ohnishi's form).
//!
//! The estimate is added to the law's output. It is limited, and the filter's state is set back to
//! the limit (anti-windup). It acts while the reference moves. At rest it decays, because an
//! estimate of static friction would break the motor loose again and again.

use std::f64::consts::TAU;

use rig::Observer;

use super::feedforward::Slew;
use super::saturation::within;

/// Time in which the observer's output may change by its limit (s).
pub const OBSERVER_SLEW_S: f64 = 0.02;
/// Time constant with which the estimate decays while the reference rests (s).
const FADE_S: f64 = 0.3;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Disturbance {
    /// State of the filter (V); `None` before the first step.
    filtered_v: Option<f64>,
    output: Slew,
}

/// Input of one step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Voltage at the motor less the friction compensation (V).
    pub(super) volts: f64,
    /// Speed of the motor in the axis's coordinates (rad/s or m/s).
    pub(super) velocity: f64,
    /// Whether the reference moves.
    pub(super) moves: bool,
    /// Time since the last step (s).
    pub(super) elapsed_s: f64,
}

impl Disturbance {
    /// Contribution to the output (V), within the limit; `inertia_v` is `J` (V·s²/rad or V·s²/m).
    pub(super) fn step(&mut self, settings: &Observer, inertia_v: f64, seen: &Seen) -> f64 {
        let rate = TAU * settings.cutoff_hz;
        let momentum_v = rate * inertia_v * seen.velocity;
        let filtered_v = self.filtered_v.unwrap_or(momentum_v);
        let share = -(-rate * seen.elapsed_s).exp_m1();
        let next_v = filtered_v + share * (seen.volts + momentum_v - filtered_v);
        let estimate_v = next_v - momentum_v;
        if !estimate_v.is_finite() {
            return f64::NAN;
        }
        let mut bounded_v = within(estimate_v, settings.limit_v);
        if !seen.moves {
            bounded_v *= (-seen.elapsed_s / FADE_S).exp();
        }
        self.filtered_v = Some(bounded_v + momentum_v);
        self.output
            .follow(settings.share * bounded_v, settings.limit_v * seen.elapsed_s / OBSERVER_SLEW_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: Observer = Observer { cutoff_hz: 5.0, share: 1.0, limit_v: 2.0 };
    const STEP_S: f64 = 1e-3;
    const INERTIA_V: f64 = 8e-3;

    /// A mass driven by `volts` against the friction `friction_v`, starting at 1 rad/s.
    fn settled(volts: f64, friction_v: f64, steps: usize) -> f64 {
        let (mut observer, mut velocity, mut output) = (Disturbance::default(), 1.0, 0.0);
        for _ in 0..steps {
            let seen = Seen { volts, velocity, moves: true, elapsed_s: STEP_S };
            output = observer.step(&SETTINGS, INERTIA_V, &seen);
            velocity += (volts - friction_v) / INERTIA_V * STEP_S;
        }
        output
    }

    #[test]
    fn estimates_a_constant_friction_with_the_filters_time_constant() {
        for (volts, friction_v) in [(1.0, 0.7), (0.2, 0.7), (-1.0, 0.4)] {
            let expected = friction_v * (1.0 - (-TAU * 5.0 * 0.05f64).exp());
            let output = settled(volts, friction_v, 50);
            assert!((output - expected).abs() < 0.03, "{output} of {expected}");
            assert!((settled(volts, friction_v, 400) - friction_v).abs() < 0.03);
        }
    }

    #[test]
    fn stays_within_its_limit_and_does_not_wind_up() {
        let mut observer = Disturbance::default();
        let mut step = |volts| {
            observer.step(
                &SETTINGS,
                INERTIA_V,
                &Seen { volts, velocity: 0.0, moves: true, elapsed_s: STEP_S },
            )
        };
        for _ in 0..5000 {
            assert!(step(10.0) <= 2.0);
        }
        let back = (0..).take_while(|_| step(0.0) > 1.0).count();
        assert!(back <= 23, "1/e within 32 ms, without having to unwind: {back} ms");
    }

    #[test]
    fn decays_while_the_reference_rests_and_starts_at_zero() {
        let mut observer = Disturbance::default();
        let seen = Seen { volts: 0.0, velocity: 7.0, moves: true, elapsed_s: STEP_S };
        assert_eq!(observer.step(&SETTINGS, INERTIA_V, &seen), 0.0);
        let stuck = Seen { volts: 1.0, velocity: 0.0, ..seen };
        let moving = (0..500).map(|_| observer.step(&SETTINGS, INERTIA_V, &stuck)).last().unwrap();
        let resting = Seen { volts: 0.0, moves: false, ..stuck };
        let rested =
            (0..2000).map(|_| observer.step(&SETTINGS, INERTIA_V, &resting)).last().unwrap();
        assert!(moving > 0.9 && rested < 1e-3, "{moving} {rested}");
    }
}
