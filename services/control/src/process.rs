//! The process: the loop around the law.

use ipc_types::program_flow::{Checkpoint, Flow};
use ipc_types::{COMMAND, EventKind, Process, SAMPLE, SETPOINT, Severity, TOKEN};
use rig::RigFile;
use runtime::clock::now_ns;
use runtime::{Grid, Losses, Service, ServiceError};

use crate::cycle::Seen;
use crate::law::{Law, LawConfig};
use crate::setpoint_validation::SetpointValidation;

/// Runs control on the rig of that name until a signal ends it.
///
/// # Errors
/// [`ServiceError`].
pub fn run(rig_name: &str, rig: &RigFile) -> Result<(), ServiceError> {
    let mut service = Service::start(Process::Control, rig_name)?;
    let mut samples = service.subscriber(SAMPLE)?;
    let mut setpoints = service.subscriber(SETPOINT)?;
    let mut tokens = service.subscriber(TOKEN)?;
    let mut commands = service.publisher(COMMAND)?;
    let mut grid = Grid::of_rate(rig.rates.control_hz, rig.phases.control_ns);
    let mut law = Law::new(LawConfig::of_rig(rig));
    let identity = service.identity();
    let mut validation = SetpointValidation::of_rig(identity.session, rig);
    let profile = service.enter_loop()?;
    let (mut sample, mut setpoint, mut token) = (None, None, None);
    while !service.stopping() {
        let Some(wake) = grid.wait() else { continue };
        let mut flow = Flow::default();
        if let Some(newest) = samples.latest()? {
            if sample.is_none() {
                service.event(
                    EventKind::ControlResumed,
                    Severity::Info,
                    [newest.master_position[0], 0.0, 0.0],
                    "control continues from the measured position",
                )?;
            }
            validation.see(&newest);
            sample = Some(newest);
        }
        flow.pass(Checkpoint::SampleTaken);
        // All of them, not only the newest: with two senders, the last one received need not be the
        // one to follow.
        while let Some(next) = setpoints.take()? {
            match validation.validate(now_ns(), &next) {
                Ok(()) => setpoint = Some(next),
                Err(refusal) => {
                    if let Some(notice) = validation.notice(now_ns(), refusal, &next) {
                        service.publish(notice.event())?;
                    }
                }
            }
        }
        flow.pass(Checkpoint::SetpointsTaken);
        token = tokens.latest()?.or(token);
        flow.pass(Checkpoint::TokenTaken);
        if let Some(sample) = &sample {
            let seen = Seen {
                sample,
                setpoint: setpoint.as_ref(),
                token: token.as_ref(),
                incarnation: identity.incarnation,
            };
            let mut command = seen.step(&mut law, now_ns());
            flow.pass(Checkpoint::LawStepped);
            command.flow = flow.signature(command.token_sequence);
            command.cycles_missed = grid.missed();
            command.profile = profile.code();
            commands.send(command)?;
        }
        let losses = Losses { refused: validation.refused_in_all(), ..Losses::default() }
            .received(samples.counters())
            .received(setpoints.counters())
            .received(tokens.counters())
            .sent(commands.undelivered());
        service.end_cycle(&grid, &wake, losses)?;
        service.beat();
    }
    service.end()?;
    Ok(())
}
