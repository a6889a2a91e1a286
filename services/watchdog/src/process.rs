//! The process: the loop around the interlock.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use ipc_types::{
    COMMAND, CardKind, ENABLE_LINE, EnableLine, EnableToken, Event, EventKind, Process, SAMPLE,
    Severity, TOKEN, Verb, WatchdogState,
};
use rig::RigFile;
use runtime::clock::now_ns;
use runtime::{Grid, Losses, PortError, Service, ServiceError};
use thiserror::Error;

use crate::command_thread::{self, Heartbeat, Shared};
use crate::doctor_gate::DoctorGate;
use crate::enable_output::{EnableOutput, LineError};
use crate::interlock::{Config, Interlock, Outputs, Peers, StateChange};

/// Text of the event for a step of the clock of the day.
const CLOCK: &str = "the clock of the day was set; the rig's own time goes on";

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum WatchdogError {
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
    #[error(transparent)]
    Line(#[from] LineError),
    /// The command thread has ended.
    #[error("the command thread has ended: the operator's commands have no effect")]
    CommandThreadDead,
}

/// The interlock's configuration for this session.
fn config(rig: &RigFile, service: &Service) -> Config {
    let identity = service.identity();
    Config::for_profile(service.domain().profile(), identity.session, identity.incarnation, rig)
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

/// Executes the verb that has come, if any; the verb, where it was not refused.
fn execute_verb(shared: &Shared, interlock: &mut Interlock, now_ns: u64) -> Option<Verb> {
    let order = shared.verbs.take()?;
    let answer = interlock.command(order.verb, now_ns);
    shared.verbs.answer(order, answer);
    answer.is_ok().then_some(order.verb)
}

/// The token with what the loop adds, from which the interlock's inputs are found again in a
/// recording: the verb that was executed, and how many samples and commands were received.
fn completed(
    token: EnableToken,
    executed: Option<Verb>,
    cycles_missed: u64,
    [samples_received, commands_received]: [u64; 2],
) -> EnableToken {
    EnableToken {
        cycles_missed,
        verb: Verb::executed_code(executed),
        samples_received,
        commands_received,
        ..token
    }
}

/// Runs the watchdog on the rig of that name until a signal ends it. Where the card is a real one,
/// it switches the enable line by itself. `doctor` is the folder with the doctor's reports, without
/// which a real card is armed by an override only.
///
/// # Errors
/// [`WatchdogError`].
pub fn run(
    rig_name: &str,
    rig: &RigFile,
    card: Option<CardKind>,
    doctor: Option<&Path>,
) -> Result<(), WatchdogError> {
    let mut output = EnableOutput::of_rig(card, rig)?;
    let mut service = Service::start(Process::Watchdog, rig_name)?;
    let mut samples = service.subscriber(SAMPLE)?;
    let mut commands = service.subscriber(COMMAND)?;
    let mut tokens = service.publisher(TOKEN)?;
    let mut lines = service.publisher(ENABLE_LINE)?;
    let shared = Arc::new(Shared::new());
    let command_thread = command_thread::start(
        DoctorGate::new(doctor, service.domain().name().clone()).map_err(ServiceError::from)?,
        service.domain().name().clone(),
        Arc::clone(&shared),
        service.stop_flag(),
    )
    .map_err(ServiceError::from)?;
    let mut grid = Grid::of_rate(rig.rates.watchdog_hz, rig.phases.watchdog_ns);
    service.enter_loop()?;
    let mut interlock = Interlock::new(config(rig, &service));
    let mut toggles = 0;
    let mut heartbeat = Heartbeat::default();
    while !service.stopping() {
        let Some(wake) = grid.wait() else { continue };
        while let Some(sample) = samples.take()? {
            interlock.observe_sample(&sample);
            shared.card.store(sample.backend, Ordering::Relaxed);
        }
        while let Some(command) = commands.take()? {
            interlock.observe_command(&command);
        }
        let peers = Peers {
            launcher_alive: shared.launcher.load(Ordering::Relaxed),
            keeper_alive: shared.keeper.load(Ordering::Relaxed),
            logger_alive: shared.logger.load(Ordering::Relaxed),
        };
        let now = now_ns();
        let executed = execute_verb(&shared, &mut interlock, now);
        let outputs = interlock.step(now, peers);
        shared.state.store(interlock.state().code(), Ordering::Relaxed);
        let Outputs { token, toggle_line, event } = outputs;
        let received = [samples.counters().received, commands.counters().received];
        tokens.send(completed(token, executed, grid.missed(), received))?;
        if toggle_line {
            toggles += 1;
        }
        lines.send(EnableLine { epoch: token.epoch, toggles, ..EnableLine::default() })?;
        if let Some(output) = output.as_mut().filter(|_| toggle_line) {
            output.toggle()?;
        }
        if let Some(change) = event {
            service.publish(state_changed(&change))?;
        }
        if let Some(step_s) = shared.clock_steps.pop() {
            service.event(EventKind::ClockStepped, Severity::Warning, [step_s, 0.0, 0.0], CLOCK)?;
        }
        if let Some(event) = shared.events.pop() {
            service.publish(event)?;
        }
        let losses = Losses::default()
            .received(samples.counters())
            .received(commands.counters())
            .sent(tokens.undelivered())
            .sent(lines.undelivered());
        service.end_cycle(&grid, &wake, losses)?;
        // A watchdog without heartbeat is killed, which cuts the motor's power, and restarted.
        if heartbeat.is_alive(shared.cycles.load(Ordering::Relaxed), now_ns()) {
            service.beat();
        }
    }
    // The motor first: withdraws the permission in good order and stops the line.
    let now = now_ns();
    let _state = interlock.command(Verb::Disarm, now);
    let token = interlock.step(now, Peers::ALIVE).token;
    let received = [samples.counters().received, commands.counters().received];
    tokens.send(completed(token, Some(Verb::Disarm), grid.missed(), received))?;
    service.end()?;
    // It ends on the same flag; a panic has been printed.
    let panicked = command_thread.join().is_err();
    if panicked || shared.dead.load(Ordering::Relaxed) {
        Err(WatchdogError::CommandThreadDead)
    } else {
        Ok(())
    }
}
