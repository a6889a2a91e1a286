//! The logger's core: counts every message, hands it to the writer thread, and accounts for what
//! was lost.
//!
//! The process loop owns a [`RecorderFrontEnd`]. It pushes every message that it takes out of
//! shared memory, sets the time once a cycle, and collects what the writer thread reports. None of
//! these calls waits for the disk.
//!
//! ```no_run
//! # use logger::recorder_front_end::{RecorderFrontEnd, Outcome, StartRequest};
//! # use std::path::PathBuf;
//! # fn monotonic_ns() -> u64 { 0 }
//! # fn messages() -> Vec<(usize, Vec<u8>)> { vec![] }
//! let mut recorder = RecorderFrontEnd::new(Some(PathBuf::from("/run/farreach/rig")))?;
//! recorder.start(StartRequest { path: "/data/run.mcap".into(), ..StartRequest::default() })?;
//! loop {
//!     for (topic, bytes) in messages() {
//!         recorder.push(topic, &bytes);
//!     }
//!     recorder.tick(monotonic_ns());
//!     while let Some(outcome) = recorder.poll() {
//!         if let Outcome::Stopped(_) = outcome { /* answer the request */ }
//!     }
//!     # break;
//! }
//! # Ok::<(), logger::recorder_front_end::RecorderError>(())
//! ```

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::JoinHandle;
use std::time::Duration;

use ipc_types::{Arrival, LoggerAnswer, LossCounters, RingStatus, SequenceTracker, Split, TOPICS};
use recording::word;
use runtime::clock::SECOND_NS;

pub use crate::recorder_error::RecorderError;
use crate::recorder_error::check_split;
pub use crate::state::StartRequest;
pub use crate::writer_queue::Outcome;
use crate::writer_queue::{BYTES, Command, NextPart, QueueSender, RingParts, Shared, queue};
use crate::writer_thread::{Opener, WriterEnd, open_file, run};

/// How long after an attempt to begin the next part that failed the next one is made.
const SPLIT_AGAIN_NS: u64 = 10 * SECOND_NS;

#[derive(Clone, Copy, Debug, Default)]
struct Count {
    tracker: SequenceTracker,
    dropped: u64,
    /// received and gaps when the present recording began
    received_before: u64,
    gaps_before: u64,
}

/// Counts messages and hands them to the writer thread; see the module.
#[derive(Debug)]
pub struct RecorderFrontEnd {
    queue: QueueSender,
    shared: Arc<Shared>,
    commands: Sender<Command>,
    outcomes: Receiver<Outcome>,
    thread: Option<JoinHandle<()>>,
    counts: Vec<Count>,
    unknown: u64,
    /// of the messages; another one for each part
    generation: u32,
    /// that of the recording's first part
    first_generation: u32,
    recording: Option<PathBuf>,
    /// when the recording and its present part began [ns, CLOCK_MONOTONIC]
    began_ns: u64,
    part_began_ns: u64,
    split: Split,
    /// the file of part 1
    first: PathBuf,
    ring: RingParts,
    /// when the present part was begun by a split, or the recording [ns, CLOCK_MONOTONIC]
    split_ns: u64,
    /// when the next part was asked for, between that and its outcome [ns, CLOCK_MONOTONIC]
    splitting_ns: Option<u64>,
    /// no next part is asked for before [ns, CLOCK_MONOTONIC]
    split_again_ns: u64,
    /// set between `stop` and its outcome
    stopping: bool,
    /// whether the present part takes nothing any more
    failed: bool,
    error: String,
}

impl RecorderFrontEnd {
    /// Starts the writer thread. `state_directory` is where the state is saved; `None` saves none.
    ///
    /// # Errors
    /// [`RecorderError::Thread`].
    pub fn new(state_directory: Option<PathBuf>) -> Result<Self, RecorderError> {
        Self::with(state_directory, BYTES, Box::new(open_file))
    }

