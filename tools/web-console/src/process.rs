//! The process: topics from shared memory to the pages, events from the pages to shared memory.

use std::borrow::Cow;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::time::{Duration, Instant};

use axum::extract::ws::Utf8Bytes;
use ipc_types::{
    COMMAND, EnableToken, Event, EventKind, Heartbeat, INNOVATION, Innovation, MODEL_STATE, Mode,
    ModelState, MotorCommand, PERFORMANCE, PROCESSES, Performance, Process, SAMPLE, Sample,
    Severity, TOKEN, event_topic,
};
use operator::ConsoleAddress;
use operator::status::Watcher;
use rig::RigFile;
use runtime::clock::now_ns;
use runtime::{PortError, Publisher, RigName, Service, ServiceError, Subscriber, random_u64};
use serde_json::{Value, json};
use thiserror::Error;

use crate::board::{Audience, Slot};
use crate::commands::{Command, Commander};
use crate::desk::Shared;
use crate::host_check::computer_name;
use crate::page_link::Pages;
use crate::plot_batch::{InnovationPlotter, Plotter};
use crate::rig_view::{self, RigView};
use crate::run_state::RunStateFile;
use crate::runner::Runner;
use crate::subject_view::SubjectView;
use crate::{session_list, web};

/// Period of the loop.
const PERIOD: Duration = Duration::from_millis(5);
/// Period of the heartbeat.
const HEARTBEAT: Duration = Duration::from_millis(50);
/// Period of the state that pages are told.
const STATE: Duration = Duration::from_millis(100);
/// Period of the status: processes, rates, losses.
const STATUS: Duration = Duration::from_secs(1);
/// Commands that may wait.
const COMMANDS: usize = 32;
/// Events of the console that may wait.
const EVENTS: usize = 256;
/// Most events that are published in a cycle.
const EVENTS_A_CYCLE: usize = 8;

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum ConsoleError {
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
    #[error(transparent)]
    Rig(#[from] operator::Error),
    /// The address cannot be listened at.
    #[error(
        "the console cannot listen at {address}: {source}; choose another address (farreach up \
         --console ADDRESS:PORT)"
    )]
    Listen { address: SocketAddr, source: std::io::Error },
    #[error("the web server: {0}")]
    Web(std::io::Error),
    /// A thread of the process is gone.
    #[error("the thread {0} of the console ended")]
    ThreadEnded(&'static str),
}

/// Runs the console of the rig of that name until a signal ends it.
///
/// # Errors
/// [`ConsoleError`].
pub fn run(rig_name: &RigName, listen: SocketAddr) -> Result<(), ConsoleError> {
    let mut service = Service::start(Process::Console, rig_name.as_str())?;
    let rig = Arc::new(operator::rig_of(rig_name)?);
    let (address, listener) = listen_at(rig_name, listen)?;
    let (events, publish) = sync_channel(EVENTS);
    let shared = Arc::new(Shared::new(address.token.clone(), events));
    shared.show(&shared.desk());
    let mut console = Console::new(&service, Arc::clone(&rig), Arc::clone(&shared))?;
    let threads = start_threads(rig_name, &rig, &shared, listener)?;
    address.write(rig_name)?;
    service.ready()?;
    while !service.stopping() {
        console.cycle(&mut service, &publish)?;
        if let Some((name, _)) = threads.iter().find(|(_, thread)| thread.is_finished()) {
            return Err(ConsoleError::ThreadEnded(name));
        }
        service.beat();
        std::thread::sleep(PERIOD);
    }
    // The threads end with the process. A protocol that is played goes on if the console is back
    // before its lease is over, and ends otherwise.
    service.end()?;
    Ok(())
}

