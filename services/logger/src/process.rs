//! The process: messages from shared memory to the recorder, requests, counters and events.

mod answers;
mod machine;
mod replacements;
mod reports;
mod requests;

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};

use ipc_types::{
    CLOCK, ClockSync, Event, EventKind, Heartbeat, LOSS, LoggerAnswer, LossCounters, Message,
    Process, Severity, Split, TOPICS,
};
use recording::mcap_read::Recording;
use recording::mcap_write::{Positions, key};
use recording::replaced::Replaced;
use rig::RigFile;
use runtime::clock::{ClockPair, MILLISECOND_NS, SECOND_NS, now_ns};
use runtime::{Grid, PortError, Publisher, RawSubscriber, Service, ServiceError, open_raw};
use thiserror::Error;

use crate::recorder_front_end::{Outcome, RecorderError, RecorderFrontEnd, StartRequest};
use crate::state;

use machine::{doctor_report, in_words};
use replacements::Replacements;
use requests::RequestReceiver;

/// Every topic's buffer holds at least 100 ms at its fastest rate, which leaves margin for a late
/// wake.
const PERIOD_NS: u64 = 10 * MILLISECOND_NS;
/// Away from the phases of the fast loops.
const PHASE_NS: u64 = 700_000;
/// Period of the heartbeat.
const HEARTBEAT_NS: u64 = 50 * MILLISECOND_NS;
/// How long a recording requested at the start may take to begin.
const BEGIN_LIMIT: Duration = Duration::from_secs(5);
/// File that names the session in which the recording requested at the start has begun, so that a
/// restart does not begin it again.
const BEGUN: &str = "recording.begun";

/// What is to be recorded from the start.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Absolute path of a recording that begins at the start, once a session.
    pub record: Option<PathBuf>,
    /// Metadata of the recording, beside those that the logger adds.
    pub metadata: BTreeMap<String, String>,
    /// Folder of the doctor's reports.
    pub doctor: Option<PathBuf>,
}

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum LoggerError {
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
    #[error(transparent)]
    Recorder(#[from] RecorderError),
    #[error("{path}: cannot save the logger's state: {source}")]
    StateDirectory { path: PathBuf, source: io::Error },
    /// The recording requested at the start did not begin.
    #[error("recording to {path} did not begin: {reason}")]
    NotBegun { path: PathBuf, reason: String },
    /// The file could not be ended cleanly.
    #[error("{reason}")]
    BadEnd { reason: String },
    #[error("the thread that receives requests ended")]
    RequestsClosed,
}

/// Runs the logger on the rig of that name until a signal ends it.
///
/// # Errors
/// [`LoggerError`]; a disk that fills up during a recording is none.
pub fn run(rig_name: &str, rig: &RigFile, options: &Options) -> Result<(), LoggerError> {
    Logger::new(Service::start(Process::Logger, rig_name)?, rig, options)?.run()
}

/// The logger, connected to a rig.
pub struct Logger {
    service: Service,
    topics: Vec<Box<dyn RawSubscriber>>,
    heartbeats: Publisher<Heartbeat>,
    losses: Publisher<LossCounters>,
    clocks: Publisher<ClockSync>,
    recorder: RecorderFrontEnd,
    requests: RequestReceiver,
    metadata: BTreeMap<String, String>,
    doctor: Option<PathBuf>,
    replacements: Replacements,
    /// the protocol that is being played; empty where none is
    run: BTreeMap<String, String>,
    /// realtime minus monotonic of the recording (ns)
    file_offset_ns: i64,
    /// losses of each topic already reported as events
    reported_losses: Vec<u64>,
    start_reply: Option<SyncSender<LoggerAnswer>>,
    stop_reply: Option<SyncSender<LoggerAnswer>>,
    /// whoever wants the next part, until it is asked for, and from then on
    part_wanted: Option<SyncSender<LoggerAnswer>>,
    part_reply: Option<SyncSender<LoggerAnswer>>,
}

impl std::fmt::Debug for Logger {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Logger")
            .field("service", &self.service)
            .field("recorder", &self.recorder)
            .finish_non_exhaustive()
    }
}

