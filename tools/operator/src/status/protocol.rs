//! The running protocol in the status.

use ipc_types::{ExperimentAnswer, SessionProgress};
use serde::Serialize;

/// The running protocol.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProtocolStatus {
    /// Its name.
    pub name: String,
    /// Segment, from 1.
    pub segment: u32,
    /// Number of segments.
    pub segments: u32,
    /// Name of the segment.
    pub label: String,
    /// Time played (s).
    pub elapsed_s: f64,
    /// Whole duration (s).
    pub duration_s: f64,
    /// Its sessions; `null` if it has none.
    pub sessions: Option<SessionProgress>,
}

impl From<ExperimentAnswer> for ProtocolStatus {
    fn from(answer: ExperimentAnswer) -> Self {
        let ExperimentAnswer { name, label, segments, elapsed_s, duration_s, sessions, .. } =
            answer;
        let segment = answer.segment + 1;
        Self { name, segment, segments, label, elapsed_s, duration_s, sessions }
    }
}

impl ProtocolStatus {
    /// The lines of the status.
    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "protocol  {}, {:.0} of {:.0} s, segment {} of {}: {}",
            self.name, self.elapsed_s, self.duration_s, self.segment, self.segments, self.label
        )];
        lines.extend(self.sessions.as_ref().map(|sessions| format!("          {sessions}")));
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_have_a_line_of_their_own() {
        let answer = ExperimentAnswer {
            running: true,
            name: "force-matching".to_owned(),
            segment: 4,
            label: "session 2 of 4: guided".to_owned(),
            segments: 12,
            elapsed_s: 71.6,
            duration_s: 502.0,
            sessions: Some(SessionProgress { over: 1, sessions: 4, target: Some(vec![0.2134]) }),
            ..ExperimentAnswer::default()
        };
        let lines = ProtocolStatus::from(answer.clone()).lines();
        assert_eq!(
            lines,
            [
                "protocol  force-matching, 72 of 502 s, segment 5 of 12: session 2 of 4: guided",
                "          1 of 4 sessions, target 0.213"
            ]
        );
        let without = ExperimentAnswer { sessions: None, ..answer };
        assert_eq!(ProtocolStatus::from(without).lines().len(), 1);
    }
}
