//! The process: the loop between card and shared memory.

use ipc_types::program_flow::{Checkpoint, Flow};
use ipc_types::{
    AXES, COMMAND, EnableToken, EventKind, HOME_ORDER, HomeOrder, MotorCommand, Process, SAMPLE,
    SCANNER, SYNC_ORDER, Sample, Severity, SyncOrder, TOKEN,
};
use rig::RigFile;
use runtime::clock::now_ns;
use runtime::daq::{Daq, DaqError};
use runtime::gate::{Gate, GateConfig, GateOutput};
use runtime::{Grid, PortError, Service, ServiceError, Subscriber};
use thiserror::Error;

use crate::homing::{Changes, Homing};
use crate::homing_file::{self, HomingFile};
use crate::sync_pulse::{Ordered, SyncPulse};
use crate::trigger::Trigger;
use crate::{CardError, CardOptions, Converter, StartError};

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum AcquisitionError {
    #[error(transparent)]
    Card(#[from] CardError),
    #[error("card: {0}")]
    Start(#[from] StartError),
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

/// The zeros of the encoders, and the file that keeps them.
struct Zeroing {
    homing: Homing,
    file: HomingFile,
    orders: Subscriber<HomeOrder>,
}

impl Zeroing {
    /// Takes up the zeros of an earlier process. A card without outputs moves nothing: its
    /// positions count as absolute.
    fn new(rig: &RigFile, service: &mut Service, daq: &dyn Daq) -> Result<Self, AcquisitionError> {
        let directory = service.domain().name().make_run_directory().map_err(ServiceError::from)?;
        let kept = homing_file::read(&directory).or_else(|reason| {
            let told = service.event(EventKind::HomingLost, Severity::Warning, [0.0; 3], &reason);
            told.map(|()| None)
        })?;
        let homing = if daq.capabilities().accepts_output {
            Homing::new(rig, service.identity().session, kept.as_ref())
        } else {
            Homing::absolute(rig)
        };
        let file = HomingFile::open(directory, service.domain().fifo());
        let file = file.map_err(ServiceError::from)?;
        Ok(Self { homing, file, orders: service.subscriber(HOME_ORDER)? })
    }

    /// Carries out the orders that have come.
    fn take_orders(&mut self, service: &mut Service) -> Result<(), PortError> {
        while let Some(order) = self.orders.take()? {
            // One that repeats what was carried out is refused, as it should be.
            if order.session == service.identity().session
                && let Ok(changes) = self.homing.order(&order)
            {
                self.told(&changes, service)?;
            }
        }
        Ok(())
    }

    /// Publishes what has changed, and keeps it.
    fn told(&mut self, changes: &Changes, service: &mut Service) -> Result<(), PortError> {
        let zeros = self.homing.zeros();
        for axis in 0..AXES {
            if changes.homed & 1 << axis != 0 {
                let values = [axis as f64, zeros.master[axis] as f64, zeros.slave[axis] as f64];
                service.event(EventKind::AxisHomed, Severity::Info, values, "")?;
            }
            if let Some(lost) = changes.lost[axis] {
                let values = [axis as f64, 0.0, 0.0];
                service.event(EventKind::HomingLost, Severity::Error, values, lost.text())?;
            }
        }
        if changes.kept
            && let Some(state) = self.homing.state()
        {
            self.file.keep(state);
        }
        if self.file.take_failure() {
            let text = "the zeros could not be kept: after a restart of acquisition, home again";
            service.event(EventKind::CardFault, Severity::Warning, [0.0; 3], text)?;
        }
        Ok(())
    }
}

/// The pulse for the beginning of a session, and the orders for it.
struct Sync {
    /// `None` where the rig has no such output, or the card none at all.
    pulse: Option<SyncPulse>,
    orders: Subscriber<SyncOrder>,
}

impl Sync {
    fn new(rig: &RigFile, service: &Service, daq: &dyn Daq) -> Result<Self, PortError> {
        let output = rig.sync.filter(|sync| sync.output < daq.capabilities().digital_outputs);
        Ok(Self { pulse: output.map(SyncPulse::new), orders: service.subscriber(SYNC_ORDER)? })
    }

    /// Carries out the orders that have come, and sets the outputs.
    fn cycle(&mut self, service: &mut Service, daq: &mut dyn Daq) -> Result<(), AcquisitionError> {
        while let Some(order) = self.orders.take()? {
            let Some(pulse) = &mut self.pulse else { continue };
            if order.session != service.identity().session {
                continue;
            }
            let (after_ns, severity, text) = match pulse.order(&order, now_ns()) {
                Ordered::Begins(after_ns) => (after_ns, Severity::Info, ""),
                Ordered::TooLate(after_ns) => (after_ns, Severity::Warning, "too late: no pulse"),
            };
            let after_s = after_ns as f64 * 1e-9;
            let values = [f64::from(order.number), after_s, f64::from(pulse.output())];
            service.event(EventKind::SyncPulse, severity, values, text)?;
        }
        if let Some(pulse) = &mut self.pulse {
            daq.write_digital(pulse.levels(now_ns()))?;
        }
        Ok(())
    }

    /// What the outputs are left with: no pulse, and 0 V.
    fn end(&self, daq: &mut dyn Daq) -> Result<(), DaqError> {
        let idle = self.pulse.map_or(Ok(()), |pulse| daq.write_digital(pulse.idle_levels()));
        daq.write([0.0; AXES])?;
        idle
    }
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
    let mut zeroing = Zeroing::new(rig, service, daq)?;
    let mut trigger = Trigger::new(rig);
    let mut sync = Sync::new(rig, service, daq)?;
    let mut pulses = service.publisher(SCANNER)?;
    // Zeroes whatever a predecessor left in the DACs before anything else; no output gives a pulse.
    sync.end(daq)?;
    let profile = service.enter_loop()?;
    let mut reported_finished = false;
    let mut cycles = || -> Result<(), AcquisitionError> {
        while !service.stopping() {
            let Some(wake) = grid.wait() else { continue };
            let mut flow = receive(&mut gate, &mut tokens, &mut commands)?;
            sync.cycle(service, daq)?;
            let mut output = gate.step(now_ns());
            flow.pass(Checkpoint::GateStepped);
            if daq.write(output.volts).is_err() {
                output = gate.write_failed();
                daq.write(output.volts)?;
            }
            flow.pass(Checkpoint::VoltsWritten);
            zeroing.take_orders(service)?;
            let missed = daq.scans_missed();
            let mut taken = None;
            for scan in daq.read_due(wake.woke_ns)? {
                let changes = zeroing.homing.observe(scan);
                if changes != Changes::default() {
                    zeroing.told(&changes, service)?;
                }
                let mut sample = converter.convert(scan, zeroing.homing.zeros());
                let mut flow = flow;
                flow.pass(Checkpoint::ScanConverted);
                stamp(&mut sample, &output, flow);
                sample.scans_missed = missed;
                sample.cycles_missed = grid.missed();
                sample.backend = backend;
                sample.profile = profile.code();
                if let Some(pulse) = trigger.as_mut().and_then(|trigger| trigger.observe(&sample)) {
                    pulses.send(pulse)?;
                }
                samples.send(sample)?;
                taken = Some(scan.tick);
            }
            if let Some(tick) = taken {
                daq.taken(tick);
            }
            let losses = daq
                .losses()
                .received(tokens.counters())
                .received(commands.counters())
                .received(zeroing.orders.counters())
                .received(sync.orders.counters());
            let losses = losses.sent(samples.undelivered()).sent(pulses.undelivered());
            if service.end_cycle(&grid, &wake, losses)? {
                // Late subscribers receive the earlier pulses only through this.
                pulses.refresh();
            }
            if daq.finished() && !reported_finished {
                reported_finished = true;
                let (kind, text) = (EventKind::ReplayDone, "the record has ended");
                service.event(kind, Severity::Info, [0.0; 3], text)?;
            }
            service.beat();
        }
        Ok(())
    };
    // Whatever ended the loop: a card holds its last volts.
    let ended = cycles();
    let zeroed = sync.end(daq);
    ended?;
    zeroed?;
    service.end()?;
    Ok(())
}

/// Shows the gate every token and command; the beginning of a cycle.
fn receive(
    gate: &mut Gate,
    tokens: &mut Subscriber<EnableToken>,
    commands: &mut Subscriber<MotorCommand>,
) -> Result<Flow, PortError> {
    let mut flow = Flow::default();
    while let Some(token) = tokens.take()? {
        gate.observe_token(&token);
    }
    flow.pass(Checkpoint::TokensTaken);
    while let Some(command) = commands.take()? {
        gate.observe_command(&command);
    }
    flow.pass(Checkpoint::CommandsTaken);
    Ok(flow)
}

/// Writes what the gate did into the sample, and the checkpoints that its cycle has passed.
fn stamp(sample: &mut Sample, output: &GateOutput, flow: Flow) {
    sample.flow = flow.signature(output.token_sequence);
    sample.output_v = output.volts;
    sample.epoch = output.epoch;
    sample.token_sequence = output.token_sequence;
    sample.command_incarnation = output.command_incarnation;
    sample.command_sequence = output.command_sequence;
    sample.gate_ns = output.now_ns;
    sample.gate_cycles = output.cycles;
    sample.gate_state = output.state.code();
    sample.gate_cause = output.cause.code();
}