    /// As [`Self::new`], with a queue of so many bytes and another way to open files.
    ///
    /// # Errors
    /// [`RecorderError::Thread`].
    pub fn with(
        state_directory: Option<PathBuf>,
        queue_bytes: usize,
        opener: Opener,
    ) -> Result<Self, RecorderError> {
        let (mut front, mut end) = Self::unattended(queue_bytes);
        let work = move || run(&mut end, state_directory.as_deref(), &opener);
        let thread = runtime::realtime::beside_loop("logger-disk")
            .spawn(work)
            .map_err(|error| RecorderError::Thread { what: error.to_string() })?;
        front.thread = Some(thread);
        Ok(front)
    }

    /// Both ends, without a thread at the other.
    pub(crate) fn unattended(queue_bytes: usize) -> (Self, WriterEnd) {
        let counters = || TOPICS.iter().map(|_| AtomicU64::new(0)).collect();
        let (sender, receiver) = queue(queue_bytes);
        let shared = Arc::new(Shared {
            now_ns: AtomicU64::new(0),
            generation: AtomicU32::new(0),
            written: counters(),
            refused: counters(),
            part_bytes: AtomicU64::new(0),
        });
        let (commands, inbox) = mpsc::channel();
        let (outbox, outcomes) = mpsc::channel();
        let end = WriterEnd { queue: receiver, shared: Arc::clone(&shared), inbox, outbox };
        let front = Self {
            queue: sender,
            shared,
            commands,
            outcomes,
            thread: None,
            counts: vec![Count::default(); TOPICS.len()],
            unknown: 0,
            generation: 0,
            first_generation: 0,
            recording: None,
            began_ns: 0,
            part_began_ns: 0,
            split: Split::default(),
            first: PathBuf::new(),
            ring: RingParts::default(),
            split_ns: 0,
            splitting_ns: None,
            split_again_ns: 0,
            stopping: false,
            failed: false,
            error: String::new(),
        };
        (front, end)
    }

    /// Counts one message, and queues it if a recording is running. Neither allocates nor waits.
    ///
    /// A topic's history repeats messages from before this part of the recording began: those that
    /// the part before holds, and those from before the whole recording, are not written.
    pub fn push(&mut self, topic: usize, bytes: &[u8]) {
        let Some(count) = self.counts.get_mut(topic) else {
            self.unknown += 1;
            return;
        };
        let arrival = count.tracker.observe(word(bytes, 8), word(bytes, 16));
        if self.recording.is_none() || self.stopping {
            return;
        }
        let time_ns = word(bytes, 24);
        if time_ns < self.part_began_ns
            && (time_ns < self.began_ns || arrival == Arrival::Duplicate)
        {
            return;
        }
        let queued =
            u16::try_from(topic).is_ok_and(|topic| self.queue.push(self.generation, topic, bytes));
        if !queued {
            count.dropped += 1;
        }
    }

    /// Sets the time [ns of `CLOCK_MONOTONIC`], which flush and sync follow. Call it once a cycle.
    pub fn tick(&self, now_ns: u64) {
        self.shared.now_ns.store(now_ns, Ordering::Relaxed);
    }

    /// Begins a recording: everything pushed from now on belongs to it. Whether the file could be
    /// created comes as an [`Outcome`].
    ///
    /// # Errors
    /// [`RecorderError::Recording`], [`RecorderError::RelativePath`], [`RecorderError::Thread`].
    pub fn start(&mut self, mut request: StartRequest) -> Result<(), RecorderError> {
        if let Some(path) = &self.recording {
            return Err(RecorderError::Recording { path: path.clone() });
        }
        if !request.path.is_absolute() {
            return Err(RecorderError::RelativePath { path: request.path });
        }
        check_split(request.split)?;
        self.part_began_ns = self.shared.now_ns.load(Ordering::Relaxed);
        if request.began_ns == 0 {
            request.began_ns = self.part_began_ns;
        }
        self.began_ns = request.began_ns;
        self.generation = self.generation.wrapping_add(1);
        self.first_generation = self.generation;
        self.split = request.split;
        self.split_ns = self.part_began_ns;
        self.split_again_ns = 0;
        self.splitting_ns = None;
        for (count, topic) in self.counts.iter_mut().zip(TOPICS) {
            count.dropped = 0;
            count.received_before = count.tracker.received();
            count.gaps_before = count.tracker.gaps();
            if let Some(position) = request.continues.get(topic.name) {
                count.tracker.resume(position.incarnation, position.next);
            }
        }
        self.failed = false;
        self.error.clear();
        let path = request.path.clone();
        self.first.clone_from(&path);
        self.ring = RingParts::default();
        self.send(Command::Start { generation: self.generation, request })?;
        self.recording = Some(path);
        Ok(())
    }

