//! The process: shared memory to the sink, counters and requests beside it.

mod desk;

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};

use ipc_types::{
    CLOCK, ClockSync, Event, EventKind, Heartbeat, LOSS, LoggerAnswer, LoggerRequest, LossCounters,
    Process, Severity, TOPICS, heartbeat_topic,
};
use recording::mcap_write::key;
use rig::RigFile;
use runtime::clock::{ClockPair, MILLISECOND_NS, SECOND_NS, now_ns};
use runtime::{Grid, PortError, Publisher, RawSubscriber, Service, ServiceError, open_raw};
use thiserror::Error;

use crate::sink::{Outcome, Sink, SinkError, StartRequest};
use crate::state;

use desk::{Desk, Question};

/// The shortest buffer of a topic at its fastest rate holds 100 ms and more; this leaves room for a
/// late wake.
const PERIOD_NS: u64 = 5 * MILLISECOND_NS;
/// Away from the tick at which the fast loops run.
const PHASE_NS: u64 = 700_000;
/// Period of the heartbeat.
const HEARTBEAT_NS: u64 = 50 * MILLISECOND_NS;
/// How long a recording asked for at the start may take to begin.
const BEGIN_LIMIT: Duration = Duration::from_secs(5);
/// Says for which session the recording asked for at the start has begun, so that a restart does
/// not begin it again.
const BEGUN: &str = "recording.begun";
/// Name of the domain, beside the name that the rig file gives.
const RIG_NAME: &str = "rig_name";
/// Session of the rig.
const SESSION: &str = "session";

/// What the process is started with.
#[derive(Clone, Debug)]
pub struct Options {
    /// Name of the rig.
    pub rig_name: String,
    /// Its rig file.
    pub rig_file: PathBuf,
    /// Absolute path of a recording that begins at once, once a session.
    pub record: Option<PathBuf>,
    /// What it shall say about itself, beside what the logger adds.
    pub metadata: BTreeMap<String, String>,
}

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum LoggerError {
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
    #[error(transparent)]
    Sink(#[from] SinkError),
    #[error("{0} has no topic for its heartbeat")]
    NoTopic(Process),
    #[error("{}: cannot keep the logger's state: {source}", path.display())]
    StateDirectory { path: PathBuf, source: io::Error },
    /// The recording that was asked for at the start did not begin.
    #[error("recording to {} did not begin: {reason}", path.display())]
    NotBegun { path: PathBuf, reason: String },
    /// The file could not be ended in good order.
    #[error("{reason}")]
    BadEnd { reason: String },
    #[error("the thread that answers requests ended")]
    DeskClosed,
}

/// Runs the logger until a signal ends it.
///
/// # Errors
/// [`LoggerError`]; a disk that fills up within a recording is none.
pub fn run(options: &Options) -> Result<(), LoggerError> {
    let rig = RigFile::load(&options.rig_file)?;
    Logger::new(Service::start(Process::Logger, &options.rig_name)?, &rig, options)?.run()
}

/// The logger, joined to a rig.
pub struct Logger {
    service: Service,
    topics: Vec<Box<dyn RawSubscriber>>,
    heartbeats: Publisher<Heartbeat>,
    losses: Publisher<LossCounters>,
    clocks: Publisher<ClockSync>,
    /// taken from the service once it is ready
    events: Option<Publisher<Event>>,
    sink: Sink,
    desk: Desk,
    metadata: BTreeMap<String, String>,
    /// realtime minus monotonic of the recording (ns)
    file_offset_ns: i64,
    /// losses of each topic that were told as events
    told: Vec<u64>,
    starting: Option<SyncSender<LoggerAnswer>>,
    ending: Option<SyncSender<LoggerAnswer>>,
}

impl std::fmt::Debug for Logger {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Logger")
            .field("service", &self.service)
            .field("sink", &self.sink)
            .finish_non_exhaustive()
    }
}