/// Listens; a console that is started again keeps address and token, so that open pages find it.
fn listen_at(
    rig_name: &RigName,
    listen: SocketAddr,
) -> Result<(ConsoleAddress, TcpListener), ConsoleError> {
    let before = ConsoleAddress::read(rig_name)?;
    let same = |before: &ConsoleAddress| {
        let at = before.listen.parse::<SocketAddr>().ok()?;
        let fits = at.ip() == listen.ip() && (listen.port() == 0 || listen.port() == at.port());
        fits.then_some(at)
    };
    let at = before.as_ref().and_then(same).unwrap_or(listen);
    let failed = |source| ConsoleError::Listen { address: at, source };
    let listener = TcpListener::bind(at).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let listen = listener.local_addr().map_err(failed)?.to_string();
    let token = before.map_or_else(
        || format!("{:016x}{:016x}", random_u64(), random_u64()),
        |before| before.token,
    );
    Ok((ConsoleAddress { listen, token }, listener))
}

type Thread = std::thread::JoinHandle<()>;

fn spawn(
    name: &'static str,
    work: impl FnOnce() + Send + 'static,
) -> Result<(&'static str, Thread), ConsoleError> {
    let thread = std::thread::Builder::new().name(name.to_owned()).spawn(work);
    Ok((name, thread.map_err(ConsoleError::Web)?))
}

fn start_threads(
    name: &RigName,
    rig: &Arc<RigFile>,
    shared: &Arc<Shared>,
    listener: TcpListener,
) -> Result<Vec<(&'static str, Thread)>, ConsoleError> {
    let (reports, requests) = channel();
    let (orders, ordered) = channel();
    let state = RunStateFile::new(&name.run_directory());
    let runner = Runner { rig: name.clone(), shared: Arc::clone(shared), state, reports };
    let mut threads = vec![
        spawn("runner", move || runner.serve(&ordered))?,
        spawn("sessions", {
            let (name, shared) = (name.clone(), Arc::clone(shared));
            move || session_list::serve(&name, &shared, &requests)
        })?,
        spawn("status", {
            let (name, shared) = (name.clone(), Arc::clone(shared));
            move || watch_status(&name, &shared)
        })?,
    ];
    let mut commander = |thread: &'static str| -> Result<SyncSender<Command>, ConsoleError> {
        let (sender, commands) = sync_channel(COMMANDS);
        let commander = Commander {
            name: name.clone(),
            rig: Arc::clone(rig),
            shared: Arc::clone(shared),
            runner: orders.clone(),
        };
        threads.push(spawn(thread, move || commander.serve(&commands))?);
        Ok(sender)
    };
    let pages = Pages {
        shared: Arc::clone(shared),
        welcome: Utf8Bytes::from(welcome(rig).to_string()),
        power: commander("power")?,
        stop: commander("stop")?,
        key: commander("key")?,
        other: commander("commands")?,
        numbers: Arc::new(AtomicU64::new(0)),
        open: Arc::new(AtomicU64::new(0)),
    };
    threads.push(spawn("web", move || serve_web(pages, listener))?);
    Ok(threads)
}

/// Serves until the process ends.
fn serve_web(pages: Pages, listener: TcpListener) {
    let computer = computer_name();
    let result =
        tokio::runtime::Builder::new_current_thread().enable_all().build().and_then(|runtime| {
            runtime.block_on(async {
                let listener = tokio::net::TcpListener::from_std(listener)?;
                let router = web::router(pages, computer);
                let service = router.into_make_service_with_connect_info::<SocketAddr>();
                axum::serve(listener, service).await
            })
        });
    if let Err(error) = result {
        eprintln!("farreach console: the web server: {error}");
    }
}

/// What does not change: rig, signals, protocols.
fn welcome(rig: &RigFile) -> Value {
    let signals: Vec<Value> = recorder::signals(rig)
        .iter()
        .map(|signal| json!({ "name": signal.name, "unit": signal.unit }))
        .collect();
    let protocols: Vec<&str> = rig::PROTOCOLS.iter().map(|protocol| protocol.name).collect();
    json!({
        "type": "welcome",
        "rig": rig.name,
        "description": rig.description,
        "has_trigger": rig.scanner.is_some(),
        "signals": signals,
        "protocols": protocols,
    })
}

