//! Blind cases of machines with one measured channel: drives, oscillators, elements.
//!
//! Each case is a machine with constants of its own ([`machine`]), a rig file that declares them
//! with tolerances that contain the truth, records as laboratories make them ([`movement`],
//! [`instruments`]), and listed or unlisted effects ([`listed`], [`unlisted`]). The simulator
//! ([`simulator`]) steps at 50 µs or less, friction is solved implicitly, and it shares no code
//! with the model under test. Sizes are drawn such that the effect can be seen ([`visibility`]).

pub mod case;
pub mod catalogue;
pub mod effect;
pub mod instruments;
pub mod listed;
pub mod machine;
pub mod movement;
pub mod simulator;
pub mod unlisted;
pub mod visibility;

use serde::{Deserialize, Serialize};

/// What a rig file calls the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A mass with friction: force in, position out.
    Drive,
    /// Mass, damper and spring: input in, output out.
    Oscillator,
    /// A part under imposed motion: position in, force out.
    Element,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Drive, Self::Oscillator, Self::Element];

    /// Its name in rig files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Drive => "drive",
            Self::Oscillator => "oscillator",
            Self::Element => "element",
        }
    }
}
