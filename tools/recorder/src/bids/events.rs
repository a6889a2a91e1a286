//! The events of a run: its segments with their durations, and what happened.

use std::io::Write;
use std::path::Path;

use ipc_types::{Event, EventKind};
use serde_json::{Map, Value, json};

use super::run::Run;
use super::staged::Staged;
use crate::ended_sessions::EndedSession;
use crate::runs::{segment_begun, segments_begun};

/// A row of the table.
pub(super) struct Row<'a> {
    pub(super) at_ns: u64,
    pub(super) until_ns: u64,
    /// Kind of the segment or event.
    what: String,
    event: &'a Event,
    session: Option<&'a EndedSession>,
}

impl Row<'_> {
    /// What it is, with its name or text.
    pub(super) fn in_words(self) -> String {
        match self.event.text() {
            "" => self.what,
            text => format!("{}: {text}", self.what),
        }
    }
}

/// Events that are about the computers, not about the subject or the movement.
const fn is_about_computers(kind: EventKind) -> bool {
    matches!(
        kind,
        EventKind::ProcessStarted
            | EventKind::ProcessEnding
            | EventKind::RecordingStarted
            | EventKind::RecordingStopped
            | EventKind::PageOpened
            | EventKind::PageClosed
            | EventKind::ControlTaken
            | EventKind::ClockMeasured
            | EventKind::FrameDelay
    )
}

/// The rows in the order of time.
pub(super) fn rows<'a>(run: &'a Run<'_>) -> Vec<Row<'a>> {
    let mut rows: Vec<Row<'_>> = Vec::with_capacity(run.events.len());
    for (segment, event, until_ns) in segments_begun(&run.events, run.ended_ns) {
        let (at_ns, kind) = (event.time_ns, run.segment_kinds.get(segment as usize));
        let session = run.sessions.iter().find(|session| {
            let middle_ns = session.result.begun_ns.midpoint(session.result.ended_ns);
            session.result.segment == segment && (at_ns..until_ns).contains(&middle_ns)
        });
        let what =
            kind.map_or_else(|| cell(event.text()).replace(' ', "_"), |kind| (*kind).to_owned());
        rows.push(Row { at_ns, until_ns, what, event, session });
    }
    for event in &run.events {
        let kind = EventKind::from_code(event.kind);
        if segment_begun(event).is_some() || kind.is_some_and(is_about_computers) {
            continue;
        }
        let what = kind.map_or("unknown", EventKind::text).replace(' ', "_");
        let (at_ns, until_ns) = (event.time_ns, event.time_ns);
        rows.push(Row { at_ns, until_ns, what, event, session: None });
    }
    rows.sort_by_key(|row| (row.at_ns, row.event.source, row.event.sequence));
    rows
}

/// Writes table and sidecar, a file without extension; onsets are counted from `zero_ns`.
pub(super) fn write(
    run: &Run<'_>,
    file: &Path,
    zero_ns: u64,
    staged: &mut Staged,
) -> anyhow::Result<()> {
    let rows = rows(run);
    let bars = run.sessions.iter().map(|session| usize::from(session.result.bars)).max();
    let groups: &[&str] = match bars.unwrap_or(0) {
        0 => &[],
        1 => &[""],
        _ => &["_agonist", "_antagonist"],
    };
    let mut header = vec!["onset".to_owned(), "duration".to_owned(), "trial_type".to_owned()];
    header.extend(["text", "session", "outcome"].map(str::to_owned));
    for name in ["value", "target"] {
        header.extend(groups.iter().map(|group| format!("{name}{group}")));
    }
    header.extend(["a", "b", "c"].map(str::to_owned));
    let mut table = staged.create(file.with_extension("tsv"))?;
    writeln!(table, "{}", header.join("\t"))?;
    for row in &rows {
        writeln!(table, "{}", cells(row, groups.len(), zero_ns).join("\t"))?;
    }
    table.flush()?;
    staged.json(file.with_extension("json"), &about(run, &rows, groups))
}

fn cells(row: &Row<'_>, groups: usize, zero_ns: u64) -> Vec<String> {
    let none = || "n/a".to_owned();
    let mut cells = vec![
        format!("{:.9}", Run::seconds(row.at_ns, zero_ns)),
        format!("{:.9}", Run::seconds(row.until_ns, row.at_ns)),
        row.what.clone(),
        cell(row.event.text()),
    ];
    let result = row.session.map(|session| &session.result);
    cells.push(result.map_or_else(none, |result| result.number.to_string()));
    cells.push(row.session.map_or_else(none, |session| session.outcome().to_owned()));
    for group in 0..groups {
        cells.push(result.map_or_else(none, |result| number(result.value[group])));
    }
    for group in 0..groups {
        let target = result.filter(|result| result.number > 1);
        cells.push(target.map_or_else(none, |result| number(result.target[group])));
    }
    cells.extend([row.event.a, row.event.b, row.event.c].map(number));
    cells
}

/// A text as a cell: no tab, and no quotation mark, which readers of tables take for the beginning
/// of a cell that may hold one; `n/a` where it is empty.
pub(super) fn cell(text: &str) -> String {
    match text.replace(|c: char| c.is_control(), " ").replace('"', "'") {
        empty if empty.trim().is_empty() => "n/a".to_owned(),
        text => text,
    }
}

/// A number, with all its digits; `n/a` where it is not finite.
pub(super) fn number(value: f64) -> String {
    if value.is_finite() { value.to_string() } else { "n/a".to_owned() }
}

/// What the columns mean.
fn about(run: &Run<'_>, rows: &[Row<'_>], groups: &[&str]) -> Value {
    let mut levels = Map::new();
    for row in rows {
        let meaning = match segment_begun(row.event) {
            Some(_) => "Segment of the protocol of this kind".to_owned(),
            None => EventKind::from_code(row.event.kind).map_or("", EventKind::about).to_owned(),
        };
        levels.entry(row.what.clone()).or_insert(Value::String(meaning));
    }
    let zero = match run.scan {
        true => {
            "Time since the first stored volume began, or in the folders `motion` and `emg` \
                 since the first sample of the data"
        }
        false => "Time since the first sample",
    };
    let mut about = json!({
        "onset": {"Description": zero, "Units": "s"},
        "duration": {"Description": "Duration of a segment; 0 for an instant", "Units": "s"},
        "trial_type": {
            "Description": "Kind of the segment of the protocol that begins, or of the event",
            "Levels": levels,
        },
        "text": {"Description": "Name of the segment, or text of the event"},
        "session": {"Description": "Number of the session that the segment is, from 1"},
        "outcome": {"Description": "How the session ended: whole, stopped or interrupted"},
        "a": {"Description": "First number of the event; see trial_type"},
        "b": {"Description": "Second number of the event; see trial_type"},
        "c": {"Description": "Third number of the event; see trial_type"},
    });
    for group in groups {
        let of = |what: &str| {
            let whose = group.strip_prefix('_').map_or_else(
                || "mean magnitude of the hand's torque or force (N·m or N)".to_owned(),
                |group| format!("mean activity of the {group}s, in the unit of their channels"),
            );
            json!({"Description": format!("{what}: {whose}")})
        };
        about[format!("value{group}")] = of("What the next session has to match");
        about[format!("target{group}")] = of("What the session had to match");
    }
    about
}
