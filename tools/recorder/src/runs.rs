//! The runs of protocols in a recording, and the segments that were played.

use std::collections::BTreeMap;
use std::ops::Range;

use ipc_types::{Event, EventKind, Process, SAMPLE, Sample};
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use rig::RigFile;
use rig::protocol::{Movement, Protocol};

use crate::recorded_events::recorded_events;

/// A stretch of a recording in which one protocol was run.
#[derive(Clone, Debug)]
pub(crate) struct Stretch<'a> {
    pub(crate) times_ns: Range<u64>,
    /// What happened in it, in the order of time.
    pub(crate) events: Vec<Event>,
    pub(crate) protocol: &'a str,
    pub(crate) protocol_text: &'a str,
    pub(crate) subject: &'a str,
}

/// The runs of a recording, in the order of time; the whole of one in which none was noted.
///
/// # Errors
/// Those of reading.
pub(crate) fn stretches(recording: &Recording) -> anyhow::Result<Vec<Stretch<'_>>> {
    let events = recorded_events(recording, 0..u64::MAX)?;
    let begun_ns = |run: &BTreeMap<String, String>| {
        run.get(key::TIME_NS).and_then(|at_ns| at_ns.parse::<u64>().ok())
    };
    let mut runs: Vec<_> = recording.runs().filter_map(|run| Some((begun_ns(run)?, run))).collect();
    runs.sort_by_key(|(at_ns, _)| *at_ns);
    // The parts of a merged recording tell of the same run.
    runs.dedup_by_key(|(at_ns, _)| *at_ns);
    let ends = runs.iter().skip(1).map(|(at_ns, _)| *at_ns).chain([u64::MAX]);
    let first_ns = match recording.messages_if_any::<Sample>(SAMPLE.topic.name)?.next() {
        Some(sample) => sample?.message.scan_time_ns,
        None => 0,
    };
    let mut found = Vec::new();
    for ((begun_ns, run), next_ns) in runs.iter().zip(ends) {
        let within = || events.iter().filter(|event| (*begun_ns..next_ns).contains(&event.time_ns));
        // A protocol that was refused has no segment; one may have begun before the recording.
        let goes_on = *begun_ns < first_ns && first_ns < next_ns;
        if !goes_on && !within().any(|event| segment_begun(event).is_some()) {
            continue;
        }
        let is_end = |event: &&Event| {
            matches!(
                EventKind::from_code(event.kind),
                Some(EventKind::ProtocolDone | EventKind::ProtocolStopped)
            )
        };
        let end_ns = within().rfind(is_end).map_or(next_ns, |event| event.time_ns + 1);
        let of = |name| run.get(name).map_or_else(|| start(recording, name), String::as_str);
        found.push(Stretch {
            times_ns: *begun_ns..end_ns,
            events: within().filter(|event| event.time_ns < end_ns).copied().collect(),
            protocol: of(key::PROTOCOL),
            protocol_text: of(key::PROTOCOL_FILE),
            subject: of(key::SUBJECT),
        });
    }
    if found.is_empty() {
        found.push(Stretch {
            times_ns: 0..u64::MAX,
            events,
            protocol: "recording",
            protocol_text: "",
            subject: start(recording, key::SUBJECT),
        });
    }
    Ok(found)
}

fn start<'a>(recording: &'a Recording, name: &str) -> &'a str {
    recording.metadata(name).unwrap_or_default()
}

/// The index of the segment that begins, or goes on, with an event.
pub(crate) fn segment_begun(event: &Event) -> Option<u32> {
    let kind = EventKind::from_code(event.kind)?;
    let begins = matches!(kind, EventKind::SegmentStarted | EventKind::ProtocolResumed);
    (begins && event.source == Process::Experiment.code()).then_some(event.segment)
}

/// The segments of a run that ended at `end_ns`, each with its index, the event with which it began
/// and when it ended: with the next one.
pub(crate) fn segments_begun(
    events: &[Event],
    end_ns: u64,
) -> impl Iterator<Item = (u32, &Event, u64)> {
    let begun = || events.iter().filter_map(|event| Some((segment_begun(event)?, event)));
    let ends = begun().skip(1).map(|(_, next)| next.time_ns).chain([end_ns]);
    begun().zip(ends).map(|((index, event), until_ns)| (index, event, until_ns))
}

/// A segment that was played.
#[derive(Clone, Debug)]
pub struct PlayedSegment {
    /// Its name.
    pub label: String,
    /// The axis that moved, or the first of several.
    pub axis: usize,
    /// What was done.
    pub movement: Movement,
    /// When it began and ended (ns, CLOCK_MONOTONIC).
    pub times_ns: Range<u64>,
}

/// The segments that were played in a recording, in the order of time; those of a protocol that
/// this version does not accept are left out.
///
/// # Errors
/// Those of reading.
pub fn played_segments(recording: &Recording, rig: &RigFile) -> anyhow::Result<Vec<PlayedSegment>> {
    let mut played = Vec::new();
    for stretch in stretches(recording)? {
        let Ok(protocol) = Protocol::parse(stretch.protocol_text, "protocol") else { continue };
        let segments = protocol.segments_on(rig);
        let sequence: Vec<_> = protocol.sequence_of(&segments).collect();
        for (index, event, end_ns) in segments_begun(&stretch.events, stretch.times_ns.end) {
            let Some((_, segment)) = sequence.get(index as usize) else { continue };
            played.push(PlayedSegment {
                label: event.text().to_owned(),
                axis: segment.axis,
                movement: segment.movement.clone(),
                times_ns: event.time_ns..end_ns,
            });
        }
    }
    Ok(played)
}
