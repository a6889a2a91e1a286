//! The process: the loop around the interlock.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use ipc_types::{
    COMMAND, ENABLE_LINE, EnableLine, Event, EventKind, Process, SAMPLE, Severity, TOKEN, Verb,
    WatchdogState,
};
use rig::RigFile;
use runtime::clock::now_ns;
use runtime::{Grid, Losses, PortError, Service, ServiceError};
use thiserror::Error;

use crate::command_thread::{self, Heartbeat, Shared};
use crate::interlock::{Config, Interlock, Outputs, Peers, StateChange};

/// What the process is started with.
#[derive(Clone, Debug)]
pub struct Options {
    /// Name of the rig.
    pub rig_name: String,
    /// Its rig file.
    pub rig_file: PathBuf,
}

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum WatchdogError {
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
    #[error("thread: {0}")]
    Thread(#[from] std::io::Error),
    /// The command thread has ended.
    #[error("the command thread has ended: the operator's commands have no effect")]
    CommandThreadDead,
}

/// The interlock's configuration for this session.
fn config(rig: &RigFile, service: &Service) -> Config {
    let identity = service.identity();
    Config::for_profile(
        service.domain().profile(),
        identity.session,
        identity.incarnation,
        &rig.axes,
        // No rig file records an override yet.
        false,
    )
}

/// The event that reports a change of state.
fn state_changed(change: &StateChange) -> Event {
    let severity = match change.to {
        WatchdogState::Tripped | WatchdogState::Faulted => Severity::Error,
        _ => Severity::Info,
    };
    Event {
        a: f64::from(change.from.code()),
        b: f64::from(change.to.code()),
        c: f64::from(change.cause.code()),
        ..Event::new(Process::Watchdog, EventKind::StateChanged, severity, change.text())
    }
}

/// Runs the watchdog until a signal ends it.
pub fn run(options: &Options) -> Result<(), WatchdogError> {
    let rig = RigFile::load(&options.rig_file)?;
    let mut service = Service::start(Process::Watchdog, &options.rig_name)?;
    let mut samples = service.subscriber(SAMPLE)?;
    let mut commands = service.subscriber(COMMAND)?;
    let mut tokens = service.publisher(TOKEN)?;
    let mut lines = service.publisher(ENABLE_LINE)?;
    let mut timings = service.timing_publisher()?;
    let shared = Arc::new(Shared::new());
    let command_thread = command_thread::start(
        service.domain().name().clone(),
        Arc::clone(&shared),
        service.stop_flag(),
    )?;
    let mut grid = Grid::of_rate(rig.rates.watchdog_hz, rig.phases.watchdog_ns);
    service.enter_loop()?;
    let mut events = service.take_events()?;
    let mut meter = service.loop_meter()?;
    let mut interlock = Interlock::new(config(&rig, &service));
    let mut toggles = 0;
    let mut heartbeat = Heartbeat::default();
    while !service.stopping() {
        let Some(wake) = grid.wait() else { continue };
        while let Some(sample) = samples.take()? {
            interlock.observe_sample(&sample);
        }
        while let Some(command) = commands.take()? {
            interlock.observe_command(&command);
        }
        let peers = Peers {
            launcher_alive: shared.launcher.load(Ordering::Relaxed),
            keeper_alive: shared.keeper.load(Ordering::Relaxed),
        };
        let now = now_ns();
        if let Some(verb) = shared.verbs.pop() {
            // Only one answer is ever awaited: the queue has a place for it.
            let _queued = shared.answers.push(interlock.command(verb, now));
        }
        let outputs = interlock.step(now, peers);
        shared.state.store(interlock.state().code(), Ordering::Relaxed);
        let Outputs { mut token, toggle_line, event } = outputs;
        token.cycles_missed = grid.missed();
        tokens.send(token)?;
        if toggle_line {
            toggles += 1;
        }
        lines.send(EnableLine { epoch: token.epoch, toggles, ..EnableLine::default() })?;
        if let Some(change) = event {
            events.send(state_changed(&change))?;
        }
        let end = now_ns();
        meter.record(&wake, end);
        if let Some(timing) = meter.due(&grid, end) {
            let losses =
                Losses::default().received(samples.counters()).received(commands.counters());
            timings.send(
                losses.sent(tokens.undelivered()).sent(lines.undelivered()).told_in(timing),
            )?;
            // Events are rare: this delivers earlier ones to subscribers that joined since.
            events.refresh();
        }
        // A watchdog without heartbeat is killed, which cuts the motor's power, and restarted.
        if heartbeat.is_alive(shared.cycles.load(Ordering::Relaxed), end) {
            service.beat();
        }
    }
    // The motor first: withdraws the permission in good order and stops the line.
    let now = now_ns();
    let _state = interlock.command(Verb::Disarm, now);
    let peers = Peers { launcher_alive: true, keeper_alive: true };
    tokens.send(interlock.step(now, peers).token)?;
    events.send(Event::new(Process::Watchdog, EventKind::ProcessEnding, Severity::Info, ""))?;
    // It ends on the same flag; a panic has been printed.
    let panicked = command_thread.join().is_err();
    if panicked || shared.dead.load(Ordering::Relaxed) {
        Err(WatchdogError::CommandThreadDead)
    } else {
        Ok(())
    }
}
