//! The frame of a process: joins the domain, asks for timing, says when it is ready, ends on a
//! signal.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use iceoryx2::prelude::{Node, ipc};
use ipc_types::{
    Event, EventKind, Heartbeat, LoopTiming, Message, Process, Profile, Severity, TypedTopic,
    event_topic, heartbeat_topic, timing_topic,
};
use rustix::thread::{CpuSet, sched_setaffinity};
pub use sd_notify::NotifyState;
use thiserror::Error;

use crate::bare_loop::bind;
use crate::clock::now_ns;
use crate::domain::{Domain, DomainError, RigName};
use crate::grid::{Grid, Wake};
use crate::identity::{Identity, random_u64};
use crate::ports::{PortError, Publisher, Subscriber};
use crate::realtime::{self, Grants};
use crate::request::RequestError;
use crate::timing::{LoopMeter, Losses};

/// A start that takes longer has hung (a peer died at the wrong moment) and is ended, to be tried
/// again.
const START_LIMIT: Duration = Duration::from_secs(8);
/// How often the sd_notify thread looks whether the loop made progress.
const NOTIFY_EVERY: Duration = Duration::from_millis(50);

/// A process could not be started or cannot go on.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum ServiceError {
    #[error(transparent)]
    Domain(#[from] DomainError),
    #[error(transparent)]
    Port(#[from] PortError),
    #[error(transparent)]
    Request(#[from] RequestError),
    #[error("signal handler: {0}")]
    Signal(io::Error),
    #[error("thread: {0}")]
    Thread(#[from] io::Error),
    #[error("timing histograms: {0}")]
    Histogram(#[from] hdrhistogram::CreationError),
    /// The table of topics has no such topic for this process.
    #[error("{0} has no topic for its {1}")]
    NoTopic(Process, &'static str),
    /// The rig runs in real time and this process may not.
    #[error(
        "rig {0} runs in the realtime profile, but SCHED_FIFO was not granted to {1}: \
         give it LimitRTPRIO (or CAP_SYS_NICE), or start the whole rig without"
    )]
    NotRealtime(String, Process),
}

/// One process of a rig.
#[derive(Debug)]
pub struct Service {
    process: Process,
    node: Node<ipc::Service>,
    domain: Domain,
    identity: Identity,
    stop: Arc<AtomicBool>,
    started: Arc<AtomicBool>,
    beats: Arc<AtomicU64>,
    events: Option<Publisher<Event>>,
    profile: Profile,
    awake: Option<realtime::Awake>,
    /// Where this process may run, while its loop is bound to one processor.
    everywhere: Option<CpuSet>,
    /// Measurement of the loop, and the topic that it is published in.
    timing: Option<(LoopMeter, Publisher<LoopTiming>)>,
}

impl Service {
    /// Joins the domain of a rig as `process`.
    pub fn start(process: Process, rig_name: &str) -> Result<Self, ServiceError> {
        realtime::name_thread(&format!("fr-{}", process.text()));
        let name: RigName = rig_name.parse()?;
        let stop = stop_flag()?;
        let started = Arc::new(AtomicBool::new(false));
        limit_start(process, Arc::clone(&started));
        let domain = Domain::open(&name)?;
        let node = domain.node(process.text())?;
        let identity = Identity { session: domain.session(), incarnation: random_u64() };
        let events = event_topic(process);
        let events = events.map(|topic| Publisher::new(&node, topic, identity)).transpose()?;
        Ok(Self {
            process,
            node,
            domain,
            identity,
            stop,
            started,
            beats: Arc::new(AtomicU64::new(0)),
            events,
            profile: Profile::BestEffort,
            awake: None,
            everywhere: None,
            timing: None,
        })
    }

    /// Which process this is.
    pub fn process(&self) -> Process {
        self.process
    }

    /// Session and incarnation.
    pub fn identity(&self) -> Identity {
        self.identity
    }

    /// The domain.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The node of the main thread.
    pub fn node(&self) -> &Node<ipc::Service> {
        &self.node
    }

    /// Publishes a topic.
    pub fn publisher<T: Message>(&self, topic: TypedTopic<T>) -> Result<Publisher<T>, PortError> {
        Publisher::new(&self.node, topic, self.identity)
    }

    /// Subscribes to a topic.
    pub fn subscriber<T: Message>(&self, topic: TypedTopic<T>) -> Result<Subscriber<T>, PortError> {
        Subscriber::new(&self.node, topic)
    }

    /// Publishes the process's heartbeats.
    pub fn heartbeat_publisher(&self) -> Result<Publisher<Heartbeat>, ServiceError> {
        let topic = heartbeat_topic(self.process);
        Ok(self.publisher(topic.ok_or(ServiceError::NoTopic(self.process, "heartbeats"))?)?)
    }

    /// Whether a signal asked the process to end. A loop looks at it at each cycle's edge.
    pub fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// The stop flag, for other threads.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.stop)
    }

    /// One sign of progress: the service manager's watchdog is fed only while the loop goes round.
    pub fn beat(&self) {
        self.beats.fetch_add(1, Ordering::Relaxed);
    }

    /// Asks for real-time scheduling at the process's own priority ([`realtime::loop_priority`]),
    /// locks memory and keeps the processors awake where allowed, binds the calling thread to the
    /// processor that the session has for its loop, reports that the process is ready, and watches
    /// over it from now on. Call when all ports are made, right before the loop.
    ///
    /// # Errors
    /// The rig runs in the realtime profile and this process may not.
    pub fn enter_loop(&mut self) -> Result<Profile, ServiceError> {
        let timing = timing_topic(self.process);
        let timings =
            self.publisher(timing.ok_or(ServiceError::NoTopic(self.process, "timing"))?)?;
        self.profile = self.domain.profile();
        let mut memory_locked = false;
        if self.domain.fifo() {
            // Before the priority: to bring in and lock what is mapped takes milliseconds, in which
            // the other loops go first.
            memory_locked = realtime::lock_memory();
            self.awake = realtime::stay_awake();
            let priority = realtime::loop_priority(self.process);
            let granted = realtime::request_fifo(priority) == Profile::Realtime;
            if !granted && self.profile == Profile::Realtime {
                return Err(ServiceError::NotRealtime(
                    self.domain.name().to_string(),
                    self.process,
                ));
            }
        } else {
            realtime::request_normal();
            realtime::request_short_slices();
        }
        realtime::tighten_timer_slack();
        realtime::prefault_stack();
        // Where it is refused the loop runs on any processor, as the status shows.
        let placed = self.domain.placement().get(self.process.text());
        self.everywhere = placed.and_then(|processor| bind(*processor));
        let kept_awake = self.awake.is_some();
        let grants = Grants { profile: self.profile, memory_locked, kept_awake };
        self.timing = Some((LoopMeter::new(self.process, grants)?, timings));
        self.ready()?;
        Ok(self.profile)
    }

    /// Says that the process is ready (a slow process, which needs no real-time scheduling).
    pub fn ready(&mut self) -> Result<(), ServiceError> {
        self.started.store(true, Ordering::Relaxed);
        let beats = Arc::clone(&self.beats);
        let stop = Arc::clone(&self.stop);
        let fifo = self.domain.fifo();
        let everywhere = self.everywhere;
        realtime::beside_loop("sd-notify").spawn(move || {
            realtime::request_helper(fifo);
            if let Some(everywhere) = everywhere {
                // The loop alone is bound; where that is refused this thread waits for it.
                let _free = sched_setaffinity(None, &everywhere);
            }
            notify_manager(&beats, &stop);
        })?;
        self.event(EventKind::ProcessStarted, Severity::Info, [0.0; 3], self.profile.text())?;
        Ok(())
    }

    /// Ends one cycle of the loop: records when it woke and how long it took. Once a second this
    /// publishes the timing with the process's losses, and brings the earlier events to those that
    /// joined since; it then returns true. Allocates nothing.
    pub fn end_cycle(
        &mut self,
        grid: &Grid,
        wake: &Wake,
        losses: Losses,
    ) -> Result<bool, PortError> {
        let Some((meter, timings)) = &mut self.timing else { return Ok(false) };
        let end = now_ns();
        meter.record(wake, end);
        let Some(timing) = meter.due(grid, end) else { return Ok(false) };
        timings.send(losses.told_in(timing))?;
        self.refresh_events();
        Ok(true)
    }

    /// Publishes an event. Its text is copied, not formatted: allocates nothing.
    pub fn publish(&mut self, event: Event) -> Result<(), PortError> {
        if let Some(events) = &mut self.events {
            events.send(event)?;
        }
        Ok(())
    }

    /// Publishes an event of this process.
    pub fn event(
        &mut self,
        kind: EventKind,
        severity: Severity,
        [a, b, c]: [f64; 3],
        text: &str,
    ) -> Result<(), PortError> {
        self.publish(Event { a, b, c, ..Event::new(self.process, kind, severity, text) })
    }

    /// Publishes that the process ends in good order.
    pub fn end(&mut self) -> Result<(), PortError> {
        self.event(EventKind::ProcessEnding, Severity::Info, [0.0; 3], "")
    }

    /// Connects those that joined since the last event; see [`Publisher::refresh`].
    pub fn refresh_events(&self) {
        if let Some(events) = &self.events {
            events.refresh();
        }
    }
}

/// A flag that SIGTERM and SIGINT raise.
///
/// # Errors
/// [`ServiceError::Signal`].
pub fn stop_flag() -> Result<Arc<AtomicBool>, ServiceError> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    stop_on(&[SIGTERM, SIGINT]).map_err(ServiceError::Signal)
}

/// A flag that each of these signals raises.
///
/// # Errors
/// A handler cannot be installed.
pub fn stop_on(signals: &[i32]) -> io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for &signal in signals {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

/// Ends the process if it is not ready in time.
fn limit_start(process: Process, started: Arc<AtomicBool>) {
    let watch = move || {
        let begun = Instant::now();
        while begun.elapsed() < START_LIMIT {
            if started.load(Ordering::Relaxed) {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        if !started.load(Ordering::Relaxed) {
            eprintln!(
                "farreach {process}: not ready after {START_LIMIT:?}; ends so that it can be \
                 started again"
            );
            std::process::exit(1);
        }
    };
    // Without the thread there is no limit here; the service manager has its own.
    let _spawned = realtime::beside_loop("start-limit").spawn(watch);
}

/// Tells the service manager that the process is ready, and that it lives for as long as the loop
/// goes round.
fn notify_manager(beats: &AtomicU64, stop: &AtomicBool) {
    notify(NotifyState::Ready);
    let mut seen = beats.load(Ordering::Relaxed);
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(NOTIFY_EVERY);
        let now = beats.load(Ordering::Relaxed);
        if now != seen {
            seen = now;
            notify(NotifyState::Watchdog);
        }
    }
    notify(NotifyState::Stopping);
}

/// Tells the service manager; without one nobody listens.
pub fn notify(state: NotifyState<'_>) {
    let _sent = sd_notify::notify(&[state]);
}
