//! The logger's core: counts what comes, hands it to the thread that writes, answers for what was
//! lost.
//!
//! The process loop owns a [`Sink`]. It pushes every message that it takes out of shared memory,
//! tells the time once a cycle, and picks up what the writing thread reports. None of these calls
//! waits for the disk.
//!
//! ```no_run
//! # use logger::sink::{Sink, Outcome, StartRequest};
//! # use std::path::PathBuf;
//! # fn monotonic_ns() -> u64 { 0 }
//! # fn messages() -> Vec<(usize, Vec<u8>)> { vec![] }
//! let mut sink = Sink::new(Some(PathBuf::from("/run/farreach/rig")))?;
//! sink.start(StartRequest { path: "/data/run.mcap".into(), ..StartRequest::default() })?;
//! loop {
//!     for (topic, bytes) in messages() {
//!         sink.push(topic, &bytes);
//!     }
//!     sink.tick(monotonic_ns());
//!     while let Some(outcome) = sink.poll() {
//!         if let Outcome::Stopped(_) = outcome { /* answer the request */ }
//!     }
//!     # break;
//! }
//! # Ok::<(), logger::sink::SinkError>(())
//! ```

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::JoinHandle;
use std::time::Duration;

use ipc_types::{LoggerAnswer, LossCounters, TOPICS};
use recording::mcap_write::Summary;
use recording::sequence::SequenceTracker;

use crate::queue::{Queue, SLOTS, Slot};
use crate::state::State;
use crate::writer_thread::{Command, Opener, open_file, run};

