//! The thread that owns the file. It may wait for the disk; the process loop never waits for it.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender, TryRecvError};
use std::time::Duration;

use ipc_types::{LossCounters, TOPICS};
use recording::mcap_read::Recording;
use recording::mcap_write::{Position, Positions, Start, Summary, WriteError, Writer, key};
use recording::word;

use crate::ring::Ring;
use crate::state::{self, StartRequest};
use crate::writer_queue::{Command, NextPart, Outcome, QueueReceiver, Shared};

/// Sleep when there is nothing to do; the queue holds seconds of messages.
const IDLE: Duration = Duration::from_millis(10);
/// Messages written between two checks of the time and the commands.
const BATCH: usize = 512;
/// Most numbers of parts that are passed over, because there are files of these names.
const PASSED_OVER_MAX: u32 = 10_000;

/// Opens the file of a recording; replaced in tests.
pub type Opener = Box<dyn Fn(&Path, &Start, u64) -> Result<Writer, WriteError> + Send>;

/// Opens a real file.
pub(crate) fn open_file(path: &Path, start: &Start, now_ns: u64) -> Result<Writer, WriteError> {
    Writer::create(path, start, now_ns)
}

/// The writer thread's end of what it shares with the loop.
#[derive(Debug)]
pub(crate) struct WriterEnd {
    pub(crate) queue: QueueReceiver,
    pub(crate) shared: Arc<Shared>,
    pub(crate) inbox: Receiver<Command>,
    pub(crate) outbox: Sender<Outcome>,
}

/// What a turn of the thread has led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// There was something to do.
    Worked,
    /// There was nothing.
    Idle,
    /// The thread is to end.
    Ended,
}

pub(crate) struct Disk<'a> {
    end: &'a mut WriterEnd,
    state_directory: Option<&'a Path>,
    opener: &'a Opener,
    writer: Option<Writer>,
    /// of the recording in progress, as it is on the disk
    state: StartRequest,
    generation: u32,
    /// by topic
    parts: Vec<Parts>,
    ring: Ring,
}

/// What the parts of a recording have of a topic.
#[derive(Clone, Copy, Debug, Default)]
struct Parts {
    /// Where the newest message stands in its sender's sequence.
    position: Option<Position>,
    /// Counters of the recording up to the beginning of the present part.
    before: LossCounters,
    /// Of the parts that have ended.
    written: u64,
    refused: u64,
}

pub(crate) fn run(end: &mut WriterEnd, state_directory: Option<&Path>, opener: &Opener) {
    let mut disk = Disk::new(end, state_directory, opener);
    loop {
        match disk.turn() {
            Turn::Worked => {}
            // `send` unparks, so that a command does not wait for the sleep to end
            Turn::Idle => std::thread::park_timeout(IDLE),
            Turn::Ended => return,
        }
    }
}

impl<'a> Disk<'a> {
    pub(crate) fn new(
        end: &'a mut WriterEnd,
        state_directory: Option<&'a Path>,
        opener: &'a Opener,
    ) -> Self {
        Self {
            end,
            state_directory,
            opener,
            writer: None,
            state: StartRequest::default(),
            generation: 0,
            parts: vec![Parts::default(); TOPICS.len()],
            ring: Ring::default(),
        }
    }

    /// Writes what waits, and carries out the next command.
    pub(crate) fn turn(&mut self) -> Turn {
        let worked = self.drain(BATCH);
        self.tick();
        match self.end.inbox.try_recv() {
            Ok(Command::Start { generation, request }) => self.start(generation, request),
            Ok(Command::NoteRun { run }) => self.note_run(run),
            Ok(Command::Split(next)) => self.split(next),
            Ok(Command::Stop { losses }) => self.stop(&losses, true),
            Ok(Command::Quit { losses }) => {
                self.stop(&losses, false);
                return Turn::Ended;
            }
            Err(TryRecvError::Disconnected) => {
                self.stop(&[], false);
                return Turn::Ended;
            }
            Err(TryRecvError::Empty) if worked == 0 => return Turn::Idle,
            Err(TryRecvError::Empty) => {}
        }
        Turn::Worked
    }

    fn now_ns(&self) -> u64 {
        self.end.shared.now_ns.load(Ordering::Relaxed)
    }

    fn report(&self, outcome: Outcome) {
        // Fails only while the process ends.
        let _ = self.end.outbox.send(outcome);
    }

    /// Writes queued messages, at most `most`; returns how many.
    fn drain(&mut self, most: usize) -> usize {
        for done in 0..most {
            let Some(header) = self.end.queue.next_header() else { return done };
            // Generations wrap: "later" is less than half the range ahead. It waits in the queue
            // for the start command of its recording.
            let ahead = header.generation.wrapping_sub(self.generation);
            if ahead != 0 && ahead < u32::MAX / 2 {
                return done;
            }
            self.write_next();
        }
        most
    }

