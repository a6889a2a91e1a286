//! What the logger publishes: events, heartbeats, loss counters, its measurement of the clock.

use ipc_types::{ClockSync, EventKind, Heartbeat, LoggerAnswer, Process, Severity, TOPICS};
use recording::mcap_write::Summary;
use runtime::PortError;
use runtime::clock::ClockPair;

use super::Logger;
use super::replacements::Change;
use crate::recorder_front_end::Outcome;

impl Logger {
    /// Passes on a report of the writer thread: as an event, and as the answer to the request.
    pub(super) fn outcome(&mut self, outcome: Outcome) -> Result<(), PortError> {
        if let Outcome::NextPart { ended: Err(error), .. } = &outcome {
            self.service.event(EventKind::DataLost, Severity::Error, [0.0; 3], error)?;
        }
        let status = self.recorder.status();
        let (written, lost) = (status.written as f64, status.lost as f64);
        let (kind, severity, values) = match &outcome {
            Outcome::Started { .. } | Outcome::NextPart { .. } => {
                (EventKind::RecordingStarted, Severity::Info, [0.0; 3])
            }
            Outcome::NotStarted { .. } => (EventKind::RecordingStopped, Severity::Error, [0.0; 3]),
            Outcome::Stopped(Summary { bytes, .. }) => {
                let values = [written, lost, *bytes as f64];
                (EventKind::RecordingStopped, Severity::Info, values)
            }
            Outcome::StoppedWithError { .. } => {
                (EventKind::RecordingStopped, Severity::Error, [written, lost, 0.0])
            }
            Outcome::Failed { .. } => (EventKind::DataLost, Severity::Error, [lost, 0.0, 0.0]),
            Outcome::StateNotKept { .. } | Outcome::NotSplit { .. } => {
                (EventKind::RecordingStarted, Severity::Warning, [0.0; 3])
            }
        };
        let text = match &outcome {
            Outcome::Started { path, .. }
            | Outcome::NextPart { path, .. }
            | Outcome::Stopped(Summary { path, .. }) => {
                ending_of(&path.to_string_lossy()).to_owned()
            }
            Outcome::NotStarted { error }
            | Outcome::Failed { error }
            | Outcome::StoppedWithError { error, .. }
            | Outcome::NotSplit { error, .. }
            | Outcome::StateNotKept { error } => error.clone(),
        };
        self.service.event(kind, severity, values, &text)?;
        let next_part = match &outcome {
            Outcome::NextPart { ended, .. } => Some(ended.as_ref().err().cloned()),
            Outcome::NotSplit { error, .. } => Some(Some(error.clone())),
            _ => None,
        };
        if let Some(error) = next_part
            && let Some(reply) = self.part_reply.take()
        {
            let error = error.unwrap_or_default();
            let _ = reply.send(LoggerAnswer { error, ..self.recorder.status() });
        }
        let reply = match &outcome {
            Outcome::Started { .. } | Outcome::NotStarted { .. } => self.start_reply.take(),
            Outcome::Stopped(_) | Outcome::StoppedWithError { .. } => {
                // What the last flush refused is in the counters by now.
                self.publish_counts()?;
                self.stop_reply.take()
            }
            Outcome::NextPart { .. }
            | Outcome::NotSplit { .. }
            | Outcome::Failed { .. }
            | Outcome::StateNotKept { .. } => None,
        };
        if let Some(reply) = reply {
            let _ = reply.send(self.recorder.status());
        }
        Ok(())
    }

    pub(super) fn heartbeat(&mut self) -> Result<(), PortError> {
        // Subscribers that joined since the last event get the history only through this.
        self.service.refresh_events();
        let lost = (0..TOPICS.len())
            .map(|topic| self.recorder.counters(topic))
            .map(|c| c.gaps + c.dropped + c.refused);
        let message = Heartbeat {
            lost: lost.sum::<u64>() + self.recorder.unknown(),
            queued: self.recorder.queued(),
            pid: std::process::id(),
            source: Process::Logger.code(),
            state: u8::from(self.recorder.recording()),
            profile: self.service.domain().profile().code(),
            ..Heartbeat::default()
        };
        self.heartbeats.send(message)?;
        Ok(())
    }

    /// Publishes the loss counters of all topics and the measurement of the clock.
    pub(super) fn publish_counts(&mut self) -> Result<(), PortError> {
        for topic in 0..TOPICS.len() {
            self.losses.send(self.recorder.counters(topic))?;
        }
        let pair = ClockPair::measure();
        self.clocks.send(ClockSync {
            monotonic_ns: pair.monotonic_ns,
            realtime_ns: pair.realtime_ns,
            file_offset_ns: if self.recorder.recording() { self.file_offset_ns } else { 0 },
            uncertainty_ns: pair.uncertainty_ns,
            ..ClockSync::default()
        })?;
        Ok(())
    }

    /// Publishes an event for each topic that lost messages of the recording since the last call.
    /// What a failed disk refuses is reported once, when it fails, and counted from then on.
    pub(super) fn report_losses(&mut self) -> Result<(), PortError> {
        for (index, topic) in TOPICS.iter().enumerate() {
            let counts = self.recorder.losses(index);
            let lost = counts.gaps + counts.dropped;
            let reported = std::mem::replace(&mut self.reported_losses[index], lost);
            if self.recorder.recording() && lost > reported {
                let text = format!(
                    "{}: in all {} did not reach the logger, {} found its queue full",
                    topic.name, counts.gaps, counts.dropped
                );
                let values = [(lost - reported) as f64, lost as f64, index as f64];
                self.service.event(EventKind::DataLost, Severity::Error, values, &text)?;
            }
        }
        Ok(())
    }

    /// Publishes an event for each process that has another program since the last call.
    pub(super) fn report_replacements(&mut self) -> Result<(), PortError> {
        let changes = self.replacements.look();
        self.tell(changes)
    }

    pub(super) fn tell(&mut self, changes: Vec<Change>) -> Result<(), PortError> {
        for Change { kind, severity, text } in changes {
            self.service.event(kind, severity, [0.0; 3], &text)?;
        }
        Ok(())
    }
}

/// The end of a path that is too long for an event, with the file name.
fn ending_of(path: &str) -> &str {
    let mut start = path.len().saturating_sub(ipc_types::TEXT);
    while !path.is_char_boundary(start) {
        start += 1;
    }
    &path[start..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_path_keeps_its_file_name() {
        let path = format!("/{}/ü/run.mcap", "ä".repeat(100));
        let end = ending_of(&path);
        assert!(end.len() <= ipc_types::TEXT && end.ends_with("ü/run.mcap"), "{end}");
        assert_eq!(ending_of("/short.mcap"), "/short.mcap");
    }
}