/// Asks for processes, rates and losses, and for what runs and is recorded.
fn watch_status(name: &RigName, shared: &Shared) {
    let mut watcher = Watcher::default();
    loop {
        let begun = Instant::now();
        match watcher.status(name) {
            Ok(status) => {
                {
                    let mut desk = shared.desk();
                    desk.running.clone_from(&status.protocol);
                    desk.recording.clone_from(&status.recording);
                }
                shared.board.set(Slot::Status, &json!({ "type": "status", "status": status }));
            }
            Err(error) => {
                {
                    let mut desk = shared.desk();
                    (desk.running, desk.recording) = (None, None);
                }
                let error = error.to_string();
                shared.board.set(Slot::Status, &json!({ "type": "status", "error": error }));
            }
        }
        std::thread::sleep(STATUS.saturating_sub(begun.elapsed()));
    }
}

/// The main thread's ports and what it makes of their messages.
struct Console {
    rig: Arc<RigFile>,
    shared: Arc<Shared>,
    samples: Subscriber<Sample>,
    commands: Subscriber<MotorCommand>,
    tokens: Subscriber<EnableToken>,
    performances: Subscriber<Performance>,
    models: Subscriber<ModelState>,
    innovations: Subscriber<Innovation>,
    events: Vec<Subscriber<Event>>,
    heartbeats: Publisher<Heartbeat>,
    view: RigView,
    plotter: Plotter,
    innovation_plotter: InnovationPlotter,
    /// What the subject was shown last.
    seen: Option<SubjectView>,
    /// The instruction that a subject's page shows; `None` where none is open.
    instruction: Option<Cow<'static, str>>,
    beat: Instant,
    told: Instant,
}

impl Console {
    fn new(
        service: &Service,
        rig: Arc<RigFile>,
        shared: Arc<Shared>,
    ) -> Result<Self, ConsoleError> {
        let topics = PROCESSES.iter().filter_map(|entry| event_topic(entry.process));
        let rate_hz = rig.rates.acquisition_hz;
        let plotter = Plotter::new(recorder::signals(&rig), rate_hz);
        Ok(Self {
            rig,
            shared,
            samples: service.subscriber(SAMPLE)?,
            commands: service.subscriber(COMMAND)?,
            tokens: service.subscriber(TOKEN)?,
            performances: service.subscriber(PERFORMANCE)?,
            models: service.subscriber(MODEL_STATE)?,
            innovations: service.subscriber(INNOVATION)?,
            events: topics.map(|topic| service.subscriber(topic)).collect::<Result<_, _>>()?,
            heartbeats: service.heartbeat_publisher()?,
            view: RigView::default(),
            plotter,
            innovation_plotter: InnovationPlotter::new(rate_hz),
            seen: None,
            instruction: None,
            beat: Instant::now(),
            told: Instant::now(),
        })
    }

    fn cycle(
        &mut self,
        service: &mut Service,
        publish: &Receiver<Event>,
    ) -> Result<(), ConsoleError> {
        self.read()?;
        // Fewer than a subscriber's buffer holds; the others wait for the next cycle.
        for event in publish.try_iter().take(EVENTS_A_CYCLE) {
            service.publish(event)?;
        }
        let now_ns = now_ns();
        let running = self.shared.desk().situation(None).running;
        let mode = self.view.mode(now_ns);
        let (performance, told) = (self.view.performance.as_ref(), self.view.told.as_deref());
        let seen = SubjectView::new(performance, mode, running, told, now_ns);
        // Four times of five nothing has changed.
        if self.seen.as_ref() != Some(&seen) {
            self.shared.board.set(Slot::Bar, &json!({ "type": "bar", "view": seen }));
            self.seen = Some(seen.clone());
        }
        if self.shared.subject_pages.load(Ordering::Relaxed) == 0 {
            // A page that opens later is then the first to show it.
            self.instruction = None;
        } else if self.instruction.as_ref() != Some(&seen.instruction) {
            let (kind, text) = (EventKind::InstructionShown, &*seen.instruction);
            service.event(kind, Severity::Info, [0.0; 3], text)?;
            self.instruction = Some(seen.instruction);
        }
        if self.told.elapsed() >= STATE {
            self.told = Instant::now();
            let state = self.state(now_ns);
            self.shared.board.set(Slot::State, &state);
        }
        if self.beat.elapsed() >= HEARTBEAT {
            self.beat = Instant::now();
            service.refresh_events();
            self.heartbeats.send(self.heartbeat(service))?;
        }
        Ok(())
    }

