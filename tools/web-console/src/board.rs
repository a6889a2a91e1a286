//! What all pages are told: newest values, of which a slow page misses the ones between, and a feed
//! of messages that all matter.

use std::sync::Mutex;

use axum::extract::ws::Utf8Bytes;
use serde_json::Value;
use tokio::sync::{broadcast, watch};

/// Messages of the feed that wait for a page; of a slower page the oldest are dropped and counted.
const FEED: usize = 256;

/// A value of which only the newest matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Slot {
    /// State of rig and console, ten times a second.
    State,
    /// What the subject sees.
    Bar,
    /// The segments of the protocol that was built or is played.
    Plan,
    /// Processes, rates and losses.
    Status,
    /// The sessions so far, and their files.
    Sessions,
}

const SLOTS: usize = 5;

/// Newest values and feed.
#[derive(Debug)]
pub(crate) struct Board {
    values: Mutex<[(u64, Utf8Bytes); SLOTS]>,
    changed: watch::Sender<u64>,
    feed: broadcast::Sender<(Audience, Utf8Bytes)>,
}

/// To whom a message of the feed goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Audience {
    /// Operator's pages.
    Operators,
    /// All pages.
    All,
}

/// One page's reading of the board.
#[derive(Debug)]
pub(crate) struct Reader {
    seen: [u64; SLOTS],
    pub(crate) changed: watch::Receiver<u64>,
    pub(crate) feed: broadcast::Receiver<(Audience, Utf8Bytes)>,
}

impl Board {
    pub(crate) fn new() -> Self {
        let empty = || (0, Utf8Bytes::default());
        Self {
            values: Mutex::new([empty(), empty(), empty(), empty(), empty()]),
            changed: watch::Sender::new(0),
            feed: broadcast::Sender::new(FEED),
        }
    }

    /// Sets a value; pages are told where it differs.
    pub(crate) fn set(&self, slot: Slot, value: &Value) {
        let text = value.to_string();
        {
            let mut values = crate::lock(&self.values);
            let (version, old) = &mut values[slot as usize];
            if old.as_str() == text {
                return;
            }
            (*version, *old) = (*version + 1, text.into());
        }
        self.changed.send_modify(|change| *change += 1);
    }

    /// Sends a message to the pages that are open.
    pub(crate) fn tell(&self, audience: Audience, message: &Value) {
        // Without pages nobody listens.
        let _listeners = self.feed.send((audience, message.to_string().into()));
    }

    /// Begins to read: everything is new.
    pub(crate) fn reader(&self) -> Reader {
        Reader { seen: [0; SLOTS], changed: self.changed.subscribe(), feed: self.feed.subscribe() }
    }

    /// The values among `slots` that changed since the reader's last call.
    pub(crate) fn changes(&self, reader: &mut Reader, slots: &[Slot]) -> Vec<Utf8Bytes> {
        let values = crate::lock(&self.values);
        let mut changes = Vec::new();
        for slot in slots {
            let (version, value) = &values[*slot as usize];
            let seen = &mut reader.seen[*slot as usize];
            if *version != *seen {
                *seen = *version;
                changes.push(value.clone());
            }
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_reader_gets_the_newest_value_once() {
        let board = Board::new();
        let mut reader = board.reader();
        assert!(board.changes(&mut reader, &[Slot::State, Slot::Bar]).is_empty());
        board.set(Slot::State, &json!({ "a": 1 }));
        board.set(Slot::State, &json!({ "a": 2 }));
        board.set(Slot::Bar, &json!(3));
        assert_eq!(board.changes(&mut reader, &[Slot::State]), ["{\"a\":2}"]);
        assert!(board.changes(&mut reader, &[Slot::State]).is_empty());
        assert_eq!(board.changes(&mut reader, &[Slot::State, Slot::Bar]), ["3"]);
        // The same again is no news.
        board.set(Slot::Bar, &json!(3));
        assert!(board.changes(&mut reader, &[Slot::Bar]).is_empty());
        // A page that comes later gets what there is.
        assert_eq!(board.changes(&mut board.reader(), &[Slot::Bar, Slot::Plan]), ["3"]);
    }
}
