//! The digital output that tells other instruments when a session begins.

use crate::checked_toml::{Keys, Section, bounds};

/// The digital output that gives a pulse when a session begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SyncOutput {
    /// Digital output of the card, from 0.
    pub output: u32,
    /// Width of the pulse (s).
    pub width_s: f64,
    /// Whether the output is low during the pulse, and high between.
    pub active_low: bool,
}

/// Number of digital outputs that a card may have.
const DIGITAL: u64 = 32;

const KEYS: Keys = &[
    ("output", "Digital output of the card, from 0."),
    ("width_s", "Width of the pulse."),
    ("active", "Whether the output is high or low during the pulse."),
];

impl SyncOutput {
    /// Reads `[sync]`; `None` where the rig has no such output.
    pub(crate) fn read(section: Section<'_>) -> Option<Self> {
        section.document("[sync]", KEYS);
        if !section.exists() {
            return None;
        }
        let advice = "in s; longer than a sample of the instrument that reads it";
        Some(Self {
            output: section.whole("output", 0, DIGITAL - 1, "outputs count from 0") as u32,
            width_s: section.number_or("width_s", 0.01, bounds(0.0005, 1.0, advice)),
            active_low: section.word_or("active", &[("high", false), ("low", true)], false),
        })
    }

    /// Levels of the card's digital outputs, one bit each: during a pulse, or between two.
    pub const fn levels(&self, pulse: bool) -> u32 {
        ((pulse != self.active_low) as u32) << self.output
    }
}
