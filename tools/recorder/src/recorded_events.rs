//! The events of a recording.

use std::ops::Range;

use ipc_types::{Event, PROCESSES, Process, event_topic};
use recording::mcap_read::{ReadError, Recorded, Recording};

/// The events of all processes in `times` (ns, CLOCK_MONOTONIC), in the order of time.
///
/// # Errors
/// Those of reading.
pub(crate) fn recorded_events(
    recording: &Recording,
    times: Range<u64>,
) -> anyhow::Result<Vec<Event>> {
    let mut found: Vec<Event> = Vec::new();
    for topic in PROCESSES.iter().filter_map(|entry| event_topic(entry.process)) {
        for message in recording.messages_if_any::<Event>(topic.topic.name)? {
            let event = message?.message;
            if times.contains(&event.time_ns) {
                found.push(event);
            }
        }
    }
    found.sort_by_key(|event| event.time_ns);
    found.dedup_by_key(|event| (event.incarnation, event.sequence, event.source));
    Ok(found)
}

/// Goes through the events of one process, in the order of the file. What is damaged is left out:
/// the check of the whole recording tells it.
///
/// # Errors
/// Those of reading.
pub(crate) fn sound_events_of(
    recording: &Recording,
    process: Process,
    mut take: impl FnMut(Recorded<Event>),
) -> anyhow::Result<()> {
    let topic = event_topic(process).map_or("", |topic| topic.topic.name);
    for message in recording.messages_if_any::<Event>(topic)? {
        match message {
            Ok(recorded) => take(recorded),
            Err(ReadError::Damaged { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}
