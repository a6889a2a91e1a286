//! The process: the loop around the law.

use std::path::PathBuf;

use ipc_types::{COMMAND, Event, EventKind, GateState, Process, SAMPLE, SETPOINT, Severity, TOKEN};
use rig::RigFile;
use runtime::clock::now_ns;
use runtime::{Grid, Losses, PortError, Service, ServiceError};
use thiserror::Error;

use crate::law::{Law, LawConfig};
use crate::setpoint_validation::SetpointValidation;

/// Options of the process.
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
pub enum ControlError {
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
}

/// Runs control until a signal ends it.
pub fn run(options: &Options) -> Result<(), ControlError> {
    let rig = RigFile::load(&options.rig_file)?;
    let mut service = Service::start(Process::Control, &options.rig_name)?;
    let mut samples = service.subscriber(SAMPLE)?;
    let mut setpoints = service.subscriber(SETPOINT)?;
    let mut tokens = service.subscriber(TOKEN)?;
    let mut commands = service.publisher(COMMAND)?;
    let mut timings = service.timing_publisher()?;
    let mut grid = Grid::of_rate(rig.rates.control_hz, rig.phases.control_ns);
    let mut law = Law::new(LawConfig::of_rig(&rig));
    let identity = service.identity();
    let mut validation = SetpointValidation::of_rig(identity.session, &rig);
    let profile = service.enter_loop()?;
    let mut events = service.take_events()?;
    let mut meter = service.loop_meter()?;
    let (mut sample, mut setpoint, mut token) = (None, None, None);
    while !service.stopping() {
        let Some(wake) = grid.wait() else { continue };
        if let Some(newest) = samples.latest()? {
            if sample.is_none() {
                let text = "control continues from the measured position";
                let told =
                    Event::new(Process::Control, EventKind::ControlResumed, Severity::Info, text);
                events.send(Event { a: newest.master_position[0], ..told })?;
            }
            sample = Some(newest);
        }
        // All of them, not only the newest: with two senders, the last one received need not be the
        // one to follow.
        while let Some(next) = setpoints.take()? {
            match validation.validate(now_ns(), &next) {
                Ok(()) => setpoint = Some(next),
                Err(refusal) => {
                    if let Some(notice) = validation.notice(now_ns(), refusal, &next) {
                        events.send(notice.event())?;
                    }
                }
            }
        }
        token = tokens.latest()?.or(token);
        if let Some(sample) = &sample {
            // Powered: the gate is open for the epoch of the newest token, and for commands of this
            // process.
            let powered = token.is_some_and(|token| {
                token.enabled == 1
                    && token.control_incarnation == identity.incarnation
                    && sample.epoch == token.epoch
                    && sample.gate_state == GateState::Open.code()
            });
            let mut command = law.step(now_ns(), sample, setpoint.as_ref(), powered);
            command.token_sequence = token.map_or(0, |token| token.sequence);
            command.epoch = token.map_or(0, |token| token.epoch);
            command.cycles_missed = grid.missed();
            command.profile = profile.code();
            commands.send(command)?;
        }
        let end = now_ns();
        meter.record(&wake, end);
        if let Some(timing) = meter.due(&grid, end) {
            let heard = [samples.counters(), setpoints.counters(), tokens.counters()];
            let losses = heard
                .into_iter()
                .fold(Losses::default(), Losses::received)
                .sent(commands.undelivered());
            timings
                .send(Losses { refused: validation.refused_in_all(), ..losses }.told_in(timing))?;
            // Events are rare: a late subscriber receives the earlier ones only through this.
            events.refresh();
        }
        service.beat();
    }
    events.send(Event::new(Process::Control, EventKind::ProcessEnding, Severity::Info, ""))?;
    Ok(())
}
