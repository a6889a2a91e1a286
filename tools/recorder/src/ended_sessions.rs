//! The sessions of a recording that have ended.

use ipc_types::{
    Event, PERFORMANCE, Performance, Process, SESSION, SessionOutcome, SessionResult, event_topic,
};
use recording::mcap_read::Recording;

use crate::runs::segment_begun;

/// A session that has ended, with the name of its segment.
#[derive(Debug)]
pub(crate) struct EndedSession {
    pub(crate) result: SessionResult,
    pub(crate) label: String,
    /// Number of the run of a protocol that it belongs to, from 1, in the recording.
    pub(crate) run: usize,
}

impl EndedSession {
    /// Its number in its protocol, from 1.
    pub(crate) const fn number(&self) -> u32 {
        self.result.number
    }

    /// How it ended, in a word.
    pub(crate) fn outcome(&self) -> &'static str {
        SessionOutcome::from_code(self.result.outcome).map_or("unknown", SessionOutcome::text)
    }

    /// Whether it ended so.
    pub(crate) fn is(&self, outcome: SessionOutcome) -> bool {
        self.result.outcome == outcome.code()
    }
}

/// The messages of a topic; none where it was not recorded.
fn messages_of<T: ipc_types::Message>(
    recording: &Recording,
    topic: &str,
) -> anyhow::Result<Vec<T>> {
    let messages = recording.messages_if_any::<T>(topic)?;
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
    let mut sessions: Vec<EndedSession> = Vec::with_capacity(results.len());
    for result in results {
        // Within a run only a session that was interrupted comes again.
        let run = sessions.last().map_or(1, |last| {
            let again = result.number == last.number() && last.is(SessionOutcome::Interrupted);
            last.run + usize::from(result.number <= last.number() && !again)
        });
        sessions.push(EndedSession { label: label(&result), run, result });
    }
    Ok(sessions)
}

/// Every update of the bars, of sessions and of the rests that repeat them, each as it was first
/// shown.
///
/// # Errors
/// Those of reading.
pub(crate) fn bar_updates(recording: &Recording) -> anyhow::Result<Vec<Performance>> {
    let mut updates: Vec<Performance> = Vec::new();
    for message in recording.messages_if_any::<Performance>(PERFORMANCE.topic.name)? {
        let shown = message?.message;
        let of = |shown: &Performance| (shown.begun_ns, shown.update);
        if shown.update > 0 && updates.last().is_none_or(|last| of(last) != of(&shown)) {
            updates.push(shown);
        }
    }
    Ok(updates)
}

/// The events that name segments.
fn segment_labels(recording: &Recording) -> anyhow::Result<Vec<Event>> {
    let Some(topic) = event_topic(Process::Experiment) else { return Ok(Vec::new()) };
    let mut events: Vec<Event> = messages_of(recording, topic.topic.name)?;
    events.retain(|event| segment_begun(event).is_some());
    Ok(events)
}
