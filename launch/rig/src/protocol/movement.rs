//! The kinds of segment. To add one: a file in `movement/`, and its `mod` and its line here.

use std::ops::{Deref, DerefMut};

use super::segment_kind::SegmentKind;
use super::unit_keys::UnitKeys;
use crate::axis_unit::AxisUnit;
use crate::checked_toml::Section;

mod centre;
mod chirp;
mod csv_trajectory;
mod free;
mod guided_sine;
mod hold;
mod initialise;
mod learn;
mod multisine;
mod ramp;
mod rest;
mod rhythm;
mod steps;
mod wait_for_scanner;

pub(super) use csv_trajectory::embed_tables;
pub use learn::{IDENTIFYING_CYCLES, LearnLaw};

/// Defines [`Movement`] from the list of kinds: the word in the file, the type, its module.
macro_rules! kinds {
    ($($word:literal: $kind:ident in $module:ident),+ $(,)?) => {
        $(pub use $module::$kind;)+

        /// What a segment does, by kind; [`SegmentKind`] has what all kinds share.
        #[derive(Clone, Debug, PartialEq)]
        pub enum Movement {
            $(#[doc = concat!("`kind = \"", $word, "\"`.")] $kind($kind)),+
        }

        impl Movement {
            /// The word for its kind in the file.
            pub const fn kind(&self) -> &'static str {
                match self { $(Self::$kind(_) => $word),+ }
            }

            fn read_kind(word: &str, section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Self {
                match word {
                    $($word => {
                        section.document(concat!("`kind = \"", $word, "\"`"), $module::KEYS);
                        Self::$kind($module::read(section, keys))
                    })+
                    _ => {
                        // Without a valid kind nobody can say which keys are right.
                        section.know_all();
                        Self::Rest(Rest { duration_s: 1.0 })
                    }
                }
            }
        }

        pub(crate) const WORDS: &[(&str, &str)] = &[$(($word, $word)),+];

        impl Deref for Movement {
            type Target = dyn SegmentKind;

            fn deref(&self) -> &Self::Target {
                match self { $(Self::$kind(own) => own),+ }
            }
        }

        impl DerefMut for Movement {
            fn deref_mut(&mut self) -> &mut Self::Target {
                match self { $(Self::$kind(own) => own),+ }
            }
        }
    };
}

kinds! {
    "guided_sine": GuidedSine in guided_sine,
    "multisine": Multisine in multisine,
    "steps": Steps in steps,
    "hold": Hold in hold,
    "rest": Rest in rest,
    "free": Free in free,
    "initialise": Initialise in initialise,
    "centre": Centre in centre,
    "rhythm": Rhythm in rhythm,
    "ramp": Ramp in ramp,
    "chirp": Chirp in chirp,
    "file": CsvTrajectory in csv_trajectory,
    "learn": Learn in learn,
    "wait_for_scanner": WaitForScanner in wait_for_scanner,
}

impl Movement {
    /// Reads the keys of the segment's kind; also returns the unit of its positions.
    pub(super) fn read(section: &Section<'_>) -> (Self, Option<AxisUnit>) {
        let mut keys = UnitKeys { section, unit: None };
        let word = section.word("kind", WORDS).unwrap_or_default();
        let movement = Self::read_kind(word, section, &mut keys);
        (movement, keys.unit)
    }
}
