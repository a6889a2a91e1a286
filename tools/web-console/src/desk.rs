//! What the console knows and does: the protocol that was built, the one that it plays, files and
//! sessions. All threads share it.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Arc, Mutex, MutexGuard};

use ipc_types::{Event, EventKind, Process, Severity, WatchdogState};
use operator::status::{ProtocolStatus, RecordingStatus};
use operator::{ChosenProtocol, Progress};
use recorder::SessionReport;
use rig::protocol::{Movement, Protocol, Segment};
use serde::Serialize;
use serde_json::{Value, json};

use crate::access::Access;
use crate::actions::Situation;
use crate::board::{Board, Slot};

/// What all threads share.
pub(crate) struct Shared {
    pub(crate) desk: Mutex<Desk>,
    pub(crate) access: Mutex<Access>,
    pub(crate) board: Board,
    /// Subject's pages that are open.
    pub(crate) subject_pages: AtomicU64,
    /// Events to publish.
    events: SyncSender<Event>,
    /// Events that found no room, messages that pages missed, and messages that were refused.
    lost: AtomicU64,
}

impl Shared {
    pub(crate) fn new(token: String, events: SyncSender<Event>) -> Self {
        Self {
            desk: Mutex::default(),
            access: Mutex::new(Access::new(token)),
            board: Board::new(),
            subject_pages: AtomicU64::new(0),
            events,
            lost: AtomicU64::new(0),
        }
    }

    pub(crate) fn desk(&self) -> MutexGuard<'_, Desk> {
        crate::lock(&self.desk)
    }

    pub(crate) fn access(&self) -> MutexGuard<'_, Access> {
        crate::lock(&self.access)
    }

    /// Publishes an event of the console.
    pub(crate) fn event(&self, kind: EventKind, severity: Severity, values: [f64; 3], text: &str) {
        let [a, b, c] = values;
        let event = Event { a, b, c, ..Event::new(Process::Console, kind, severity, text) };
        if let Err(TrySendError::Full(_)) = self.events.try_send(event) {
            self.lose(1);
        }
    }

    /// Counts what was lost.
    pub(crate) fn lose(&self, count: u64) {
        self.lost.fetch_add(count, Ordering::Relaxed);
    }

    pub(crate) fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    /// Shows the plan and the sessions, which change seldom.
    pub(crate) fn show(&self, desk: &Desk) {
        self.board.set(Slot::Plan, &desk.plan());
        self.board.set(Slot::Sessions, &desk.sessions());
    }
}

/// A protocol that was read and checked, with what is to be done with it.
pub(crate) struct Built {
    /// By which a page starts it.
    pub(crate) id: String,
    pub(crate) chosen: ChosenProtocol,
    pub(crate) subject: String,
    /// Name of the sessions' files.
    pub(crate) files: Option<PathBuf>,
}

/// A protocol that the console plays.
pub(crate) struct Playing {
    pub(crate) name: String,
    pub(crate) subject: String,
    /// Number of the client that it belongs to.
    pub(crate) client: u64,
    /// Whether the key 5 is a pulse of the scanner.
    pub(crate) takes_keys: bool,
    /// Its segments, for the timeline.
    pub(crate) segments: Vec<Planned>,
    pub(crate) progress: Progress,
    /// Ends it.
    pub(crate) stop: Arc<AtomicBool>,
}

/// A segment that is to be played.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Planned {
    label: String,
    duration_s: f64,
    session: bool,
}

/// The segments of a protocol in the order of playing.
pub(crate) fn planned(protocol: &Protocol) -> Vec<Planned> {
    let plan = |(_, segment): (usize, &Segment)| Planned {
        label: segment.label.clone(),
        duration_s: match &segment.movement {
            // The scanner begins when it begins: the longest wait would fill the timeline.
            Movement::WaitForScanner(wait) => wait.start_up_s,
            movement => movement.duration_s(),
        },
        session: segment.session,
    };
    protocol.sequence().map(plan).collect()
}

/// State of the console.
#[derive(Default)]
pub(crate) struct Desk {
    pub(crate) built: Option<Arc<Built>>,
    pub(crate) playing: Option<Playing>,
    /// Whether the files of the last protocol are being written; nothing is started meanwhile.
    pub(crate) finishing: bool,
    /// How often a stop was asked for: what was ordered before is not begun after.
    pub(crate) stops: u64,
    /// How the last protocol ended, and whether that was well.
    pub(crate) last: Option<(bool, String)>,
    /// The protocol that runs, as the experiment process says, whoever started it.
    pub(crate) running: Option<ProtocolStatus>,
    pub(crate) recording: Option<RecordingStatus>,
    /// Files of the sessions, or why one is missing.
    pub(crate) files: Vec<Result<String, String>>,
    pub(crate) reports: Vec<SessionReport>,
}

impl Desk {
    /// What the possible actions depend on.
    pub(crate) fn situation(&self, watchdog: Option<WatchdogState>) -> Situation {
        Situation {
            watchdog,
            running: self.playing.is_some() || self.finishing || self.running.is_some(),
            built: self.built.is_some(),
            recording: self.recording.as_ref().is_some_and(|logger| logger.file.is_some()),
        }
    }

    /// What it does, for the state that pages are told.
    pub(crate) fn state(&self) -> Value {
        let progress = self.playing.as_ref().map(|playing| {
            let Progress { elapsed_s, duration_s, segment, segments, label, absent, .. } =
                &playing.progress;
            json!({
                "name": playing.name,
                "subject": playing.subject,
                "takes_keys": playing.takes_keys,
                "elapsed_s": elapsed_s,
                "duration_s": duration_s,
                "segment": segment,
                "segments": segments,
                "label": label,
                "absent": absent,
                "scan": playing.progress.scan,
                "sessions": playing.progress.sessions,
            })
        });
        let elsewhere = match self.playing {
            Some(_) => None,
            None => self.running.as_ref(),
        };
        json!({
            "built": self.built.as_ref().map(|built| json!({
                "id": built.id,
                "name": built.chosen.protocol().name,
                "subject": built.subject,
            })),
            "playing": progress,
            "finishing": self.finishing,
            "elsewhere": elsewhere,
            "last": self.last.as_ref().map(|(well, text)| json!({ "well": well, "text": text })),
            "recording": self.recording,
        })
    }

    fn plan(&self) -> Value {
        let built = || {
            let protocol = self.built.as_ref()?.chosen.protocol();
            Some((protocol.name.clone(), planned(protocol)))
        };
        let playing = self.playing.as_ref();
        let plan = playing.map(|it| (it.name.clone(), it.segments.clone())).or_else(built);
        let (name, segments) = plan.unwrap_or_default();
        json!({ "type": "plan", "name": name, "segments": segments })
    }

    fn sessions(&self) -> Value {
        let file = |file: &Result<String, String>| match file {
            Ok(path) => json!({ "path": path }),
            Err(error) => json!({ "error": error }),
        };
        let files: Vec<Value> = self.files.iter().map(file).collect();
        json!({ "type": "sessions", "reports": self.reports, "files": files })
    }
}
