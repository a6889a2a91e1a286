//! Force control (§ 4.2): the machine moves with the hand, and lets it feel a force field.
//!
//! The transmission cannot be driven back by hand. The torque that the hand applies is measured,
//! and the motor helps it: `v_m = P₁ v_s + G` (eq. 4.2.2), forgotten into the output as `V = (1 -
//! β) V + β v_m` (eq. 4.2.1). `G` (eq. 4.2.3) has the direction of the torque, not of the movement,
//! and compensates static friction and its fall with speed.
//!
//! A field's torque is added to the hand's: what the law makes small is the sum of both, so that
//! the hand has to hold against the field.
//!
//! Where the print leaves room: `β` belongs to a period of 2 ms, and another rate forgets as much
//! per second; `C` is held against the speed, not the signed velocity; `G` ends at 0 V, where the
//! printed line goes on below; at torques within `torque_threshold_v` the offset grows in
//! proportion, since the sign of noise would throw the motor to and fro, and no torque gives none.

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

/// What the output would settle at (V), eq. 4.2.2: for a torque (hand and field, N·m or N) and a
/// velocity (rad/s or m/s).
pub fn settled_v(gains: &ForceControl, torque: f64, velocity: f64) -> f64 {
    let signal_v = gains.volts_per_torque * torque;
    let direction = (signal_v / gains.torque_threshold_v).clamp(-1.0, 1.0);
    // 0/0 where there is neither torque nor threshold.
    let direction = if direction.is_nan() { 0.0 } else { direction };
    gains.torque_gain * signal_v + direction * offset_v(gains, velocity)
}

/// The output after `elapsed_s` (V), within ± `limit_v`; not finite where an input is not.
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

/// Torque of the soft stops (N·m or N) at a position, for the ends of the axis (rad or m).
pub fn end_stop_torque(gains: &ForceControl, position: f64, least: f64, most: f64) -> f64 {
    let inside = position.max(least + gains.end_stop_way).min(most - gains.end_stop_way);
    -gains.end_stop_stiffness * (position - inside)
}