/// What to record.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StartRequest {
    /// Where to: that of part 1, also for later parts.
    pub path: PathBuf,
    /// 1, or higher when going on after a restart; the next free one is taken.
    pub part: u32,
    /// What the recording says about itself, see [`recording::mcap_write::key`].
    pub metadata: BTreeMap<String, String>,
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC` (ns).
    pub realtime_offset_ns: i64,
    /// Session of the rig.
    pub session: u64,
}

impl StartRequest {
    /// The next part of a recording that was cut off when the logger died.
    pub fn going_on(state: State) -> Self {
        Self {
            path: state.path,
            part: state.part + 1,
            metadata: state.metadata,
            realtime_offset_ns: state.realtime_offset_ns,
            session: state.session,
        }
    }
}

/// What the writing thread reports.
#[derive(Debug)]
pub enum Outcome {
    /// The file is there and takes data.
    Started {
        /// The file (its part number may be higher than asked for).
        path: PathBuf,
    },
    /// The file could not be made; nothing is being recorded.
    NotStarted {
        /// What was asked for.
        path: PathBuf,
        /// Why.
        error: String,
    },
    /// The disk failed within a recording. It stays open, refusing and counting, until it is
    /// stopped.
    Failed {
        /// The file.
        path: PathBuf,
        /// Why.
        error: String,
    },
    /// It was ended in good order; everything is on the disk.
    Stopped(Summary),
    /// It was stopped, but not in good order; what was flushed is on the disk.
    StoppedWithError {
        /// The file.
        path: PathBuf,
        /// Why.
        error: String,
        /// Messages that are not in the file.
        refused: u64,
    },
    /// The recording goes on, but its state could not be kept.
    StateNotKept {
        /// Why.
        error: String,
    },
}

/// Why a request was refused.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    /// One recording at a time.
    #[error("already recording to {}: stop that first", path.display())]
    Recording {
        /// The file.
        path: PathBuf,
    },
    /// There is none.
    #[error("nothing is being recorded")]
    NotRecording,
    /// The path must be absolute: the logger's working directory is nobody's business.
    #[error("{}: expected an absolute path", path.display())]
    RelativePath {
        /// The path.
        path: PathBuf,
    },
    /// The thread cannot be started, or is gone.
    #[error("the writing thread: {what}; restart the logger")]
    Thread {
        /// What is wrong.
        what: String,
    },
}

/// What the writing thread tells without being asked; plain counters, so that neither side waits
/// for the other.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) now_ns: AtomicU64,
    pub(crate) written: Vec<AtomicU64>,
    pub(crate) refused: Vec<AtomicU64>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Count {
    tracker: SequenceTracker,
    dropped: u64,
    /// received and gaps when the present recording began
    received_before: u64,
    gaps_before: u64,
}

/// See the module.
#[derive(Debug)]
pub struct Sink {
    queue: Arc<Queue>,
    shared: Arc<Shared>,
    commands: Sender<Command>,
    outcomes: Receiver<Outcome>,
    thread: Option<JoinHandle<()>>,
    counts: Vec<Count>,
    unknown: u64,
    generation: u32,
    recording: Option<PathBuf>,
    /// set between `stop` and its outcome
    stopping: bool,
    error: String,
}

impl Sink {
    /// Starts the writing thread. `state_directory` is where the state is kept; `None` keeps none.
    ///
    /// # Errors
    /// [`SinkError::Thread`].
    pub fn new(state_directory: Option<PathBuf>) -> Result<Self, SinkError> {
        Self::with(state_directory, SLOTS, Box::new(open_file))
    }

    /// The same with a queue of `slots` and another way to open files.
    ///
    /// # Errors
    /// [`SinkError::Thread`].
    pub fn with(
        state_directory: Option<PathBuf>,
        slots: usize,
        opener: Opener,
    ) -> Result<Self, SinkError> {
        let counters = || TOPICS.iter().map(|_| AtomicU64::new(0)).collect();
        let queue = Arc::new(Queue::new(slots.max(1)));
        let shared = Arc::new(Shared {
            now_ns: AtomicU64::new(0),
            written: counters(),
            refused: counters(),
        });
        let (commands, command_inbox) = mpsc::channel();
        let (outcome_outbox, outcomes) = mpsc::channel();
        let thread = std::thread::Builder::new()
            .name("logger-disk".to_owned())
            .spawn({
                let (queue, shared) = (Arc::clone(&queue), Arc::clone(&shared));
                move || {
                    run(
                        &queue,
                        &shared,
                        &command_inbox,
                        &outcome_outbox,
                        state_directory.as_deref(),
                        &opener,
                    )
                }
            })
            .map_err(|error| SinkError::Thread { what: error.to_string() })?;
        Ok(Self {
            queue,
            shared,
            commands,
            outcomes,
            thread: Some(thread),
            counts: vec![Count::default(); TOPICS.len()],
            unknown: 0,
            generation: 0,
            recording: None,
            stopping: false,
            error: String::new(),
        })
    }

    /// Takes one message: counts it, and hands it on if a recording runs. Allocates nothing, waits
    /// for nothing.
    pub fn push(&mut self, topic: usize, bytes: &[u8]) {
        let Some(count) = self.counts.get_mut(topic) else {
            self.unknown += 1;
            return;
        };
        count.tracker.observe(word(bytes, 8), word(bytes, 16));
        if self.recording.is_none() || self.stopping {
            return;
        }
        let slot =
            u16::try_from(topic).ok().and_then(|topic| Slot::new(self.generation, topic, bytes));
        if slot.is_none_or(|slot| self.queue.push(slot).is_err()) {
            count.dropped += 1;
        }
    }

    /// Tells the time [ns of `CLOCK_MONOTONIC`]; flush and sync follow it. Call it once a cycle.
    pub fn tick(&self, now_ns: u64) {
        self.shared.now_ns.store(now_ns, Ordering::Relaxed);
    }

    /// Begins a recording: everything pushed from now on belongs to it. Whether the file could be
    /// made comes as an [`Outcome`].
    ///
    /// # Errors
    /// [`SinkError::Recording`], [`SinkError::RelativePath`], [`SinkError::Thread`].
    pub fn start(&mut self, request: StartRequest) -> Result<(), SinkError> {
        if let Some(path) = &self.recording {
            return Err(SinkError::Recording { path: path.clone() });
        }
        if !request.path.is_absolute() {
            return Err(SinkError::RelativePath { path: request.path });
        }
        self.generation = self.generation.wrapping_add(1);
        for (index, count) in self.counts.iter_mut().enumerate() {
            count.dropped = 0;
            count.received_before = count.tracker.received();
            count.gaps_before = count.tracker.gaps();
            self.shared.written[index].store(0, Ordering::Relaxed);
            self.shared.refused[index].store(0, Ordering::Relaxed);
        }
        self.error.clear();
        let path = request.path.clone();
        self.send(Command::Start { generation: self.generation, request })?;
        self.recording = Some(path);
        Ok(())
    }

    /// Ends the recording: everything pushed before is still written. The summary comes as an
    /// [`Outcome`].
    ///
    /// # Errors
    /// [`SinkError::NotRecording`], [`SinkError::Thread`].
    pub fn stop(&mut self) -> Result<(), SinkError> {
        if self.recording.is_none() || self.stopping {
            return Err(SinkError::NotRecording);
        }
        let losses = (0..TOPICS.len()).map(|topic| self.losses_of_recording(topic)).collect();
        self.send(Command::Stop { losses })?;
        self.stopping = true;
        Ok(())
    }

    /// What the writing thread has to say, if anything.
    pub fn poll(&mut self) -> Option<Outcome> {
        let outcome = self.outcomes.try_recv().ok()?;
        self.note(&outcome);
        Some(outcome)
    }

    /// The same, waiting for it at most that long. Not for the loop: for the end of the process.
    pub fn wait(&mut self, longest: Duration) -> Option<Outcome> {
        let outcome = self.outcomes.recv_timeout(longest).ok()?;
        self.note(&outcome);
        Some(outcome)
    }

    fn note(&mut self, outcome: &Outcome) {
        match outcome {
            Outcome::Started { path } => self.recording = Some(path.clone()),
            Outcome::Failed { error, .. } | Outcome::StateNotKept { error } => {
                self.error.clone_from(error)
            }
            Outcome::NotStarted { error, .. } | Outcome::StoppedWithError { error, .. } => {
                self.error.clone_from(error);
                self.recording = None;
                self.stopping = false;
            }
            Outcome::Stopped(_) => {
                self.recording = None;
                self.stopping = false;
            }
        }
    }

    /// The counters of a topic for [`ipc_types::LOSS`]: received and gaps since the logger started,
    /// the others of the present or last recording. Identity and time are stamped by the publisher.
    pub fn counters(&self, topic: usize) -> LossCounters {
        let tracker = self.counts.get(topic).map(|count| count.tracker).unwrap_or_default();
        LossCounters {
            received: tracker.received(),
            gaps: tracker.gaps(),
            ..self.losses_of_recording(topic)
        }
    }

    /// The counters of a topic, all of them of the present or last recording.
    pub fn losses(&self, topic: usize) -> LossCounters {
        self.losses_of_recording(topic)
    }

    fn losses_of_recording(&self, topic: usize) -> LossCounters {
        let count = self.counts.get(topic).copied().unwrap_or_default();
        let load =
            |list: &[AtomicU64]| list.get(topic).map_or(0, |value| value.load(Ordering::Relaxed));
        LossCounters {
            received: count.tracker.received() - count.received_before,
            gaps: count.tracker.gaps() - count.gaps_before,
            dropped: count.dropped,
            written: load(&self.shared.written),
            refused: load(&self.shared.refused),
            topic: topic as u32,
            ..LossCounters::default()
        }
    }

    /// What is being recorded, how much of it, what was lost: the answer to a status request.
    pub fn status(&self) -> LoggerAnswer {
        let all = (0..TOPICS.len()).map(|topic| self.losses_of_recording(topic));
        let (written, lost) = all.fold((0, 0), |(written, lost), l| {
            (written + l.written, lost + l.gaps + l.dropped + l.refused)
        });
        LoggerAnswer {
            recording: self.recording.as_ref().map(|path| path.to_string_lossy().into_owned()),
            written,
            lost,
            error: self.error.clone(),
        }
    }

    /// Ends a file that is open in good order but keeps its state, as dropping does, waits for the
    /// disk, and returns what the writing thread had to say about it. Nothing can be recorded
    /// afterwards.
    pub fn end(&mut self) -> Vec<Outcome> {
        self.quit();
        let mut outcomes = Vec::new();
        while let Some(outcome) = self.poll() {
            outcomes.push(outcome);
        }
        outcomes
    }

    /// Whether a recording runs or is being ended.
    pub fn recording(&self) -> bool {
        self.recording.is_some()
    }
    /// Messages waiting for the disk.
    pub fn queued(&self) -> usize {
        self.queue.len()
    }
    /// Messages of no known topic.
    pub fn unknown(&self) -> u64 {
        self.unknown
    }

    fn quit(&mut self) {
        let losses = (0..TOPICS.len()).map(|topic| self.losses_of_recording(topic)).collect();
        // A thread that is gone has nothing left to end.
        let _ = self.send(Command::Quit { losses });
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }

    fn send(&self, command: Command) -> Result<(), SinkError> {
        self.commands
            .send(command)
            .map_err(|_| SinkError::Thread { what: "it is gone".to_owned() })?;
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
        Ok(())
    }
}

impl Drop for Sink {
    /// Ends a file that is open in good order but keeps its state: a logger that is restarted goes
    /// on with the next part.
    fn drop(&mut self) {
        self.quit();
    }
}

fn word(bytes: &[u8], at: usize) -> u64 {
    let mut raw = [0u8; 8];
    if let Some(slice) = bytes.get(at..at + 8) {
        raw.copy_from_slice(slice);
    }
    u64::from_le_bytes(raw)
}
