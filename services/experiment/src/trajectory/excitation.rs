//! Ramps and chirps.

use rig::protocol::{Chirp, Ramp};

use super::Point;

/// Share of the full speed at `x` of the time in which it comes, its slope, and the way until then
/// (full speed and time 1): the minimum-jerk curve, its derivative and its integral.
fn ease(x: f64) -> (f64, f64, f64) {
    let x = x.clamp(0.0, 1.0);
    let value = x * x * x * (10.0 + x * (6.0 * x - 15.0));
    let slope = 30.0 * x * x * (1.0 - x) * (1.0 - x);
    (value, slope, x * x * x * x * (2.5 + x * (x - 3.0)))
}

/// A ramp from rest at `start` (rad or m), `t` after its beginning (s).
pub(super) fn ramp(ramp: &Ramp, start: f64, t: f64) -> Point {
    let profile = ramp.profile(start);
    if t <= 0.0 || profile.speed <= 0.0 {
        return Point::at_rest(if profile.speed > 0.0 { start } else { ramp.position });
    }
    if t >= profile.moving_s {
        return Point::at_rest(ramp.position);
    }
    let (rise, left) = (ramp.ease_s, profile.moving_s - t);
    let direction = (ramp.position - start).signum();
    let (velocity, acceleration, position) = if left < rise {
        // The end is the beginning turned round in time.
        let (value, slope, way) = ease(left / rise);
        (value, -slope / rise, ramp.position - direction * profile.speed * rise * way)
    } else {
        let (value, slope, way) = ease(t / rise);
        let way = rise * way + (t - rise).max(0.0);
        (value, slope / rise, start + direction * profile.speed * way)
    };
    let speed = direction * profile.speed;
    Point {
        position,
        velocity: speed * velocity,
        acceleration: speed * acceleration,
        peak_speed: profile.speed,
    }
}

/// A chirp without its fades, `t` after its beginning (s).
pub(super) fn chirp(chirp: &Chirp, t: f64) -> Point {
    let (phase, omega, rate) = chirp.phase(t);
    let (sin, cos) = phase.sin_cos();
    Point {
        position: chirp.centre + chirp.amplitude * sin,
        velocity: chirp.amplitude * omega * cos,
        acceleration: chirp.amplitude * (rate * cos - omega * omega * sin),
        peak_speed: 0.0,
    }
}