    /// Whether the present part is as long or as large as a part is to be.
    pub fn split_due(&self) -> bool {
        let now_ns = self.shared.now_ns.load(Ordering::Relaxed);
        if self.recording.is_none()
            || self.stopping
            || self.splitting_ns.is_some()
            || now_ns < self.split_again_ns
        {
            return false;
        }
        let bytes = self.shared.part_bytes.load(Ordering::Relaxed);
        let own = self.own_counters();
        let long =
            self.split.every_ns.is_some_and(|every| now_ns.saturating_sub(self.split_ns) >= every);
        long || self.split.every_bytes.is_some_and(|every| own && bytes >= every)
    }

    /// Begins the next part of the recording: everything pushed from now on belongs to it, and
    /// everything before to the present one. `metadata` are those that are others by now. Whether
    /// its file could be created comes as an [`Outcome`]; the recording goes on in any case.
    ///
    /// # Errors
    /// [`RecorderError::NotRecording`], [`RecorderError::Thread`].
    pub fn split(&mut self, metadata: BTreeMap<String, String>) -> Result<(), RecorderError> {
        if self.recording.is_none() || self.stopping || self.splitting_ns.is_some() {
            return Err(RecorderError::NotRecording);
        }
        let at_ns = self.shared.now_ns.load(Ordering::Relaxed);
        self.generation = self.generation.wrapping_add(1);
        let (generation, losses) = (self.generation, self.all_losses());
        self.send(Command::Split(NextPart { generation, at_ns, metadata, losses }))?;
        self.splitting_ns = Some(at_ns);
        Ok(())
    }

    /// Adds the protocol that begins to be played to the recording, if one is in progress; an empty
    /// map says that none is played any more.
    ///
    /// # Errors
    /// [`RecorderError::Thread`].
    pub fn note_run(&mut self, run: BTreeMap<String, String>) -> Result<(), RecorderError> {
        if self.recording.is_none() || self.stopping {
            return Ok(());
        }
        self.send(Command::NoteRun { run })
    }

    /// Ends the recording: everything pushed before is still written. The summary comes as an
    /// [`Outcome`].
    ///
    /// # Errors
    /// [`RecorderError::NotRecording`], [`RecorderError::Thread`].
    pub fn stop(&mut self) -> Result<(), RecorderError> {
        if self.recording.is_none() || self.stopping {
            return Err(RecorderError::NotRecording);
        }
        self.send(Command::Stop { losses: self.all_losses() })?;
        self.stopping = true;
        // An error of a part before is no error of this; the end tells its own.
        self.error.clear();
        Ok(())
    }

    /// The next report of the writer thread, if there is one.
    pub fn poll(&mut self) -> Option<Outcome> {
        let outcome = self.outcomes.try_recv().ok()?;
        self.note(&outcome);
        Some(outcome)
    }

    /// As [`Self::poll`], waiting for at most `longest`: for before and after the loop.
    pub fn wait(&mut self, longest: Duration) -> Option<Outcome> {
        let outcome = self.outcomes.recv_timeout(longest).ok()?;
        self.note(&outcome);
        Some(outcome)
    }