    fn read(&mut self) -> Result<(), PortError> {
        while let Some(sample) = self.samples.take()? {
            if let Some(batch) = self.plotter.take(&sample) {
                let message = json!({ "type": "plot", "batch": batch });
                self.shared.board.tell(Audience::Operators, &message);
            }
            self.view.sample = Some(sample);
        }
        if let Some(command) = self.commands.latest()? {
            let mode = Mode::from_code(command.mode);
            self.view.mode = mode.map(|mode| (mode, command.time_ns));
        }
        if let Some(token) = self.tokens.latest()? {
            self.view.token = Some(token);
        }
        if let Some(performance) = self.performances.latest()? {
            self.view.performance = Some(performance);
        }
        self.read_model()?;
        let now_ns = now_ns();
        for events in &mut self.events {
            while let Some(event) = events.take()? {
                self.view.see(&event);
                let audience = match rig_view::is_for_subjects(&event) {
                    true => Audience::All,
                    false if is_silent(&event) => continue,
                    false => Audience::Operators,
                };
                self.shared.board.tell(audience, &rig_view::event(&event, now_ns));
            }
        }
        Ok(())
    }

    /// What the monitor publishes, where one runs.
    fn read_model(&mut self) -> Result<(), PortError> {
        while let Some(state) = self.models.take()? {
            self.view.model.see_state(&state);
        }
        while let Some(row) = self.innovations.take()? {
            if let Some(batch) = self.innovation_plotter.take(&row) {
                let message = json!({ "type": "innovation", "axis": row.axis, "batch": batch });
                self.shared.board.tell(Audience::Operators, &message);
            }
        }
        Ok(())
    }

    fn state(&self, now_ns: u64) -> Value {
        let desk = self.shared.desk();
        let permitted = desk.situation(self.view.watchdog(now_ns)).permitted();
        let console = desk.state();
        drop(desk);
        let controller = self.shared.access().controller();
        json!({
            "type": "state",
            "rig": self.view.state(&self.rig, now_ns),
            "console": console,
            "permitted": permitted,
            "controller": controller,
            "lost": self.lost(),
        })
    }

    /// Messages that did not reach the console, and messages of pages and events that were lost.
    fn lost(&self) -> u64 {
        let mut lost = self.shared.lost();
        for counters in [
            self.samples.counters(),
            self.commands.counters(),
            self.tokens.counters(),
            self.performances.counters(),
            self.models.counters(),
            self.innovations.counters(),
        ] {
            lost += counters.lost;
        }
        lost + self.events.iter().map(|events| events.counters().lost).sum::<u64>()
    }

    fn heartbeat(&self, service: &Service) -> Heartbeat {
        Heartbeat {
            lost: self.lost(),
            pid: std::process::id(),
            source: Process::Console.code(),
            profile: service.domain().profile().code(),
            ..Heartbeat::default()
        }
    }
}

/// Whether an event is recorded only: what the console itself measures.
fn is_silent(event: &Event) -> bool {
    let kind = EventKind::from_code(event.kind);
    matches!(kind, Some(EventKind::ClockMeasured | EventKind::FrameDelay | EventKind::SoundPlayed))
}
