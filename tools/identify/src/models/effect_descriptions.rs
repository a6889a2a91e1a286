//! Descriptions of a transmission's effects.

use plant::effects::{LIST, Site};

/// Describes an effect.
pub(super) fn words(id: &str) -> &str {
    LIST.iter().find(|entry| entry.id == id).map_or(id, |entry| entry.what)
}

/// Description of a rival with the same id: the other encoder.
pub(super) const OTHER_ENCODER: &str = "the same effect of the other encoder";

/// Describes a rival of an effect.
pub(super) fn rival_words((own, at): (&str, Site), (rival, there): (&str, Site)) -> String {
    if own == rival && at == there { OTHER_ENCODER.to_owned() } else { words(rival).to_owned() }
}
