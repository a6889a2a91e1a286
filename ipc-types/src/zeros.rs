//! The zeros that positions count from.

use serde::{Deserialize, Serialize};

use crate::{AXES, Sample};

/// Zeros of the encoders, as samples carry them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Zeros {
    /// Count of each master at position 0.
    pub master: [i64; AXES],
    /// Count of each slave at position 0.
    pub slave: [i64; AXES],
    /// Axes whose positions are absolute, one bit each.
    pub homed: u8,
    /// Rises with every change; 0 while nothing was ever counted from power-up.
    pub sequence: u64,
}

impl Zeros {
    /// Whether the positions of an axis are absolute.
    pub const fn is_homed(&self, axis: usize) -> bool {
        self.homed & 1 << axis != 0
    }
}

impl From<&Sample> for Zeros {
    fn from(sample: &Sample) -> Self {
        Self {
            master: sample.master_zero,
            slave: sample.slave_zero,
            homed: sample.homed,
            sequence: sample.homing_sequence,
        }
    }
}
