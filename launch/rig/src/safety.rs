//! Choices of the laboratory that concern safety.

use crate::checked_toml::{Keys, Section};

/// Choices of the laboratory that concern safety. Each stands in the rig file, and so in every
/// recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Safety {
    /// Who cuts the motor's power when the software fails, where the card does not drop it by
    /// itself; empty where the file does not say. A card without an enable line then never arms.
    pub power_cut_by: String,
    /// What happens without a logger.
    pub without_logger: WithoutLogger,
}

/// What happens while no logger runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WithoutLogger {
    /// The rig goes on; the loss is shown.
    #[default]
    Allow,
    /// `arm` and `enable` are refused; power that is on stays on.
    Block,
    /// The motor loses power.
    Trip,
}

const KEYS: Keys = &[
    (
        "power_cut_by",
        "Who or what cuts the motor's power when the software fails, in words (\"dead man's switch \
         in the subject's left hand\"). Required before a card without an enable line arms.",
    ),
    ("without_logger", "Whether the rig goes on, does not arm, or trips while no logger runs."),
];

impl Safety {
    pub(crate) fn read(section: Section<'_>) -> Self {
        section.document("[safety]", KEYS);
        let words = &[
            ("allow", WithoutLogger::Allow),
            ("block", WithoutLogger::Block),
            ("trip", WithoutLogger::Trip),
        ];
        Self {
            power_cut_by: section.text_or_none("power_cut_by").unwrap_or_default(),
            without_logger: section.word_or("without_logger", words, WithoutLogger::Allow),
        }
    }
}
