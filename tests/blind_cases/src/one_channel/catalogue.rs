//! The effects of machines with one channel, by kind.

use super::effect::Entry;
use super::{Kind, listed, unlisted};

/// Entries of a kind, listed or not.
pub fn of_kind(kind: Kind, listed: bool) -> Vec<&'static Entry> {
    let all = if listed { listed::ENTRIES } else { unlisted::ENTRIES };
    all.iter().filter(|entry| entry.site(kind).is_some()).collect()
}

/// The entry of an id for a kind.
pub fn find(id: &str, kind: Kind) -> Option<&'static Entry> {
    of_kind(kind, true).into_iter().chain(of_kind(kind, false)).find(|entry| entry.id == id)
}
