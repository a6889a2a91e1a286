//! What the player reports besides the change of its segments.

use crate::range_finder::Range;

/// Why playing cannot go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The ends of the range were not found in time.
    NotFound,
    /// Both ends are at the same place.
    Stuck,
    /// A later segment goes beyond the range that was found.
    OutOfRange,
    /// A trip, an emergency stop or a disarm took the power away.
    PermissionLost,
    /// The client's lease lapsed.
    ClientGone,
}

impl Reason {
    /// In words: what happened, what to do.
    pub const fn text(self) -> &'static str {
        match self {
            Self::NotFound => "no end found within the time limit; allow more volts or time",
            Self::Stuck => "the handle did not move; free it, or allow more volts",
            Self::OutOfRange => "a later segment leaves the range that was found; move less",
            Self::PermissionLost => "a trip, an emergency stop or a disarm ended the protocol",
            Self::ClientGone => "its client has gone; `farreach run` must stay alive and running",
        }
    }
}

/// What a step reports beside the changes of the protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Notice {
    /// The ends of an axis were found; `narrower`: by more than the tolerance within the rig's
    /// limits.
    Range {
        /// The axis.
        axis: usize,
        /// Its ends.
        range: Range,
        /// Whether the rig's limits are much wider.
        narrower: bool,
    },
    /// The beat of a rhythm: where the hand should be (rad or m), and its number from 1.
    Beat {
        /// Where the hand should be (rad or m).
        position: f64,
        /// Number of the beat, from 1.
        number: u32,
    },
}
