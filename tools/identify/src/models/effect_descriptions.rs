//! Descriptions of a transmission's effects.

use plant::effects::{Site, entry};

/// Describes an effect.
pub(super) fn words(id: &str) -> &str {
    entry(id).map_or(id, |entry| entry.what)
}

/// Describes an effect that is its own rival: the same one at the other instrument.
pub(super) fn other_instrument(id: &str) -> &str {
    entry(id).and_then(|entry| entry.search.choice).map_or_else(|| words(id), |choice| choice.other)
}

/// Describes a rival of an effect.
pub(super) fn rival_words((own, at): (&str, Site), (rival, there): (&str, Site)) -> String {
    let itself = own == rival && at == there;
    if itself { other_instrument(own).to_owned() } else { words(rival).to_owned() }
}
