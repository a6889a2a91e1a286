//! Movements of a protocol, ready to be played.

use rig::protocol::Movement;
use rig::protocol::trajectory::Point;

/// A movement ready to be played: its peak speed is computed once, and evaluating it allocates
/// nothing.
#[derive(Clone, Debug)]
pub struct PreparedMovement {
    /// The movement.
    pub movement: Movement,
    /// Peak speed for the feed-forward (rad/s or m/s).
    peak_speed: f64,
}

impl PreparedMovement {
    /// Prepares a movement.
    pub fn new(movement: Movement) -> Self {
        let peak_speed = movement.feedforward_speed();
        Self { movement, peak_speed }
    }

    /// Whole duration (s).
    pub fn duration_s(&self) -> f64 {
        self.movement.duration_s()
    }

    /// The reference at time `t` (s) into the movement that began at rest at `start` (rad or m).
    /// Before its beginning and after its end it is at rest.
    pub fn at(&self, start: f64, t: f64) -> Point {
        self.movement.at(start, t.clamp(0.0, self.duration_s()), self.peak_speed)
    }
}
