//! The protocol that is, or was, being played, as the thread that answers requests knows it.

use std::path::Path;
use std::sync::Arc;

use ipc_types::{Event, EventKind, Process, SessionProgress, Severity};
use rig::RigFile;

use crate::contraction;
use crate::player::{Change, Program};
use crate::session_state::SessionState;

use super::thread_link::ChangeReport;

/// What is, or was, being played.
#[derive(Debug)]
pub(super) struct Current {
    pub(super) order: u32,
    pub(super) client: u64,
    pub(super) program: Arc<Program>,
    /// Its sessions so far.
    pub(super) sessions: SessionState,
    /// The newest change that the loop has reported.
    pub(super) newest: Option<ChangeReport>,
    /// Whether the maxima that it measured were saved, as far as that could be.
    pub(super) maxima_saved: bool,
    /// When the key 5 was pressed since the newest change (ns), and whether that was saved.
    pub(super) keys: Vec<u64>,
    pub(super) keys_saved: bool,
}

impl Current {
    /// A protocol that begins, or continues, with this order of a client.
    pub(super) fn new(order: u32, client: u64, program: Arc<Program>) -> Self {
        let sessions = program.continues().map(|from| from.sessions.clone()).unwrap_or_default();
        let (newest, maxima_saved) = (None, false);
        let (keys, keys_saved) = (Vec::new(), true);
        Self { order, client, program, sessions, newest, maxima_saved, keys, keys_saved }
    }

    /// What is told of a session before a segment whose mean was not saved: the process or the
    /// computer died just then. `None` where there is none.
    pub(super) fn lost_session(&self, segment: u32) -> Option<Event> {
        let (over, expected) = (self.sessions.over, self.program.sessions_before(segment as usize));
        if over >= expected {
            return None;
        }
        let text = format!(
            "the mean of session {expected} was not saved: the target stays that of session {over}"
        );
        let event =
            Event::new(Process::Experiment, EventKind::SessionOver, Severity::Warning, &text);
        Some(Event { a: f64::from(expected), segment, ..event })
    }

    /// Whether it ran to its end, and the result of its last session is known.
    pub(super) fn is_over(&self) -> bool {
        let done = self.newest.is_some_and(|report| report.change == Change::Done);
        done && self.sessions.over >= self.program.sessions().sessions
    }

    /// The sessions so far; `None` for a protocol without. The result of the last one comes a few
    /// milliseconds after the end of a protocol that is completed.
    pub(super) fn progress(&self, completed: bool) -> Option<SessionProgress> {
        let plan = self.program.sessions();
        (plan.sessions > 0).then(|| SessionProgress {
            over: if completed { plan.sessions } else { self.sessions.over },
            sessions: plan.sessions,
            target: plan.matched.map(|matched| self.sessions.target[..matched.bars()].to_vec()),
        })
    }

    /// Saves the maxima that a protocol has measured, and says so; `None` where it saves none.
    pub(super) fn save_maxima(&self, folder: &Path, rig: &RigFile) -> Option<Event> {
        let name = self.program.saves_maxima()?;
        let maxima = &self.sessions.maxima;
        let count = maxima.iter().filter(|maximum| **maximum > 0.0).count();
        let (severity, text) = match contraction::save(folder, name, rig, maxima) {
            Ok(()) => (Severity::Info, name.to_owned()),
            Err(reason) => (Severity::Error, reason),
        };
        let event = Event::new(Process::Experiment, EventKind::MaximaSaved, severity, &text);
        Some(Event { a: count as f64, ..event })
    }
}
