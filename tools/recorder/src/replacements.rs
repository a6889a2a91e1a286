//! Processes in whose place programs of others ran while a recording was made.

use std::collections::BTreeMap;

use ipc_types::{Event, EventKind, Process};
use recording::mcap_edit::EDIT_RECORD;
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use recording::replaced::{Replaced, event_text, in_words};
use serde::Serialize;

use crate::recorded_events::sound_events_of;

/// A program of others in place of a process.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Replacement {
    /// The process.
    process: String,
    /// Program and arguments; of one that came later, as far as an event holds them.
    command: String,
    /// Since when (s since the recording began); `null` where it ran from the start.
    from_s: Option<f64>,
    /// Until when (s since the recording began); `null` where it ran to the end.
    until_s: Option<f64>,
}

impl Replacement {
    /// `replaced: control: /usr/bin/python3 control.py (from the start to 12.300 s)`.
    fn line(&self) -> String {
        let Self { process, command, from_s, until_s } = self;
        let from = from_s.map_or_else(|| "the start".to_owned(), |from_s| format!("{from_s:.3} s"));
        let until = until_s.map_or_else(String::new, |until_s| format!(" to {until_s:.3} s"));
        format!("replaced: {process}: {command} (from {from}{until})")
    }
}

/// What a recording says of them.
#[derive(Debug, Default)]
pub(crate) struct Replacements {
    /// In the order in which they came.
    pub(crate) processes: Vec<Replacement>,
    /// Why the recording does not know what ran when it began. `None` where it knows, and for
    /// recordings of older builds, which say nothing.
    pub(crate) not_known: Option<String>,
}

impl Replacements {
    /// Reads them.
    ///
    /// # Errors
    /// Those of reading; a damaged chunk is none.
    pub(crate) fn read(recording: &Recording) -> anyhow::Result<Self> {
        Self::before(recording, u64::MAX)
    }

    /// Those before a log time (ns since 1970).
    fn before(recording: &Recording, end_ns: u64) -> anyhow::Result<Self> {
        let mut found = Self::default();
        match at_the_start(recording).map(Replaced::of_text) {
            None => {}
            Some(Replaced::Unknown(reason)) => found.not_known = Some(reason),
            Some(Replaced::Known(commands)) => {
                for (process, command) in commands {
                    found.begin(&process, &in_words(&command), None);
                }
            }
        }
        let began_ns = recording.began_monotonic_ns();
        sound_events_of(recording, Process::Logger, |recorded| {
            if recorded.log_time_ns < end_ns {
                let t_s = (recorded.message.time_ns as f64 - began_ns as f64) * 1e-9;
                found.see(&recorded.message, t_s);
            }
        })?;
        Ok(found)
    }

    /// Takes an event of the logger at a time since the recording began (s).
    fn see(&mut self, event: &Event, t_s: f64) {
        let text = event.text();
        match EventKind::from_code(event.kind) {
            Some(EventKind::ProcessReplaced) => {
                let (process, command) = text.split_once(": ").unwrap_or((text, ""));
                // A logger that goes on with a recording may tell it once more.
                let known = self.running(process).map(|own| event_text(process, &own.command));
                if known.as_deref() != Some(text) {
                    self.end(process, t_s);
                    self.begin(process, command, Some(t_s));
                }
            }
            Some(EventKind::ProcessRestored) => self.end(text, t_s),
            _ => {}
        }
    }

    /// What runs in place of a process by what was seen so far.
    fn running(&mut self, process: &str) -> Option<&mut Replacement> {
        self.processes.iter_mut().find(|own| own.process == process && own.until_s.is_none())
    }

    fn begin(&mut self, process: &str, command: &str, from_s: Option<f64>) {
        let (process, command) = (process.to_owned(), command.to_owned());
        self.processes.push(Replacement { process, command, from_s, until_s: None });
    }

    fn end(&mut self, process: &str, t_s: f64) {
        if let Some(own) = self.running(process) {
            own.until_s = Some(t_s);
        }
    }

    /// The names of the processes, each with since when and until when (s since the recording
    /// began).
    pub(crate) fn spans(&self) -> impl Iterator<Item = (&str, f64, f64)> {
        self.processes.iter().map(|own| {
            let from_s = own.from_s.unwrap_or(f64::NEG_INFINITY);
            (own.process.as_str(), from_s, own.until_s.unwrap_or(f64::INFINITY))
        })
    }

    /// A line of text each; none where all ran farreach's own programs.
    pub(crate) fn lines(&self) -> Vec<String> {
        let reason = self.not_known.iter().map(|reason| format!("replaced: not known: {reason}"));
        reason.chain(self.processes.iter().map(Replacement::line)).collect()
    }
}

/// What a recording says of processes in whose place programs of others ran, a line each; empty
/// where there were none, or the recording is of an older build.
///
/// # Errors
/// Those of reading.
pub fn replaced_lines(recording: &Recording) -> anyhow::Result<Vec<String>> {
    Ok(Replacements::read(recording)?.lines())
}

/// What the copy of a recording that begins at a log time (ns since 1970), or where the recording
/// does, has to say of what ran before that time, which its own entry and events do not hold.
///
/// # Errors
/// Those of reading.
pub(crate) fn note_for_copy(
    recording: &Recording,
    from_ns: Option<u64>,
) -> anyhow::Result<Option<String>> {
    let noted = at_the_start_of_a_copy(recording).map(str::to_owned);
    let Some(from_ns) = from_ns else { return Ok(noted) };
    if at_the_start(recording).is_none() {
        return Ok(None);
    }
    let Replacements { processes, not_known } = Replacements::before(recording, from_ns)?;
    let running = processes.into_iter().filter(|own| own.until_s.is_none());
    let commands: BTreeMap<String, Vec<String>> =
        running.map(|own| (own.process, vec![own.command])).collect();
    let said = match not_known {
        Some(reason) if commands.is_empty() => Replaced::Unknown(reason),
        _ => Replaced::Known(commands),
    };
    Ok(Some(said.to_text()))
}

/// What a recording says of the time at which it begins; `None` for older builds.
fn at_the_start(recording: &Recording) -> Option<&str> {
    at_the_start_of_a_copy(recording).or_else(|| recording.metadata(key::REPLACED))
}

/// What was noted when the recording was copied from another one.
fn at_the_start_of_a_copy(recording: &Recording) -> Option<&str> {
    let mut records = recording.metadata_records.iter();
    let (_, edit) = records.rfind(|(name, _)| name == EDIT_RECORD)?;
    edit.get(key::REPLACED).map(String::as_str)
}
