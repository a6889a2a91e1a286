//! What came of the movement.

use serde::Serialize;

use crate::outcome::Outcome;

/// What one axis did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Moved {
    pub(crate) axis: usize,
    /// Amplitude of the reference (rad or m).
    pub(crate) amplitude: f64,
    /// Movement of the master per movement of the reference (1).
    pub(crate) master: f64,
    /// Movement of the handle per movement of the reference (1); `None` without its encoder.
    pub(crate) slave: Option<f64>,
    /// Mean of motor voltage times speed of the master (V·rad/s or V·m/s): positive where the
    /// voltage drives the motor.
    pub(crate) drive: f64,
    /// Torque along the movement: at its end by stiffness, at its peak speed by damping, negative
    /// where it opposes (N·m or N); `None` without a sensor.
    pub(crate) torque: Option<f64>,
    /// Noise of that sensor at rest (N·m or N).
    pub(crate) noise: f64,
}

/// The movement was made, and what came of it; kept for the check of the torque.
#[derive(Clone, Debug)]
pub(crate) enum Movement {
    Made(Vec<Moved>),
    Not(Outcome),
}
