//! Trajectories: position, velocity and acceleration over time, exact derivatives of each other.
//!
//! Movements join smoothly in acceleration: blends and point-to-point movements follow the
//! minimum-jerk curve `s(τ) = 10 τ³ - 15 τ⁴ + 6 τ⁵` (Flash and Hogan 1985), whose first and second
//! derivatives vanish at both ends. A blend of two positions lies between them, so a movement never
//! leaves the hull of its start and its own range.

/// Peak speed of a minimum-jerk movement over distance and time: `15/8`, at half time.
/// Source: Flash and Hogan, J. Neuroscience 5(7), 1985.
pub const MIN_JERK_PEAK_SPEED: f64 = 1.875;

/// The reference of one axis at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Position (rad or m).
    pub position: f64,
    /// Velocity (rad/s or m/s).
    pub velocity: f64,
    /// Acceleration (rad/s² or m/s²).
    pub acceleration: f64,
    /// Peak speed of the movement, 0 at rest; shapes the friction feed-forward (rad/s or m/s).
    pub peak_speed: f64,
}

impl Point {
    /// At rest.
    pub const fn at_rest(position: f64) -> Self {
        Self { position, velocity: 0.0, acceleration: 0.0, peak_speed: 0.0 }
    }

    /// A sine about 0 with phase 0 at time 0: amplitude (rad or m), frequency (Hz), time (s).
    pub fn sine(amplitude: f64, frequency_hz: f64, time_s: f64) -> Self {
        let omega = std::f64::consts::TAU * frequency_hz;
        let (sine, cosine) = (omega * time_s).sin_cos();
        Self {
            position: amplitude * sine,
            velocity: amplitude * omega * cosine,
            acceleration: -amplitude * omega * omega * sine,
            peak_speed: (amplitude * omega).abs(),
        }
    }

    /// Blends from `self` to `to` with a weight that varies in time.
    #[must_use]
    pub fn blend(self, to: Self, weight: Weight, peak_speed: f64) -> Self {
        let (distance, speed) = (to.position - self.position, to.velocity - self.velocity);
        Self {
            position: self.position + weight.value * distance,
            velocity: self.velocity + weight.rate * distance + weight.value * speed,
            acceleration: self.acceleration
                + weight.curve * distance
                + 2.0 * weight.rate * speed
                + weight.value * (to.acceleration - self.acceleration),
            peak_speed,
        }
    }
}

/// A blending weight from 0 to 1 with its first and second time derivative.
#[derive(Clone, Copy, Debug)]
pub struct Weight {
    value: f64,
    rate: f64,
    curve: f64,
}

impl Weight {
    /// The minimum-jerk curve from 0 at `t = 0` to 1 at `t = duration` (s), constant outside.
    pub fn rising(t: f64, duration: f64) -> Self {
        if t <= 0.0 {
            return Self { value: 0.0, rate: 0.0, curve: 0.0 };
        }
        if t >= duration {
            return Self { value: 1.0, rate: 0.0, curve: 0.0 };
        }
        let x = t / duration;
        Self {
            value: x * x * x * (10.0 + x * (6.0 * x - 15.0)),
            rate: 30.0 * x * x * (1.0 - x) * (1.0 - x) / duration,
            curve: 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (duration * duration),
        }
    }
}

/// A minimum-jerk movement from rest at `from` to rest at `to` (rad or m) within `duration` (s).
pub fn min_jerk(from: f64, to: f64, t: f64, duration: f64) -> Point {
    let peak_speed = min_jerk_peak_speed(from, to, duration);
    Point::at_rest(from).blend(Point::at_rest(to), Weight::rising(t, duration), peak_speed)
}

/// Peak speed of [`min_jerk`] (rad/s or m/s).
pub fn min_jerk_peak_speed(from: f64, to: f64, duration: f64) -> f64 {
    MIN_JERK_PEAK_SPEED * (to - from).abs() / duration
}

/// The reference while a movement is stopped: blends from the movement, which continues
/// underneath, to rest at `hold` within `fade_s`.
pub fn stopping(moving: Point, hold: f64, since_stop_s: f64, fade_s: f64) -> Point {
    moving.blend(Point::at_rest(hold), Weight::rising(since_stop_s, fade_s), moving.peak_speed)
}
