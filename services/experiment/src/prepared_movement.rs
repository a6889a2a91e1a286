//! Movements of a protocol, ready to be played.

use ipc_types::Mode;
use rig::protocol::trajectory::Point;
use rig::protocol::{Field, Movement};

/// A movement ready to be played: its peak speed is computed once, and evaluating it allocates
/// nothing.
#[derive(Clone, Debug)]
pub struct PreparedMovement {
    movement: Movement,
    /// Peak speed for the feed-forward (rad/s or m/s).
    peak_speed: f64,
}

impl PreparedMovement {
    /// Prepares a movement.
    pub fn new(movement: Movement) -> Self {
        let peak_speed = movement.feedforward_speed();
        Self { movement, peak_speed }
    }

    /// The movement.
    pub fn movement(&self) -> &Movement {
        &self.movement
    }

    /// Whole duration (s).
    pub fn duration_s(&self) -> f64 {
        self.movement.duration_s()
    }

    /// Mode of the setpoints at time `t` into the movement (s).
    pub fn mode(&self, t: f64) -> Mode {
        self.movement.mode(t)
    }

    /// The reference at time `t` (s) into the movement that began at rest at `start` (rad or m).
    /// Before its beginning and after its end it is at rest.
    pub fn at(&self, start: f64, t: f64) -> Point {
        self.movement.at(start, t.clamp(0.0, self.duration_s()), self.peak_speed)
    }

    /// The force field, if the hand moves in one.
    pub fn field(&self) -> Option<&Field> {
        self.movement.field()
    }
}
