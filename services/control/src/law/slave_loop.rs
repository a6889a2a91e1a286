//! Outer loop on the slave's position: shifts the master's reference so that the slave follows the
//! movement.
//!
//! The line is compliant and the slave has friction. While the master follows its reference, the
//! slave stands still at each reversal until the line has wound up in the other direction, lags by
//! that windup, and moves by the ratio of the pistons. A fast loop on the slave's position is not
//! possible, because the line's resonance (8 Hz) and its delay lie in between. Most of the offset
//! is therefore feed-forward, and the rest is adapted slowly:
//!
//! - feed-forward: the windup of the line and the ratio according to the model,
//!   `r/ρ - r + τ_f(v)/k · sgn(v)`, for the movement `lead_s` ahead;
//! - proportional feedback of the slave's remaining error, filtered below the resonance;
//! - adaptation of windup, ratio and a constant from the correlation of the error with the sign of
//!   the velocity, with the position and with 1. The first two correct a wrong friction or ratio of
//!   the model at any speed of movement, the constant what a leaking line or a constant load has
//!   shifted. At rest nothing is integrated, so there is no hunting. When power comes the constant
//!   is what lies between master and slave beyond the windup that friction can hold, so that what
//!   a line has leaked is not driven back into it at each start.
//!
//! The offset fades in within [`ENGAGE_S`] of power on. The constant and the rest of it are limited
//! alike, each by itself, and the sum passes through a critically damped second-order filter with
//! limited speed, so that the master's reference never jumps. It is held where it would take the
//! master near its position limits: a handle at its stop cannot follow. Without a measured slave
//! position the error counts as 0, and nothing is adapted.

use std::f64::consts::TAU;

use plant::reflected_dynamics::ReflectedDynamics;
use rig::SlaveLoop;

use super::saturation::{bounded, soft_sign, within};
use super::transition::Motion;

/// Natural frequency of the filter on the offset (Hz).
const SHAPING_HZ: f64 = 12.0;
/// Share of the movement's peak speed below which the windup changes sign smoothly.
const REVERSAL: f64 = 0.15;
/// Lower bound of that speed (rad/s or m/s), as a share of the axis's catch-up speed.
const LEAST_REVERSAL: f64 = 0.02;
/// The adaptations of windup and ratio stay within this share of the model's values.
const CORRECTION: f64 = 0.6;
/// Movement and offset together may reach this multiple of the offset's speed limit, so that the
/// offset moves faster while the movement is slow, as at a reversal.
const FASTEST: f64 = 3.0;
/// Time in which the offset fades in (s).
const ENGAGE_S: f64 = 1.0;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct SlaveOffset {
    /// Offset of the master's reference.
    offset: Motion,
    filtered_error: f64,
    /// Adaptation of the windup (rad or m) and of the ratio (1), and the constant (rad or m).
    windup: f64,
    ratio: f64,
    constant: f64,
    /// Fade-in, 0 to 1.
    engaged: f64,
}

/// Input of one step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Desired motion of the slave.
    pub(super) desired: Motion,
    /// Its measured position (rad or m), if there is one.
    pub(super) position: Option<f64>,
    /// Measured position of the master (rad or m).
    pub(super) master: f64,
    /// Peak speed of the movement (rad/s or m/s); 0 without one.
    pub(super) peak_speed: f64,
    /// Speed limit of the offset while the movement is fast (rad/s or m/s).
    pub(super) speed: f64,
    /// Time since the last step (s).
    pub(super) elapsed_s: f64,
}

impl SlaveOffset {
    /// The offset of the master's reference from the slave's desired motion; not finite if an input
    /// is not.
    pub(super) fn step(
        &mut self,
        settings: &SlaveLoop,
        model: &ReflectedDynamics,
        seen: &Seen,
    ) -> Motion {
        let dt = seen.elapsed_s;
        let desired = &seen.desired;
        let error = seen.position.map_or(0.0, |position| desired.position - position);
        let share = -(-TAU * settings.filter_hz * dt).exp_m1();
        self.filtered_error += share * (error - self.filtered_error);

        let reversal = (REVERSAL * seen.peak_speed).max(LEAST_REVERSAL * seen.speed);
        let ahead = desired.extrapolated(settings.lead_s);
        let level = settings.windup_share * model.windup.level_v(ahead.velocity) / model.line_v;
        let lengthening = 1.0 / model.ratio - 1.0;

        let now = soft_sign(desired.velocity, reversal);
        if self.engaged == 0.0 {
            let rest = model.windup.level_v(0.0) / model.line_v;
            let between = seen.position.map_or(0.0, |slave| seen.master - slave / model.ratio);
            self.constant = bounded(between - bounded(between, rest), settings.limit);
        }
        let learnt = settings.integral_gain * dt * self.filtered_error;
        self.constant = bounded(self.constant + learnt * now.abs(), settings.limit);
        self.windup = bounded(self.windup + learnt * now, CORRECTION * level);
        let place = desired.position;
        let by_ratio =
            learnt * now.abs() * place / (place * place + settings.limit * settings.limit);
        self.ratio =
            bounded(self.ratio + if by_ratio.is_nan() { 0.0 } else { by_ratio }, CORRECTION);

        let wanted = (lengthening + self.ratio) * ahead.position
            + (level + self.windup) * soft_sign(ahead.velocity, reversal)
            + settings.proportional_gain * self.filtered_error;
        // The constant has a limit of its own: an offset of which one side is clipped pushes a
        // leaking line on that side less, and moves it further.
        let wanted = bounded(wanted, settings.limit) + self.constant;
        // Fades in by a minimum-jerk profile, since the slave may be far from its desired position
        // when power comes.
        self.engaged = (self.engaged + dt / ENGAGE_S).min(1.0);
        let x = self.engaged;
        let wanted = x * x * x * (10.0 - x * (15.0 - 6.0 * x)) * wanted;
        let speed = (FASTEST * seen.speed - desired.velocity.abs()).max(seen.speed);
        self.shape(wanted, speed, dt)
    }

    /// The offset of the master's reference, which the loop gives up: it begins anew.
    pub(super) fn take(&mut self) -> Motion {
        std::mem::take(self).offset
    }

    /// Holds the offset where the master's limits end it: it does not wind up beyond.
    pub(super) const fn hold(&mut self, offset: Motion) {
        self.offset = offset;
    }

    /// Filters the offset and limits its speed.
    fn shape(&mut self, wanted: f64, speed: f64, dt: f64) -> Motion {
        if !wanted.is_finite() {
            return Motion::at_rest(f64::NAN);
        }
        let omega = TAU * SHAPING_HZ;
        // Implicit integration: stable for any period.
        let gain = 1.0 / (1.0 + 2.0 * omega * dt + omega * omega * dt * dt);
        let pulled =
            gain * (self.offset.velocity + omega * omega * dt * (wanted - self.offset.position));
        let velocity = within(pulled, speed);
        let acceleration = if dt > 0.0 { (velocity - self.offset.velocity) / dt } else { 0.0 };
        let position = self.offset.position + velocity * dt;
        self.offset = Motion { position, velocity, acceleration };
        self.offset
    }
}
