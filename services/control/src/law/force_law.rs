//! Force control (§ 4.2): the machine moves with the hand and renders a force field.
//!
//! The transmission is not back-drivable by hand. The torque that the hand applies is therefore
//! measured, and the motor assists it: `v_m = P₁ v_s + G` (eq. 4.2.2), low-pass filtered into the
//! output by `V = (1 - β) V + β v_m` (eq. 4.2.1). `G` (eq. 4.2.3) has the sign of the torque, not
//! of the movement, and compensates static friction and its fall with speed.
//!
//! A field's torque is added to the hand's: the law drives the sum of both towards zero, so that
//! the hand has to hold against the field.
//!
//! Where the thesis leaves room for interpretation: `β` belongs to a period of 2 ms and is
//! converted so that any rate has the same time constant; `C` is compared with the speed, not the
//! signed velocity; `G` ends at 0 V, where the printed line continues below; and for torques within
//! `torque_threshold_v` the offset grows in proportion to the torque, since the sign of noise would
//! make the motor chatter.

use rig::ForceControl;

use super::within;

/// Magnitude of the offset at a velocity, eq. 4.2.3 (V).
pub fn offset_v(gains: &ForceControl, velocity: f64) -> f64 {
    let speed = velocity.abs();
    if speed < gains.threshold_speed {
        gains.offset_slow_v
    } else {
        (gains.offset_fast_v - gains.offset_slope * (speed - gains.threshold_speed)).max(0.0)
    }
}

/// Steady-state output (V), eq. 4.2.2, for a torque (hand and field, N·m or N) and a velocity
/// (rad/s or m/s).
pub fn settled_v(gains: &ForceControl, torque: f64, velocity: f64) -> f64 {
    let signal_v = gains.volts_per_torque * torque;
    let direction = (signal_v / gains.torque_threshold_v).clamp(-1.0, 1.0);
    // 0/0 if both torque and threshold are 0.
    let direction = if direction.is_nan() { 0.0 } else { direction };
    gains.torque_gain * signal_v + direction * offset_v(gains, velocity)
}

/// The output after `elapsed_s` (V), within ± `limit_v`; NaN if an input is not finite.
pub fn step(
    gains: &ForceControl,
    output_v: f64,
    torque: f64,
    velocity: f64,
    elapsed_s: f64,
    limit_v: f64,
) -> f64 {
    let wanted_v = settled_v(gains, torque, velocity);
    let next_v = output_v + gains.share(elapsed_s) * (wanted_v - output_v);
    if next_v.is_finite() { within(next_v, limit_v) } else { f64::NAN }
}

/// Torque of the soft stops at a position (N·m or N), for an axis that ends at `least` and `most`
/// (rad or m). They never meet ([`ForceControl::end_stop_width`]), so that half of the way between
/// the ends is free.
pub fn end_stop_torque(gains: &ForceControl, position: f64, least: f64, most: f64) -> f64 {
    let width = gains.end_stop_width(least, most);
    let inside = position.max(least + width).min(most - width);
    -gains.end_stop_stiffness * (position - inside)
}
