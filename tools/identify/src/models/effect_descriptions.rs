//! Effects of a transmission in words.

use plant::effects::{LIST, Site};

/// What an effect is, in words.
pub(super) fn words(id: &str) -> &str {
    LIST.iter().find(|entry| entry.id == id).map_or(id, |entry| entry.what)
}

/// An effect's rival of the same name: the records do not tell which of two it is.
pub(super) const OTHER_ENCODER: &str = "the same effect of the other encoder";

/// What a rival of an effect is, in words.
pub(super) fn rival_words((own, at): (&str, Site), (rival, there): (&str, Site)) -> String {
    if own == rival && at == there { OTHER_ENCODER.to_owned() } else { words(rival).to_owned() }
}
