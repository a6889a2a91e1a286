//! Reports of the player other than changes of its state.

use crate::range_finder::Range;

/// Why a protocol was aborted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// No end of travel was found in time.
    NotFound,
    /// Both ends are at the same place.
    Stuck,
    /// A stop was not met within the travel of the search.
    StopNotMet,
    /// The travel between the stops is not that of the rig file.
    OtherTravel,
    /// Acquisition did not take up the zeros.
    NotHomed,
    /// A later segment leaves the range that was found.
    OutOfRange,
    /// A trip, an emergency stop or a disarm removed the power.
    PermissionLost,
    /// The client's lease expired.
    ClientGone,
    /// The process was started again, and the protocol does not go on then.
    Restarted,
    /// A wait for the scanner saw no pulse in time.
    NoScanner,
}

impl Reason {
    /// What happened, and what to do.
    pub const fn text(self) -> &'static str {
        match self {
            Self::NotFound => "no end found within the time limit; allow more volts or time",
            Self::Stuck => "the handle did not move; free it, or allow more volts",
            Self::StopNotMet => {
                "not homed: a stop was not met; check homing.travel_max and the stops"
            }
            Self::OtherTravel => {
                "not homed: the travel is not that of the rig file's stops; check both"
            }
            Self::NotHomed => "not homed: acquisition did not take up the zeros; try again",
            Self::OutOfRange => "a later segment leaves the range found; reduce its movement",
            Self::PermissionLost => "a trip, an emergency stop or a disarm ended the protocol",
            Self::NoScanner => {
                "no pulse of the scanner came in time; check its line and the rig file's [scanner]"
            }
            Self::ClientGone => "its client is gone; `farreach run` must keep running",
            Self::Restarted => {
                "the experiment process was restarted or held up, and the protocol says \
                 after_restart = \"abort\""
            }
        }
    }
}

/// A report of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Notice {
    /// The ends of an axis's travel were found. `narrower`: the range is smaller than the rig's
    /// limits by more than the tolerance.
    Range {
        /// The axis.
        axis: usize,
        /// Its ends.
        range: Range,
        /// Whether the rig's limits are much wider than the range.
        narrower: bool,
    },
    /// A beat of a rhythm.
    Beat {
        /// Where the hand should be (rad or m).
        position: f64,
        /// Number of the beat, from 1.
        number: u32,
    },
}
