//! The process: clocks the card on the grid.

use ipc_types::{CARD_OUTPUT, CARD_SCAN, ENABLE_LINE, EventKind, PERFORMANCE, Process, Severity};
use rig::RigFile;
use runtime::{Grid, Losses, PortError, Service, ServiceError, Timeouts};
use thiserror::Error;

use crate::card::{Card, PowerUp};
use crate::fault_requests::FaultLink;
use crate::machine::CardError;

/// Scans that the card catches up with after it was not run for a while; a real card is never late.
const CATCH_UP: u64 = 4096;

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum SimulatorError {
    #[error(transparent)]
    Card(#[from] CardError),
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
}

/// Runs the simulated card on the rig of that name until a signal ends it. `effects`
/// (`ID[@SITE][=SIZE]`) are added to the plant; no model is told of them.
///
/// # Errors
/// [`SimulatorError`].
pub fn run(rig_name: &str, rig: &RigFile, effects: &[String]) -> Result<(), SimulatorError> {
    let mut service = Service::start(Process::Simulator, rig_name)?;
    let power_up = PowerUp::random(rig, rig.simulation.seed ^ service.identity().incarnation);
    let line_ns = Timeouts::of(service.domain().profile()).enable_line_ns;
    let mut card = Card::new(rig, effects, line_ns)?.with_power_up(power_up);
    let mut faults = FaultLink::serve(service.domain().name(), rig, effects)?;
    let mut scans = service.publisher(CARD_SCAN)?;
    let mut outputs = service.subscriber(CARD_OUTPUT)?;
    let mut lines = service.subscriber(ENABLE_LINE)?;
    let mut shown = service.subscriber(PERFORMANCE)?;
    let mut grid = Grid::of_rate(rig.rates.acquisition_hz, rig.phases.simulator_ns);
    let profile = service.enter_loop()?;
    let mut last_tick = None;
    while !service.stopping() {
        let Some(wake) = grid.wait() else { continue };
        while let Some(line) = lines.take()? {
            card.enable_line(line.incarnation, line.toggles, line.time_ns.min(wake.woke_ns));
        }
        while let Some(output) = outputs.take()? {
            card.write(output.volts, output.sequence, output.incarnation);
            card.set_digital(output.digital_out);
            card.taken(output.taken_tick);
        }
        while let Some(performance) = shown.take()? {
            card.show(&performance);
        }
        if let Some(event) = faults.carry_out(&mut card) {
            service.publish(event)?;
        }
        // A card's clock never misses: what is due since the last wake is clocked now.
        let mut first = last_tick.map_or(wake.tick, |tick: u64| tick + 1);
        if wake.tick - first >= CATCH_UP {
            let lost = wake.tick - first - CATCH_UP + 1;
            first += lost;
            service.event(
                EventKind::CardFault,
                Severity::Error,
                [lost as f64, 0.0, 0.0],
                "the simulated card was not run for too long; scans were skipped",
            )?;
        }
        for tick in first..=wake.tick {
            let mut scan = card.clock(tick, grid.wake_time(tick));
            scan.profile = profile.code();
            if !card.scan_is_lost() {
                scans.send(scan)?;
            }
            while let Some(notice) = card.fault_notice() {
                if let Some(event) = faults.tell(notice) {
                    service.publish(event)?;
                }
            }
        }
        last_tick = Some(wake.tick);
        let losses = Losses::default()
            .received(outputs.counters())
            .received(lines.counters())
            .received(shown.counters());
        service.end_cycle(&grid, &wake, losses.sent(scans.undelivered()))?;
        service.beat();
    }
    service.end()?;
    Ok(())
}
