//! The sessions of a recording that have ended.

use ipc_types::{Event, EventKind, Process, SESSION, SessionResult, event_topic};
use recording::mcap_read::{ReadError, Recording};

/// A session that has ended, with the name of its segment.
#[derive(Debug)]
pub(crate) struct EndedSession {
    pub(crate) result: SessionResult,
    pub(crate) label: String,
}

impl EndedSession {
    /// Its number in its protocol, from 1.
    pub(crate) const fn number(&self) -> u32 {
        self.result.number
    }
}

/// The messages of a topic; none where it was not recorded.
fn messages_of<T: ipc_types::Message>(
    recording: &Recording,
    topic: &str,
) -> anyhow::Result<Vec<T>> {
    let messages = match recording.messages::<T>(topic) {
        Err(ReadError::NoTopic { .. }) => return Ok(Vec::new()),
        messages => messages?,
    };
    messages.map(|message| Ok(message?.message)).collect()
}

/// The sessions that have ended, in the order of their beginnings.
///
/// # Errors
/// Those of reading.
pub(crate) fn ended_sessions(recording: &Recording) -> anyhow::Result<Vec<EndedSession>> {
    let mut results: Vec<SessionResult> = messages_of(recording, SESSION.topic.name)?;
    results.sort_by_key(|result| result.begun_ns);
    results.dedup_by_key(|result| (result.incarnation, result.sequence));
    let labels = segment_labels(recording)?;
    let label = |result: &SessionResult| {
        let names = labels
            .iter()
            .filter(|event| event.segment == result.segment && event.time_ns < result.ended_ns);
        let newest = names.max_by_key(|event| event.time_ns);
        newest.map_or_else(String::new, |event| event.text().to_owned())
    };
    let ended = |result| EndedSession { label: label(&result), result };
    Ok(results.into_iter().map(ended).collect())
}

/// The events that name segments.
fn segment_labels(recording: &Recording) -> anyhow::Result<Vec<Event>> {
    let Some(topic) = event_topic(Process::Experiment) else { return Ok(Vec::new()) };
    let mut events: Vec<Event> = messages_of(recording, topic.topic.name)?;
    events.retain(|event| {
        let kind = EventKind::from_code(event.kind);
        matches!(kind, Some(EventKind::SegmentStarted | EventKind::ProtocolResumed))
    });
    Ok(events)
}