impl Logger {
    /// Subscribes to everything and begins, or goes on with, the recording that there shall be.
    ///
    /// # Errors
    /// Those of the ports; [`LoggerError::NotBegun`] if the recording asked for cannot be begun.
    pub fn new(service: Service, rig: &RigFile, options: &Options) -> Result<Self, LoggerError> {
        let directory = service.domain().name().run_directory();
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&directory)
            .map_err(|source| LoggerError::StateDirectory { path: directory.clone(), source })?;
        // First the subscriptions: what is published while the file is being made waits in their
        // buffers.
        let mut topics = Vec::with_capacity(TOPICS.len());
        for topic in TOPICS {
            topics.push(open_raw(service.node(), topic)?);
        }
        let heartbeat =
            heartbeat_topic(Process::Logger).ok_or(LoggerError::NoTopic(Process::Logger))?;
        let session = service.identity().session;
        let mut metadata = options.metadata.clone();
        metadata.extend(
            [
                (key::RIG, rig.name.clone()),
                (key::RIG_FILE, rig.text().to_owned()),
                (key::PROFILE, service.domain().profile().text().to_owned()),
                (key::VERSION, env!("CARGO_PKG_VERSION").to_owned()),
                (key::REVISION, revision()),
                (RIG_NAME, service.domain().name().to_string()),
                (SESSION, format!("{session:016x}")),
            ]
            .map(|(key, value)| (key.to_owned(), value)),
        );
        let mut logger = Self {
            heartbeats: service.publisher(heartbeat)?,
            losses: service.publisher(LOSS)?,
            clocks: service.publisher(CLOCK)?,
            events: None,
            desk: Desk::open(service.domain().name())?,
            sink: Sink::new(Some(directory.clone()))?,
            service,
            topics,
            metadata,
            file_offset_ns: 0,
            told: vec![0; TOPICS.len()],
            starting: None,
            ending: None,
        };
        logger.begin(&directory, options.record.as_deref())?;
        Ok(logger)
    }

    /// Raise it to end [`Logger::run`]; signals do.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        self.service.stop_flag()
    }

    /// Goes on with what was being recorded when the logger died, else begins what was asked for.
    fn begin(&mut self, directory: &Path, record: Option<&Path>) -> Result<(), LoggerError> {
        let session = self.service.identity().session;
        self.sink.tick(now_ns());
        let kept = match state::load(directory, session) {
            Ok(kept) => kept,
            Err(error) => {
                self.tell(EventKind::DataLost, Severity::Error, [0.0; 3], &error.to_string())?;
                None
            }
        };
        let mark = format!("{session:016x}");
        let begun = fs::read_to_string(directory.join(BEGUN)).is_ok_and(|text| text.trim() == mark);
        let set_mark = || {
            let path = directory.join(BEGUN);
            fs::write(&path, &mark).map_err(|source| LoggerError::StateDirectory { path, source })
        };
        if let Some(kept) = kept {
            // A logger that was killed between the beginning and its mark would ask for part 1 anew
            // once this is ended.
            if record == Some(kept.path.as_path()) {
                set_mark()?;
            }
            let request = StartRequest::going_on(kept);
            let path = request.path.clone();
            if let Err(reason) = self.start_and_wait(request)? {
                // A person can begin another one as long as the logger lives.
                let text = format!("{} does not go on: {reason}", path.display());
                self.tell(EventKind::DataLost, Severity::Error, [0.0; 3], &text)?;
            }
        } else if let Some(path) = record
            && !begun
        {
            let request = self.request(path.to_owned(), BTreeMap::new());
            if let Err(reason) = self.start_and_wait(request)? {
                return Err(LoggerError::NotBegun { path: path.to_owned(), reason });
            }
            set_mark()?;
        }
        Ok(())
    }

    fn request(&self, path: PathBuf, mut metadata: BTreeMap<String, String>) -> StartRequest {
        // What the logger knows by itself is not overridden.
        metadata.extend(self.metadata.clone());
        StartRequest {
            path,
            part: 1,
            metadata,
            realtime_offset_ns: ClockPair::measure().offset_ns(),
            session: self.service.identity().session,
        }
    }

    fn start(&mut self, request: StartRequest) -> Result<(), SinkError> {
        let offset = request.realtime_offset_ns;
        self.sink.start(request)?;
        self.file_offset_ns = offset;
        self.told.fill(0);
        Ok(())
    }

    /// Begins a recording before the loop runs. The inner error says why it did not begin.
    fn start_and_wait(&mut self, request: StartRequest) -> Result<Result<(), String>, LoggerError> {
        match self.start(request) {
            Err(error @ SinkError::Thread { .. }) => return Err(error.into()),
            Err(error) => return Ok(Err(error.to_string())),
            Ok(()) => {}
        }
        let asked = Instant::now();
        while asked.elapsed() < BEGIN_LIMIT {
            match self.sink.wait(BEGIN_LIMIT) {
                Some(Outcome::NotStarted { error, .. }) => return Ok(Err(error)),
                Some(outcome) => {
                    let begun = matches!(outcome, Outcome::Started { .. });
                    self.outcome(outcome)?;
                    if begun {
                        return Ok(Ok(()));
                    }
                }
                None => break,
            }
        }
        Ok(Err(format!("the disk did not answer within {BEGIN_LIMIT:?}")))
    }

    /// Records until a signal asks it to end, then ends the file in good order.
    ///
    /// # Errors
    /// Those of the ports; [`LoggerError::BadEnd`] where the file could not be ended in good order.
    pub fn run(mut self) -> Result<(), LoggerError> {
        let mut grid = Grid::new(PERIOD_NS, PHASE_NS);
        self.service.ready()?;
        self.events = self.service.take_events();
        let (mut last_beat, mut last_count) = (0, 0);
        while !self.service.stopping() {
            let Some(wake) = grid.wait() else { continue };
            self.drain()?;
            self.sink.tick(wake.woke_ns);
            while let Some(outcome) = self.sink.poll() {
                self.outcome(outcome)?;
            }
            while let Some(question) = self.desk.next() {
                self.answer(question)?;
            }
            // Slots of the clock, not times since the last one: a late wake does not lower the
            // rate.
            let (beat, count) = (wake.woke_ns / HEARTBEAT_NS, wake.woke_ns / SECOND_NS);
            if beat != last_beat {
                last_beat = beat;
                self.heartbeat()?;
            }
            if count != last_count {
                last_count = count;
                self.tell_losses()?;
                self.publish_counts()?;
                if self.desk.is_closed() {
                    return Err(LoggerError::DeskClosed);
                }
            }
            self.service.beat();
        }
        self.end()
    }

    /// Takes out of shared memory what is there now. What is published while it does so is left for
    /// the next time, so that it comes to an end; a buffer never holds more than its length.
    fn drain(&mut self) -> Result<(), PortError> {
        for (index, (subscriber, topic)) in self.topics.iter_mut().zip(TOPICS).enumerate() {
            let sink = &mut self.sink;
            // A topic that is not recorded is counted by nobody else either: it is read and
            // dropped.
            let mut push = |bytes: &[u8]| {
                if topic.recorded {
                    sink.push(index, bytes);
                }
            };
            for _ in 0..topic.buffer {
                if !subscriber.take(&mut push)? {
                    break;
                }
            }
        }
        Ok(())
    }

    fn answer(&mut self, question: Question) -> Result<(), LoggerError> {
        let Question { request, reply } = question;
        let result = match request {
            LoggerRequest::Status => {
                let _ = reply.send(self.sink.status());
                return Ok(());
            }
            LoggerRequest::Start { path, metadata } => {
                let request = self.request(path.into(), metadata.into_iter().collect());
                self.start(request).map(|()| self.starting = Some(reply.clone()))
            }
            LoggerRequest::Stop => {
                // Everything published before the request was made is in the buffers by now.
                self.drain()?;
                self.sink.stop().map(|()| self.ending = Some(reply.clone()))
            }
        };
        match result {
            Ok(()) => Ok(()),
            Err(error @ SinkError::Thread { .. }) => Err(error.into()),
            Err(error) => {
                // Whoever asked is gone if this fails.
                let _ = reply.send(LoggerAnswer { error: error.to_string(), ..self.sink.status() });
                Ok(())
            }
        }
    }

    /// Tells what the writing thread reported: as an event, and to whoever asked for it.
    fn outcome(&mut self, outcome: Outcome) -> Result<(), PortError> {
        let (kind, severity, values, text) = match &outcome {
            Outcome::Started { path } => (
                EventKind::RecordingStarted,
                Severity::Info,
                [0.0; 3],
                ending_of(&path.to_string_lossy()).to_owned(),
            ),
            Outcome::Stopped(summary) => {
                let lost = self.sink.status().lost;
                let text = ending_of(&summary.path.to_string_lossy()).to_owned();
                let values = [summary.written as f64, lost as f64, summary.bytes as f64];
                (EventKind::RecordingStopped, Severity::Info, values, text)
            }
            Outcome::StoppedWithError { error, refused, .. } => {
                let written = self.sink.status().written as f64;
                (
                    EventKind::RecordingStopped,
                    Severity::Error,
                    [written, *refused as f64, 0.0],
                    error.clone(),
                )
            }
            Outcome::Failed { error, .. } => (
                EventKind::DataLost,
                Severity::Error,
                [self.sink.status().lost as f64, 0.0, 0.0],
                error.clone(),
            ),
            Outcome::NotStarted { error, .. } => {
                (EventKind::RecordingStopped, Severity::Error, [0.0; 3], error.clone())
            }
            Outcome::StateNotKept { error } => {
                (EventKind::RecordingStarted, Severity::Warning, [0.0; 3], error.clone())
            }
        };
        self.tell(kind, severity, values, &text)?;
        let asker = match &outcome {
            Outcome::Started { .. } | Outcome::NotStarted { .. } => self.starting.take(),
            Outcome::Stopped(_) | Outcome::StoppedWithError { .. } => self.ending.take(),
            Outcome::Failed { .. } | Outcome::StateNotKept { .. } => None,
        };
        if let Some(asker) = asker {
            let _ = asker.send(self.sink.status());
        }
        Ok(())
    }

    fn tell(
        &mut self,
        kind: EventKind,
        severity: Severity,
        [a, b, c]: [f64; 3],
        text: &str,
    ) -> Result<(), PortError> {
        match &mut self.events {
            Some(events) => events
                .send(Event { a, b, c, ..Event::new(Process::Logger, kind, severity, text) })
                .map(|_sequence| ()),
            None => self.service.event(kind, severity, [a, b, c], text),
        }
    }

    fn heartbeat(&mut self) -> Result<(), PortError> {
        // Whoever joined since the last event gets the ones before only through this.
        if let Some(events) = &self.events {
            events.refresh();
        }
        let lost = (0..TOPICS.len())
            .map(|topic| self.sink.counters(topic))
            .map(|c| c.gaps + c.dropped + c.refused);
        let message = Heartbeat {
            lost: lost.sum::<u64>() + self.sink.unknown(),
            queued: self.sink.queued() as u64,
            pid: std::process::id(),
            source: Process::Logger.code(),
            state: u8::from(self.sink.recording()),
            profile: self.service.domain().profile().code(),
            ..Heartbeat::default()
        };
        self.heartbeats.send(message)?;
        Ok(())
    }

    fn publish_counts(&mut self) -> Result<(), PortError> {
        for topic in 0..TOPICS.len() {
            self.losses.send(self.sink.counters(topic))?;
        }
        let pair = ClockPair::measure();
        self.clocks.send(ClockSync {
            monotonic_ns: pair.monotonic_ns,
            realtime_ns: pair.realtime_ns,
            file_offset_ns: if self.sink.recording() { self.file_offset_ns } else { 0 },
            uncertainty_ns: pair.uncertainty_ns,
            ..ClockSync::default()
        })?;
        Ok(())
    }

    /// An event for each topic that lost messages of the recording since the last look. What a
    /// failed disk refuses is told once, when it fails, and counted from then on.
    fn tell_losses(&mut self) -> Result<(), PortError> {
        for (index, topic) in TOPICS.iter().enumerate() {
            let counts = self.sink.losses(index);
            let lost = counts.gaps + counts.dropped;
            let told = std::mem::replace(&mut self.told[index], lost);
            if self.sink.recording() && lost > told {
                let text = format!(
                    "{}: in all {} never reached the logger, {} found its queue full",
                    topic.name, counts.gaps, counts.dropped
                );
                let values = [(lost - told) as f64, lost as f64, index as f64];
                self.tell(EventKind::DataLost, Severity::Error, values, &text)?;
            }
        }
        Ok(())
    }

    /// The last of everything into the file, then its end. The state is kept: a logger that is
    /// started again in this session goes on with the next part.
    fn end(mut self) -> Result<(), LoggerError> {
        self.tell_losses()?;
        self.publish_counts()?;
        self.tell(EventKind::ProcessEnding, Severity::Info, [0.0; 3], "")?;
        self.drain()?;
        self.sink.tick(now_ns());
        let outcomes = self.sink.end();
        let mut result = Ok(());
        for outcome in outcomes {
            if let Outcome::StoppedWithError { error, .. } = &outcome {
                result = Err(LoggerError::BadEnd { reason: error.clone() });
            }
            self.outcome(outcome)?;
        }
        result
    }
}

/// The end of a path that is too long for an event: its file name is what tells it from others.
fn ending_of(path: &str) -> &str {
    let mut start = path.len().saturating_sub(ipc_types::TEXT);
    while !path.is_char_boundary(start) {
        start += 1;
    }
    &path[start..]
}

/// Git revision of the build, as every recording carries it; `unknown` where the build had none.
pub fn revision() -> String {
    std::env::var("FARREACH_REVISION")
        .ok()
        .or_else(|| option_env!("FARREACH_REVISION").map(str::to_owned))
        .filter(|revision| !revision.is_empty())
        .unwrap_or_else(|| "unknown".to_owned())
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
