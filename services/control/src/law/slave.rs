//! A loop on the slave around the master's: the master goes where the slave then is where it should
//! be.
//!
//! The line is soft and the slave rubs: while the master follows its reference, the slave stands
//! still at each end until the line is wound up the other way, lags behind by that windup, and
//! moves by the ratio of the pistons. A fast loop on the slave's position cannot help: the line's
//! resonance (8 Hz) and its delay lie between. So most of the way is foreseen, and the rest is
//! learnt slowly:
//!
//! - the master's reference is moved by what the model says that line and ratio take of it, `r/ρ -
//!   r + τ_f(v)/k · sgn(v)`, for the movement as it will be `lead_s` later;
//! - what then remains of the slave's error, filtered below the resonance, moves the reference in
//!   proportion;
//! - and corrects windup and ratio themselves, by how the error goes with the sign of the velocity
//!   and with the position. Friction and ratio that the model has wrong are found so, at any speed
//!   of movement, and at rest nothing is integrated: no hunting.
//!
//! It comes to its effect within [`ENGAGE_S`] of power. The whole stays within a limit and passes
//! through a critically damped filter of second order, whose speed is limited: the master's
//! reference never jumps. Without the slave's position the corrections rest and the error counts as
//! none.

use std::f64::consts::TAU;

use plant::reflected::ReflectedDynamics;
use rig::SlaveLoop;

use super::blend::Motion;
use super::bounds::{bounded, soft_sign, within};

/// Natural frequency of the filter through which the offset goes (Hz).
const SHAPING_HZ: f64 = 12.0;
/// Share of the movement's peak speed within which the windup passes through its change of sign.
const REVERSAL: f64 = 0.15;
/// Slowest speed within which it does (rad/s or m/s), as a share of the axis's speed of catching
/// up.
const LEAST_REVERSAL: f64 = 0.02;
/// The corrections of windup and ratio stay within this share of what the model says.
const CORRECTION: f64 = 0.6;
/// While the movement is slow, as where it turns, offset and movement together may be so many times
/// as fast as the offset alone otherwise.
const FASTEST: f64 = 3.0;
/// Time in which the loop comes to its full effect (s).
const ENGAGE_S: f64 = 1.0;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SlaveOffset {
    /// Offset of the master's reference, as it moves.
    offset: Motion,
    filtered_error: f64,
    /// Corrections of the windup (rad or m) and of the ratio (1).
    windup: f64,
    ratio: f64,
    /// 0 to 1: how far it has come to its effect.
    engaged: f64,
}

/// What the loop sees of a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Where the slave should be, and how it should move.
    pub(super) desired: Motion,
    /// Where it is (rad or m); `None` where that is not measured.
    pub(super) position: Option<f64>,
    /// Peak speed of the movement (rad/s or m/s); 0 where there is none.
    pub(super) peak_speed: f64,
    /// Fastest that the offset may move while the movement is fast (rad/s or m/s).
    pub(super) speed: f64,
    /// Time since the last step (s).
    pub(super) elapsed_s: f64,
}

impl SlaveOffset {
    /// How the master's reference differs from where the slave should be; not finite where a number
    /// is none.
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
        let ahead = desired.after(settings.lead_s);
        let level = settings.windup_share * model.windup.level_v(ahead.velocity) / model.line_v;
        let lengthening = 1.0 / model.ratio - 1.0;

        let now = soft_sign(desired.velocity, reversal);
        let learnt = settings.integral_gain * dt * self.filtered_error;
        self.windup = bounded(self.windup + learnt * now, CORRECTION * level);
        let place = desired.position;
        let by_ratio =
            learnt * now.abs() * place / (place * place + settings.limit * settings.limit);
        self.ratio =
            bounded(self.ratio + if by_ratio.is_nan() { 0.0 } else { by_ratio }, CORRECTION);

        let wanted = (lengthening + self.ratio) * ahead.position
            + (level + self.windup) * soft_sign(ahead.velocity, reversal)
            + settings.proportional_gain * self.filtered_error;
        // By minimum jerk, so that power may come while the slave is far off.
        self.engaged = (self.engaged + dt / ENGAGE_S).min(1.0);
        let x = self.engaged;
        let wanted = x * x * x * (10.0 - x * (15.0 - 6.0 * x)) * wanted;
        let speed = (FASTEST * seen.speed - desired.velocity.abs()).max(seen.speed);
        self.shape(wanted, settings.limit, speed, dt)
    }

    /// The offset on its way to a wanted one.
    fn shape(&mut self, wanted: f64, limit: f64, speed: f64, dt: f64) -> Motion {
        if !wanted.is_finite() {
            return Motion::at_rest(f64::NAN);
        }
        let omega = TAU * SHAPING_HZ;
        let target = within(wanted, limit);
        // Implicit: stable for any period.
        let gain = 1.0 / (1.0 + 2.0 * omega * dt + omega * omega * dt * dt);
        let pulled =
            gain * (self.offset.velocity + omega * omega * dt * (target - self.offset.position));
        let velocity = within(pulled, speed);
        let acceleration = if dt > 0.0 { (velocity - self.offset.velocity) / dt } else { 0.0 };
        let position = self.offset.position + velocity * dt;
        self.offset = Motion { position, velocity, acceleration };
        self.offset
    }
}