    /// Writes the next message of the queue.
    fn write_next(&mut self) {
        let Some((header, message)) = self.end.queue.pop() else { return };
        let topic = usize::from(header.topic);
        let Some(writer) = self.writer.as_mut().filter(|_| header.generation == self.generation)
        else {
            // Its file could not be created, or is closed. What belongs to an earlier recording is
            // no loss of this one.
            if header.generation == self.generation
                && let Some(refused) = self.end.shared.refused.get(topic)
            {
                refused.fetch_add(1, Ordering::Relaxed);
            }
            return;
        };
        let sound = writer.error().is_none();
        let result = writer.write(topic, message);
        if result.is_ok()
            && let Some(parts) = self.parts.get_mut(topic)
        {
            let (incarnation, next) = (word(message, 8), word(message, 16).saturating_add(1));
            // A history repeats older messages.
            let newest = parts.position.filter(|newest| newest.incarnation == incarnation);
            let next = newest.map_or(next, |newest| newest.next.max(next));
            parts.position = Some(Position { incarnation, next });
        }
        self.publish(topic);
        if let Err(error) = result
            && sound
            && self.writer.as_ref().is_some_and(|writer| writer.error().is_some())
        {
            self.failed(&error);
        }
    }

    fn failed(&self, error: &WriteError) {
        self.publish_all();
        self.report(Outcome::Failed { error: error.to_string() });
    }

    fn publish(&self, topic: usize) {
        let Shared { written, refused, .. } = self.end.shared.as_ref();
        let (Some(writer), Some(written), Some(refused), Some(parts)) =
            (&self.writer, written.get(topic), refused.get(topic), self.parts.get(topic))
        else {
            return;
        };
        written.store(parts.written + writer.written_of(topic), Ordering::Relaxed);
        refused.store(parts.refused + writer.refused_of(topic), Ordering::Relaxed);
    }

    fn publish_all(&self) {
        (0..self.end.shared.written.len()).for_each(|topic| self.publish(topic));
    }

    fn tick(&mut self) {
        let now_ns = self.now_ns();
        let Some(writer) = &mut self.writer else { return };
        let ticked = writer.tick(now_ns);
        self.end.shared.part_bytes.store(writer.bytes(), Ordering::Relaxed);
        if let Err(error) = ticked {
            self.failed(&error);
        }
    }

    fn start(&mut self, generation: u32, mut request: StartRequest) {
        self.generation = generation;
        let shared = &self.end.shared;
        for count in shared.written.iter().chain(&shared.refused) {
            count.store(0, Ordering::Relaxed);
        }
        shared.part_bytes.store(0, Ordering::Relaxed);
        for (parts, topic) in self.parts.iter_mut().zip(TOPICS) {
            let position = request.continues.get(topic.name).copied();
            *parts = Parts { position, ..Parts::default() };
        }
        // From here on the counters are those of this recording.
        shared.generation.store(generation, Ordering::Release);
        let now_ns = self.now_ns();
        self.ring = Ring::of(&request, now_ns);
        // A logger that dies again and again may never end a part; and before the file is created,
        // for which there may be no room otherwise.
        self.ring.remove_old(&mut request, now_ns);
        match self.open(&request, now_ns) {
            Ok((part, writer)) => {
                let path = writer.path().to_owned();
                self.writer = Some(writer);
                self.state = StartRequest { part, ..request };
                self.save_state();
                self.report(Outcome::Started { path, ring: self.ring.parts(&self.state) });
            }
            Err(error) => self.report(Outcome::NotStarted { error: error.to_string() }),
        }
    }

    /// Creates the file of a part. Part 1 gets exactly the name requested: an existing file is
    /// somebody's data. A later one gets the next free number, which is returned.
    fn open(&self, request: &StartRequest, now_ns: u64) -> Result<(u32, Writer), WriteError> {
        let mut part = request.part.max(1);
        let last = part.saturating_add(PASSED_OVER_MAX);
        loop {
            let path = recording::part_path(&request.path, part);
            let start = Start {
                realtime_offset_ns: request.realtime_offset_ns,
                metadata: request.metadata.clone(),
                continues: request.continues.clone(),
                run: request.run.clone(),
            }
            .with(key::PART, &part.to_string());
            match (self.opener)(&path, &start, now_ns) {
                Err(WriteError::Exists { .. }) if part > 1 && part < last => part += 1,
                opened => return opened.map(|writer| (part, writer)),
            }
        }
    }