impl Logger {
    /// Subscribes to all topics and begins the recording requested, or continues the one that was
    /// in progress when the logger died.
    ///
    /// # Errors
    /// Those of the ports; [`LoggerError::NotBegun`] if the recording requested cannot be begun.
    pub fn new(service: Service, rig: &RigFile, options: &Options) -> Result<Self, LoggerError> {
        let directory = service.domain().name().make_run_directory().map_err(ServiceError::from)?;
        // Reading the part before may take a while on hours of recording: before the subscriptions,
        // so that their buffers do not overflow meanwhile.
        let kept = kept_state(&directory, service.identity().session);
        // Messages published while the file is being created wait in the buffers.
        let mut topics = Vec::with_capacity(TOPICS.len());
        for topic in TOPICS {
            topics.push(open_raw(service.node(), topic)?);
        }
        let mut metadata = options.metadata.clone();
        metadata.extend(rig_metadata(rig));
        metadata.extend(
            [
                (key::PROFILE, service.domain().profile().text().to_owned()),
                (key::VERSION, env!("CARGO_PKG_VERSION").to_owned()),
                (key::REVISION, revision()),
                (key::KERNEL, kernel()),
                (key::RIG_NAME, service.domain().name().to_string()),
                (key::SESSION, format!("{:016x}", service.identity().session)),
            ]
            .map(|(key, value)| (key.to_owned(), value)),
        );
        if let Some(placement) = in_words(service.domain().placement()) {
            metadata.insert(key::PLACEMENT.to_owned(), placement);
        }
        if let Some(stall) = service.domain().host_stall() {
            metadata.insert(key::HOST_STALL.to_owned(), stall.to_string());
        }
        let mut logger = Self {
            heartbeats: service.heartbeat_publisher()?,
            losses: service.publisher(LOSS)?,
            clocks: service.publisher(CLOCK)?,
            requests: RequestReceiver::open(service.domain().name())?,
            recorder: RecorderFrontEnd::new(Some(directory.clone()))?,
            service,
            topics,
            metadata,
            doctor: options.doctor.clone(),
            replacements: Replacements::new(&directory),
            run: BTreeMap::new(),
            file_offset_ns: 0,
            reported_losses: vec![0; TOPICS.len()],
            start_reply: None,
            stop_reply: None,
            part_wanted: None,
            part_reply: None,
        };
        logger.begin(kept, &directory, options.record.as_deref())?;
        Ok(logger)
    }