    fn note(&mut self, outcome: &Outcome) {
        match outcome {
            Outcome::Started { path, ring } => {
                self.recording = Some(path.clone());
                self.ring.clone_from(ring);
            }
            Outcome::NextPart { path, ended, ring } => {
                self.recording = Some(path.clone());
                self.ring.clone_from(ring);
                self.split_ns = self.splitting_ns.take().unwrap_or(self.split_ns);
                self.failed = false;
                match ended {
                    // It could not be begun before.
                    Ok(_) if self.split_again_ns > 0 => self.error.clear(),
                    Ok(_) => {}
                    Err(error) => self.error.clone_from(error),
                }
                self.split_again_ns = 0;
            }
            Outcome::NotSplit { error, ring } => {
                self.ring.clone_from(ring);
                let asked_ns = self.splitting_ns.take().unwrap_or(0);
                self.split_again_ns = asked_ns.saturating_add(SPLIT_AGAIN_NS);
                self.error.clone_from(error);
            }
            Outcome::Failed { error } => {
                self.error.clone_from(error);
                self.failed = true;
            }
            Outcome::StateNotKept { error } => self.error.clone_from(error),
            Outcome::NotStarted { error } | Outcome::StoppedWithError { error, .. } => {
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
        LossCounters { received: tracker.received(), gaps: tracker.gaps(), ..self.losses(topic) }
    }

    /// The counters of a topic, all of them of the present or last recording.
    pub fn losses(&self, topic: usize) -> LossCounters {
        let count = self.counts.get(topic).copied().unwrap_or_default();
        let own = self.own_counters();
        let load = |list: &[AtomicU64]| {
            list.get(topic).filter(|_| own).map_or(0, |value| value.load(Ordering::Relaxed))
        };
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

    /// Whether the writer thread's counters are those of this recording.
    fn own_counters(&self) -> bool {
        self.shared.generation.load(Ordering::Acquire) == self.first_generation
    }

    fn all_losses(&self) -> Vec<LossCounters> {
        (0..TOPICS.len()).map(|topic| self.losses(topic)).collect()
    }

    /// The answer to a status request: the file, the messages written and lost.
    pub fn status(&self) -> LoggerAnswer {
        let (written, lost) = self.all_losses().iter().fold((0, 0), |(written, lost), l| {
            (written + l.written, lost + l.gaps + l.dropped + l.refused)
        });
        LoggerAnswer {
            recording: self.recording.as_ref().map(|path| path.to_string_lossy().into_owned()),
            written,
            lost,
            ring: self.ring_status(),
            error: self.error.clone(),
        }
    }

    /// The parts of the recording, if it is a ring.
    fn ring_status(&self) -> Option<RingStatus> {
        let keep_ns = self.split.keep_ns.filter(|_| self.recording.is_some())?;
        let present = match self.own_counters() {
            true => self.shared.part_bytes.load(Ordering::Relaxed),
            false => 0,
        };
        Some(RingStatus {
            first: self.first.to_string_lossy().into_owned(),
            parts: self.ring.numbers.clone(),
            keep_ns,
            bytes: self.ring.bytes + present,
            removed: self.ring.removed,
            not_removed: self.ring.not_removed,
        })
    }

    /// Ends an open file cleanly but keeps its state, as dropping does, waits for the disk, and
    /// returns the remaining reports of the writer thread. Nothing can be recorded afterwards.
    pub fn end(&mut self) -> Vec<Outcome> {
        self.quit();
        std::iter::from_fn(|| self.poll()).collect()
    }

    /// Whether a recording is running or being ended.
    pub fn recording(&self) -> bool {
        self.recording.is_some()
    }
    /// Whether a recording is running that takes messages.
    pub fn writing(&self) -> bool {
        self.recording.is_some() && !self.stopping && !self.failed
    }
    /// Whether the next part was asked for and its file is not there yet.
    pub fn splitting(&self) -> bool {
        self.splitting_ns.is_some()
    }
    /// Messages waiting for the disk.
    pub fn queued(&self) -> u64 {
        self.queue.len()
    }
    /// Messages of no known topic.
    pub fn unknown(&self) -> u64 {
        self.unknown
    }

    fn quit(&mut self) {
        // A thread that has ended has nothing left to write.
        let _ = self.send(Command::Quit { losses: self.all_losses() });
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }

    fn send(&self, command: Command) -> Result<(), RecorderError> {
        self.commands
            .send(command)
            .map_err(|_| RecorderError::Thread { what: "it ended".to_owned() })?;
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
        Ok(())
    }
}

impl Drop for RecorderFrontEnd {
    /// Ends an open file cleanly but keeps its state: a logger that is restarted continues with the
    /// next part.
    fn drop(&mut self) {
        self.quit();
    }
}