    /// Goes on in the next part. Its file is there before the present one is ended: where it cannot
    /// be created, the recording goes on as it is.
    fn split(&mut self, next: NextPart) {
        // All of the present part; what was pushed since is of another generation.
        while self.drain(BATCH) > 0 {}
        let NextPart { generation, at_ns, metadata, losses } = next;
        self.generation = generation;
        // Where there is no file, the loop has been told.
        if self.writer.is_none() {
            return;
        }
        // Before the next file is created, for which there may be no room otherwise.
        let removed = self.ring.remove_old(&mut self.state, at_ns);
        let mut request = self.state.clone();
        request.part += 1;
        request.metadata.extend(metadata);
        request.continues = self.positions();
        let (part, writer) = match self.open(&request, at_ns) {
            Ok(opened) => opened,
            Err(error) => return self.not_split(&error, removed),
        };
        // Ending the present part may take the disk seconds: a logger that takes over must know of
        // the file of the next one.
        self.state.created = part;
        self.save_state();
        let path = writer.path().to_owned();
        let Some(mut ended) = self.writer.replace(writer) else { return };
        // The counters must hold what the last flush refuses; `finish` returns its error.
        let _ = ended.flush();
        let flushed_bytes = ended.bytes();
        for (topic, parts) in self.parts.iter_mut().enumerate() {
            parts.written += ended.written_of(topic);
            parts.refused += ended.refused_of(topic);
        }
        let ended = self.finish(ended, &losses).map_err(|(error, _)| error);
        for loss in losses {
            if let Some(parts) = self.parts.get_mut(loss.topic as usize) {
                parts.before = loss;
            }
        }
        self.publish_all();
        self.end.shared.part_bytes.store(0, Ordering::Relaxed);
        let bytes = ended.as_ref().map_or(flushed_bytes, |summary| summary.bytes);
        self.ring.end_part(&mut request, self.state.part, at_ns, bytes);
        self.state = StartRequest { part, created: 0, ..request };
        self.save_state();
        self.report(Outcome::NextPart { path, ended, ring: self.ring.parts(&self.state) });
    }

    /// Where the present part ends: behind the newest messages, or where its file failed, behind
    /// those that are in it.
    fn positions(&self) -> Positions {
        let failed = self.writer.as_ref().filter(|writer| writer.error().is_some());
        if let Some(failed) = failed
            && let Ok(part) = Recording::open_damaged(failed.path())
            && let Ok(found) = part.end_positions()
        {
            return found;
        }
        let newest = self.parts.iter().zip(TOPICS);
        newest.filter_map(|(of, topic)| Some((topic.name.to_owned(), of.position?))).collect()
    }

    /// Tells that the next part could not be begun, for which old ones may have been `removed`.
    fn not_split(&self, error: &WriteError, removed: bool) {
        // Their names may be somebody's from now on.
        if removed {
            self.save_state();
        }
        let present = match self.writer.as_ref().and_then(Writer::error) {
            None => "this one goes on".to_owned(),
            Some(cause) => format!("this one takes nothing any more ({cause})"),
        };
        let error = format!("the next part cannot be begun, and {present}: {error}");
        self.report(Outcome::NotSplit { error, ring: self.ring.parts(&self.state) });
    }

    /// Writes the run into the file behind everything that was pushed before.
    fn note_run(&mut self, run: BTreeMap<String, String>) {
        while self.drain(BATCH) > 0 {}
        let Some(writer) = &mut self.writer else { return };
        if !run.is_empty()
            && writer.error().is_none()
            && let Err(error) = writer.write_run(&run)
        {
            self.failed(&error);
        }
        self.state.run = run;
        self.save_state();
    }

    fn save_state(&self) {
        if let Some(directory) = self.state_directory
            && let Err(error) = state::save(directory, &self.state)
        {
            self.report(Outcome::StateNotKept { error: error.to_string() });
        }
    }

    /// Writes what is queued (everything pushed before the command), then ends the file. `losses`
    /// are the counters of the recording.
    fn stop(&mut self, losses: &[LossCounters], clear_state: bool) {
        while self.drain(BATCH) > 0 {}
        if clear_state
            && let Some(directory) = self.state_directory
            && let Err(error) = state::clear(directory)
        {
            self.report(Outcome::StateNotKept { error: error.to_string() });
        }
        // The counters must hold what the last flush refuses; `finish` returns its error.
        if let Some(writer) = &mut self.writer {
            let _ = writer.flush();
        }
        self.publish_all();
        let Some(writer) = self.writer.take() else { return };
        self.report(match self.finish(writer, losses) {
            Ok(summary) => Outcome::Stopped(summary),
            Err((error, refused)) => Outcome::StoppedWithError { error, refused },
        });
    }

    /// Ends the file of a part with its own counters: those of the recording without those up to
    /// its beginning. The error comes with the messages that the file refused.
    fn finish(&self, writer: Writer, losses: &[LossCounters]) -> Result<Summary, (String, u64)> {
        let of_part = |loss: &LossCounters| {
            let topic = loss.topic as usize;
            let before = self.parts.get(topic).map(|parts| parts.before).unwrap_or_default();
            LossCounters {
                received: loss.received.saturating_sub(before.received),
                gaps: loss.gaps.saturating_sub(before.gaps),
                dropped: loss.dropped.saturating_sub(before.dropped),
                written: writer.written_of(topic),
                refused: writer.refused_of(topic),
                ..*loss
            }
        };
        let losses: Vec<LossCounters> = losses.iter().map(of_part).collect();
        let refused = writer.refused();
        writer.finish(&losses).map_err(|error| {
            let refused = match &error {
                WriteError::DiskFull { refused, .. }
                | WriteError::Disk { refused, .. }
                | WriteError::Poisoned { refused, .. } => *refused,
                _ => refused,
            };
            (error.to_string(), refused)
        })
    }
}