    /// The flag that ends [`Logger::run`]; signals raise it.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        self.service.stop_flag()
    }

    /// Continues the recording that was in progress when the logger died, else begins the one
    /// requested.
    fn begin(
        &mut self,
        kept: Result<Option<StartRequest>, String>,
        directory: &Path,
        record: Option<&Path>,
    ) -> Result<(), LoggerError> {
        let session = self.service.identity().session;
        self.recorder.tick(now_ns());
        let kept = match kept {
            Ok(kept) => kept,
            Err(error) => {
                self.service.event(EventKind::DataLost, Severity::Error, [0.0; 3], &error)?;
                None
            }
        };
        let mark = format!("{session:016x}");
        let begun = fs::read_to_string(directory.join(BEGUN)).is_ok_and(|text| text.trim() == mark);
        let set_mark = || {
            let path = directory.join(BEGUN);
            fs::write(&path, &mark).map_err(|source| LoggerError::StateDirectory { path, source })
        };
        if let Some(mut request) = kept {
            // A logger that was killed between the start of the recording and its mark would begin
            // part 1 again once this part is ended.
            if record == Some(request.path.as_path()) {
                set_mark()?;
            }
            self.run.clone_from(&request.run);
            let path = request.path.clone();
            let now = self.replacements.now().to_text();
            let then = request.metadata.insert(key::REPLACED.to_owned(), now);
            if let Err(reason) = self.start_and_wait(request)? {
                // No reason to end: a person can begin another recording.
                let text = format!("{} does not continue: {reason}", path.display());
                self.service.event(EventKind::DataLost, Severity::Error, [0.0; 3], &text)?;
            }
            // What changed while no logger ran is told in the part that has begun.
            let changes = then.map(|then| self.replacements.since(&Replaced::of_text(&then)));
            self.tell(changes.unwrap_or_default())?;
        } else if let Some(path) = record
            && !begun
        {
            let request = self.start_request(path.to_owned(), BTreeMap::new(), Split::default());
            if let Err(reason) = self.start_and_wait(request)? {
                return Err(LoggerError::NotBegun { path: path.to_owned(), reason });
            }
            set_mark()?;
        }
        Ok(())
    }

    fn start_request(
        &self,
        path: PathBuf,
        mut metadata: BTreeMap<String, String>,
        split: Split,
    ) -> StartRequest {
        // The logger's own entries take precedence.
        metadata.extend(self.metadata.clone());
        metadata.extend(doctor_report(self.doctor.as_deref(), self.service.domain().name()));
        metadata.insert(key::REPLACED.to_owned(), self.replacements.now().to_text());
        let seconds = |keep_ns: u64| format!("{} s", keep_ns as f64 / SECOND_NS as f64);
        metadata.extend(split.keep_ns.map(|keep_ns| (key::RING.to_owned(), seconds(keep_ns))));
        StartRequest {
            path,
            part: 1,
            metadata,
            realtime_offset_ns: ClockPair::measure().offset_ns(),
            session: self.service.identity().session,
            run: self.run.clone(),
            split,
            ..StartRequest::default()
        }
    }

    fn start(&mut self, request: StartRequest) -> Result<(), RecorderError> {
        let offset = request.realtime_offset_ns;
        self.recorder.start(request)?;
        self.file_offset_ns = offset;
        self.reported_losses.fill(0);
        Ok(())
    }

    /// Begins a recording before the loop runs. The inner error is why it did not begin.
    fn start_and_wait(&mut self, request: StartRequest) -> Result<Result<(), String>, LoggerError> {
        match self.start(request) {
            Err(error @ RecorderError::Thread { .. }) => return Err(error.into()),
            Err(error) => return Ok(Err(error.to_string())),
            Ok(()) => {}
        }
        let requested = Instant::now();
        while requested.elapsed() < BEGIN_LIMIT {
            match self.recorder.wait(BEGIN_LIMIT) {
                Some(Outcome::NotStarted { error }) => return Ok(Err(error)),
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

    /// Records until a signal ends it, then ends the file cleanly.
    ///
    /// # Errors
    /// Those of the ports; [`LoggerError::BadEnd`] where the file could not be ended cleanly.
    pub fn run(mut self) -> Result<(), LoggerError> {
        let mut grid = Grid::new(PERIOD_NS, PHASE_NS);
        self.service.ready()?;
        let (mut last_beat, mut last_count) = (0, 0);
        while !self.service.stopping() {
            let Some(wake) = grid.wait() else { continue };
            self.drain()?;
            self.recorder.tick(wake.woke_ns);
            while let Some(outcome) = self.recorder.poll() {
                self.outcome(outcome)?;
            }
            self.next_part()?;
            while let Some(request) = self.requests.next() {
                self.answer(request)?;
            }
            // By slots of the clock, so that a late wake does not lower the rate.
            let (beat, count) = (wake.woke_ns / HEARTBEAT_NS, wake.woke_ns / SECOND_NS);
            if beat != last_beat {
                last_beat = beat;
                self.report_replacements()?;
                self.heartbeat()?;
            }
            if count != last_count {
                last_count = count;
                self.report_losses()?;
                self.publish_counts()?;
                if self.requests.is_closed() {
                    return Err(LoggerError::RequestsClosed);
                }
            }
            self.service.beat();
        }
        self.end()
    }

    /// Goes on in the next part, where it is time for it or somebody wants it. It says for itself
    /// which programs run by now.
    fn next_part(&mut self) -> Result<(), LoggerError> {
        // One that is asked for already holds only what came before the request.
        if !self.recorder.splitting()
            && let Some(reply) = self.part_wanted.take()
        {
            self.part_reply = Some(reply);
        } else if !self.recorder.split_due() {
            return Ok(());
        }
        self.report_replacements()?;
        self.drain()?;
        let replaced = (key::REPLACED.to_owned(), self.replacements.now().to_text());
        match self.recorder.split(BTreeMap::from([replaced])) {
            // Stopped meanwhile.
            Err(error @ RecorderError::NotRecording) => {
                if let Some(reply) = self.part_reply.take() {
                    let error = error.to_string();
                    let _ = reply.send(LoggerAnswer { error, ..self.recorder.status() });
                }
                Ok(())
            }
            result => Ok(result?),
        }
    }

    /// Takes the messages that are in shared memory now; at most a buffer's length of each topic,
    /// so that a fast sender cannot keep it busy for ever.
    fn drain(&mut self) -> Result<(), PortError> {
        let mut ended = false;
        for (index, (subscriber, topic)) in self.topics.iter_mut().zip(TOPICS).enumerate() {
            let recorder = &mut self.recorder;
            let mut push = |bytes: &[u8]| {
                recorder.push(index, bytes);
                ended |= topic.type_name == Event::TYPE_NAME && ends_run(bytes);
            };
            for _ in 0..topic.buffer {
                if !subscriber.take(&mut push)? {
                    break;
                }
            }
        }
        if ended && !self.run.is_empty() {
            self.run.clear();
            // A writer thread that has ended is reported with the next request.
            let _ = self.recorder.note_run(BTreeMap::new());
        }
        Ok(())
    }

    /// Writes the last messages and ends the file. The state is kept: a logger that is started
    /// again in this session continues with the next part.
    fn end(mut self) -> Result<(), LoggerError> {
        self.report_losses()?;
        self.report_replacements()?;
        self.publish_counts()?;
        self.service.end()?;
        self.drain()?;
        self.recorder.tick(now_ns());
        let outcomes = self.recorder.end();
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

/// The recording that was in progress when the logger died, if it belongs to this session.
fn kept_state(directory: &Path, session: u64) -> Result<Option<StartRequest>, String> {
    let Some(state) = state::load(directory, session).map_err(|error| error.to_string())? else {
        return Ok(None);
    };
    let continues = end_positions(&state);
    Ok(Some(state.next_part(continues)))
}

/// Where the newest part ends. Where it cannot be read (removed, an unreadable disk), the gap
/// before the next part cannot be counted.
fn end_positions(state: &StartRequest) -> Positions {
    let path = recording::part_path(&state.path, state.part);
    Recording::open_damaged(&path).and_then(|part| part.end_positions()).unwrap_or_else(|error| {
        eprintln!("farreach logger: losses over the restart cannot be counted: {error}");
        Positions::new()
    })
}

/// What the rig file says about the recorded signals, so that the recording needs no other file.
fn rig_metadata(rig: &RigFile) -> BTreeMap<String, String> {
    let mut metadata = BTreeMap::from([
        (key::RIG.to_owned(), rig.name.clone()),
        (key::RIG_FILE.to_owned(), rig.text().to_owned()),
    ]);
    for (index, axis) in rig.axes.iter().enumerate() {
        metadata.insert(format!("axis.{index}.name"), axis.name.clone());
        metadata.insert(format!("axis.{index}.unit"), axis.unit.symbol().to_owned());
    }
    for channel in &rig.channels {
        metadata.insert(format!("analog.{}.name", channel.index), channel.name.clone());
        metadata.insert(format!("analog.{}.unit", channel.index), channel.unit.clone());
        metadata.insert(format!("analog.{}.per_v", channel.index), channel.per_v.to_string());
        if !channel.muscle.is_empty() {
            metadata.insert(format!("analog.{}.muscle", channel.index), channel.muscle.clone());
        }
    }
    metadata
}

/// Whether this event ends the protocol that is being played.
fn ends_run(bytes: &[u8]) -> bool {
    let kind = Event::from_bytes(bytes).and_then(|event| EventKind::from_code(event.kind));
    matches!(kind, Some(EventKind::ProtocolDone | EventKind::ProtocolStopped))
}

/// Name, release and version of the kernel that this computer runs, as `uname -srv` prints them.
fn kernel() -> String {
    let system = rustix::system::uname();
    [system.sysname(), system.release(), system.version()]
        .map(|part| part.to_string_lossy())
        .join(" ")
}

/// Git revision of the build, as every recording carries it; `unknown` where the build had none.
pub fn revision() -> String {
    std::env::var("FARREACH_REVISION")
        .ok()
        .or_else(|| option_env!("FARREACH_REVISION").map(str::to_owned))
        .filter(|revision| !revision.is_empty())
        .unwrap_or_else(|| "unknown".to_owned())
}
