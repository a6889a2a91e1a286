//! What people noted while a recording was made.

use ipc_types::{Event, EventKind, Process};
use recording::mcap_read::Recording;
use serde::Serialize;

use crate::recorded_events::sound_events_of;

/// Who passes notes on: the logger those of `rec tag`, the console those of its pages.
const SOURCES: [Process; 2] = [Process::Logger, Process::Console];

/// A note.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Note {
    /// Time since the recording began (s).
    t_s: f64,
    /// The process that passed it on.
    source: &'static str,
    /// What it says; of the logger's, the author first.
    text: String,
}

impl Note {
    /// `note at 12.345 s: anna: subject moved the elbow`.
    pub(crate) fn line(&self) -> String {
        format!("note at {:.3} s: {}", self.t_s, self.text)
    }
}

/// The notes in the order of time. A damaged chunk is left out.
///
/// # Errors
/// Those of reading.
pub(crate) fn notes(recording: &Recording) -> anyhow::Result<Vec<Note>> {
    let mut found: Vec<(u64, Note)> = Vec::new();
    let began_ns = recording.began_monotonic_ns();
    for process in SOURCES {
        sound_events_of(recording, process, |recorded| {
            let event: Event = recorded.message;
            if EventKind::from_code(event.kind) == Some(EventKind::Note) {
                let t_s = (event.time_ns as f64 - began_ns as f64) * 1e-9;
                let text = event.text().to_owned();
                found.push((event.time_ns, Note { t_s, source: process.text(), text }));
            }
        })?;
    }
    found.sort_by_key(|(at_ns, _)| *at_ns);
    Ok(found.into_iter().map(|(_, note)| note).collect())
}
