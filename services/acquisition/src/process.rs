//! The process: the loop between card and shared memory.

use ipc_types::{AXES, COMMAND, EventKind, Process, SAMPLE, Sample, Severity, TOKEN};
use rig::RigFile;
use runtime::clock::now_ns;
use runtime::daq::{Daq, DaqError};
use runtime::gate::{Gate, GateConfig, GateOutput};
use runtime::{Grid, PortError, Service, ServiceError};
use thiserror::Error;

use crate::{CardError, CardOptions, Converter};

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum AcquisitionError {
    #[error(transparent)]
    Card(#[from] CardError),
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
    #[error("card: {0}")]
    Daq(#[from] DaqError),
}

/// Runs acquisition with a card on the rig of that name until a signal ends it.
///
/// # Errors
/// [`AcquisitionError`].
pub fn run(rig_name: &str, rig: &RigFile, card: &CardOptions) -> Result<(), AcquisitionError> {
    // Reads and checks a record before the process joins the rig.
    let opened = card.open(rig)?;
    let mut service = Service::start(Process::Acquisition, rig_name)?;
    let mut card = opened(&service, rig)?;
    run_loop(rig, &mut service, &mut *card)
}

/// A closed gate with the limits of the rig file.
fn gate(rig: &RigFile, service: &Service) -> Gate {
    let mut volts_max = [0.0; AXES];
    for (limit, axis) in volts_max.iter_mut().zip(&rig.axes) {
        *limit = axis.limits.volts_max;
    }
    let identity = service.identity();
    Gate::new(GateConfig::for_profile(
        service.domain().profile(),
        identity.session,
        identity.incarnation,
        rig.axes.len(),
        volts_max,
    ))
}

fn run_loop(
    rig: &RigFile,
    service: &mut Service,
    daq: &mut dyn Daq,
) -> Result<(), AcquisitionError> {
    let mut samples = service.publisher(SAMPLE)?;
    let mut tokens = service.subscriber(TOKEN)?;
    let mut commands = service.subscriber(COMMAND)?;
    let mut grid = Grid::of_rate(rig.rates.acquisition_hz, rig.phases.acquisition_ns);
    let converter = Converter::new(rig);
    let backend = daq.kind().code();
    let mut gate = gate(rig, service);
    // Zeroes whatever a predecessor left in the DACs before anything else.
    daq.write([0.0; AXES])?;
    let profile = service.enter_loop()?;
    let mut reported_finished = false;
    let mut cycles = || -> Result<(), AcquisitionError> {
        while !service.stopping() {
            let Some(wake) = grid.wait() else { continue };
            while let Some(token) = tokens.take()? {
                gate.observe_token(&token);
            }
            while let Some(command) = commands.take()? {
                gate.observe_command(&command);
            }
            let mut output = gate.step(now_ns());
            if daq.write(output.volts).is_err() {
                output = gate.write_failed();
                daq.write(output.volts)?;
            }
            let missed = daq.scans_missed();
            let mut taken = None;
            for scan in daq.read_due(wake.woke_ns)? {
                let mut sample = converter.convert(scan);
                stamp(&mut sample, &output);
                sample.scans_missed = missed;
                sample.cycles_missed = grid.missed();
                sample.backend = backend;
                sample.profile = profile.code();
                samples.send(sample)?;
                taken = Some(scan.tick);
            }
            if let Some(tick) = taken {
                daq.taken(tick);
            }
            let losses = daq.losses().received(tokens.counters()).received(commands.counters());
            service.end_cycle(&grid, &wake, losses.sent(samples.undelivered()))?;
            if daq.finished() && !reported_finished {
                reported_finished = true;
                service.event(
                    EventKind::ReplayDone,
                    Severity::Info,
                    [0.0; 3],
                    "the record has ended",
                )?;
            }
            service.beat();
        }
        Ok(())
    };
    // Whatever ended the loop: a card holds its last volts.
    let ended = cycles();
    let zeroed = daq.write([0.0; AXES]);
    ended?;
    zeroed?;
    service.end()?;
    Ok(())
}

/// Writes what the gate did into the sample.
fn stamp(sample: &mut Sample, output: &GateOutput) {
    sample.output_v = output.volts;
    sample.epoch = output.epoch;
    sample.token_sequence = output.token_sequence;
    sample.command_incarnation = output.command_incarnation;
    sample.command_sequence = output.command_sequence;
    sample.gate_state = output.state.code();
    sample.gate_cause = output.cause.code();
}
