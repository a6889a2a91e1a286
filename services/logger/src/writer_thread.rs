//! The thread that owns the file. It may wait for the disk; the process loop never waits for it.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender, TryRecvError};
use std::time::Duration;

use ipc_types::LossCounters;
use recording::mcap_write::{Start, WriteError, Writer, key};

use crate::state::{self, StartRequest};
use crate::writer_queue::{Command, Outcome, QueueReceiver, Shared};

/// Sleep when there is nothing to do; the queue holds seconds of messages.
const IDLE: Duration = Duration::from_millis(5);
/// Messages written between two checks of the time and the commands.
const BATCH: usize = 512;
/// Most parts of one recording.
const PARTS_MAX: u32 = 10_000;

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
        }
    }

    /// Writes what waits, and carries out the next command.
    pub(crate) fn turn(&mut self) -> Turn {
        let worked = self.drain(BATCH);
        self.tick();
        match self.end.inbox.try_recv() {
            Ok(Command::Start { generation, request }) => self.start(generation, request),
            Ok(Command::NoteRun { run }) => self.note_run(run),
            Ok(Command::Stop { losses }) => self.stop(losses, true),
            Ok(Command::Quit { losses }) => {
                self.stop(losses, false);
                return Turn::Ended;
            }
            Err(TryRecvError::Disconnected) => {
                self.stop(Vec::new(), false);
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
        let (Some(writer), Some(written), Some(refused)) =
            (&self.writer, self.end.shared.written.get(topic), self.end.shared.refused.get(topic))
        else {
            return;
        };
        written.store(writer.written_of(topic), Ordering::Relaxed);
        refused.store(writer.refused_of(topic), Ordering::Relaxed);
    }

    fn publish_all(&self) {
        (0..self.end.shared.written.len()).for_each(|topic| self.publish(topic));
    }

    fn tick(&mut self) {
        let now_ns = self.now_ns();
        if let Some(writer) = &mut self.writer
            && let Err(error) = writer.tick(now_ns)
        {
            self.failed(&error);
        }
    }

    fn start(&mut self, generation: u32, request: StartRequest) {
        self.generation = generation;
        let shared = &self.end.shared;
        for count in shared.written.iter().chain(&shared.refused) {
            count.store(0, Ordering::Relaxed);
        }
        // From here on the counters are those of this recording.
        shared.generation.store(generation, Ordering::Release);
        let mut part = request.part.max(1);
        let opened = loop {
            let path = recording::part_path(&request.path, part);
            let start = Start {
                realtime_offset_ns: request.realtime_offset_ns,
                metadata: request.metadata.clone(),
                continues: request.continues.clone(),
                run: request.run.clone(),
            }
            .with(key::PART, &part.to_string());
            match (self.opener)(&path, &start, self.now_ns()) {
                // Part 1 gets exactly the name requested: an existing file is somebody's data.
                Err(WriteError::Exists { .. }) if part > 1 && part < PARTS_MAX => part += 1,
                other => break other,
            }
        };
        match opened {
            Ok(writer) => {
                let path = writer.path().to_owned();
                self.writer = Some(writer);
                self.state = StartRequest { part, ..request };
                self.save_state();
                self.report(Outcome::Started { path });
            }
            Err(error) => self.report(Outcome::NotStarted { error: error.to_string() }),
        }
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

    /// Writes what is queued (everything pushed before the command), then ends the file.
    fn stop(&mut self, mut losses: Vec<LossCounters>, clear_state: bool) {
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
        for loss in &mut losses {
            let topic = loss.topic as usize;
            loss.written = writer.written_of(topic);
            loss.refused = writer.refused_of(topic);
        }
        let refused = writer.refused();
        match writer.finish(&losses) {
            Ok(summary) => self.report(Outcome::Stopped(summary)),
            Err(error) => {
                let refused = match &error {
                    WriteError::DiskFull { refused, .. }
                    | WriteError::Disk { refused, .. }
                    | WriteError::Poisoned { refused, .. } => *refused,
                    _ => refused,
                };
                self.report(Outcome::StoppedWithError { error: error.to_string(), refused });
            }
        }
    }
}
