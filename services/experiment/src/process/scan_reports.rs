//! The scanner's line in, volumes and events out.

use std::cmp::Ordering;

use ipc_types::{
    Event, EventKind, LineEvent, Process, SCANNER, SCANNER_KEY, ScannerPulse, Severity, VOLUME,
    Volume,
};
use rtrb::Consumer;
use runtime::{Losses, PortError, Publisher, Service, Subscriber};

use crate::cycle::{Received, SCAN_REPORTS_A_CYCLE};
use crate::player::Player;
use crate::scan_tracker::ScanReport;

/// The ports of the scanner.
#[derive(Debug)]
pub(super) struct ScanPorts {
    pulses: Subscriber<ScannerPulse>,
    keys: Publisher<ScannerPulse>,
    /// Keys that a process before counted in the segment that goes on, the newest first.
    earlier: Vec<u64>,
    volumes: Publisher<Volume>,
    /// A protocol has ended, and its counts are to be published after the last report.
    counts_due: bool,
}

impl ScanPorts {
    /// `keys`: those that a process before counted in the segment that goes on (ns).
    pub(super) fn open(service: &mut Service, mut keys: Vec<u64>) -> Result<Self, PortError> {
        keys.reverse();
        Ok(Self {
            pulses: service.subscriber(SCANNER)?,
            keys: service.publisher(SCANNER_KEY)?,
            earlier: keys,
            volumes: service.publisher(VOLUME)?,
            counts_due: false,
        })
    }

    /// Tells the player what has happened on the trigger line, and which keys were pressed.
    pub(super) fn tell(
        &mut self,
        player: &mut Player,
        received: &mut Received,
        keys: &mut Consumer<u64>,
    ) -> Result<(), PortError> {
        // What there is no room for waits in shared memory.
        while player.can_see_scanner()
            && let Some(pulse) = self.pulses.take()?
        {
            received.pulse(&pulse, player);
        }
        // They were published when they were pressed.
        while player.can_see_scanner()
            && let Some(at_ns) = self.earlier.pop()
        {
            player.see_scanner_key(at_ns);
        }
        while player.can_see_scanner()
            && let Ok(at_ns) = keys.pop()
        {
            received.key(at_ns, player);
            let kind = LineEvent::Pulse.code();
            let (pulses, none) = (received.keys, ScannerPulse::default());
            self.keys.send(ScannerPulse { at_ns, pulses, kind, ..none })?;
        }
        Ok(())
    }

    /// Publishes what the player reports of the scan.
    pub(super) fn publish(
        &mut self,
        player: &mut Player,
        service: &mut Service,
    ) -> Result<(), PortError> {
        for _ in 0..SCAN_REPORTS_A_CYCLE {
            let Some(report) = player.take_scan_report() else { break };
            let (kind, severity, a, b) = match report {
                ScanReport::Volume(volume) => {
                    self.volumes.send(volume)?;
                    continue;
                }
                ScanReport::Started { after_s } => {
                    (EventKind::ScannerStarted, Severity::Info, after_s, 0.0)
                }
                ScanReport::Missed { first, count } => {
                    (EventKind::VolumesMissed, Severity::Warning, first as f64, count as f64)
                }
                ScanReport::Spurious { after } => {
                    (EventKind::PulseSpurious, Severity::Warning, after as f64, 0.0)
                }
                ScanReport::Restarted { first } => {
                    (EventKind::ScannerRestarted, Severity::Warning, first as f64, 0.0)
                }
            };
            let event = Event::new(Process::Experiment, kind, severity, "");
            service.publish(Event { a, b, segment: player.status().segment, ..event })?;
        }
        if self.counts_due && !player.has_scan_reports() {
            self.counts_due = false;
            publish_counts(player, service)?;
        }
        Ok(())
    }

    /// A protocol has ended: its counts are published after the reports that still wait.
    pub(super) const fn end(&mut self) {
        self.counts_due = true;
    }

    /// Keeps the list of subscribers current: there may be no volume for hours.
    pub(super) fn refresh(&self) {
        self.volumes.refresh();
        self.keys.refresh();
    }

    pub(super) fn losses(&self, losses: Losses) -> Losses {
        losses
            .received(self.pulses.counters())
            .sent(self.volumes.undelivered())
            .sent(self.keys.undelivered())
    }
}

/// Publishes the counts of a protocol that has ended; nothing where it counted no volumes.
fn publish_counts(player: &Player, service: &mut Service) -> Result<(), PortError> {
    let status = player.status();
    let Some(scan) = status.scan else { return Ok(()) };
    let wrong = scan.missed + scan.spurious + scan.surplus > 0;
    let (severity, text) = match (scan.expected, scan.volumes.cmp(&scan.expected), wrong) {
        (0, _, false) => (Severity::Info, "the protocol does not say how many were expected"),
        (0, _, true) => (Severity::Warning, "volumes without a pulse, or pulses of no volume"),
        (_, Ordering::Less, _) => (Severity::Warning, "fewer than were expected"),
        (_, _, true) => (Severity::Warning, "as many as were expected, and pulses of no volume"),
        (_, _, false) => (Severity::Info, "as many as were expected"),
    };
    let event = Event::new(Process::Experiment, EventKind::VolumesCounted, severity, text);
    let (a, b, c) = (scan.volumes as f64, scan.missed as f64, scan.spurious as f64);
    service.publish(Event { a, b, c, segment: status.segment, ..event })
}
