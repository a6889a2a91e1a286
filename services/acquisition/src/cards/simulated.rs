//! The simulated card, over shared memory.

use ipc_types::{
    AXES, CARD_FIFO, CARD_OUTPUT, CARD_SCAN, CardKind, CardOutput, CardScan, is_filled_in,
};
use rig::RigFile;
use runtime::daq::{Daq, DaqError, Present, Scan};
use runtime::{Losses, PortError, Publisher, Service, Subscriber};

/// The simulator process as a card. Its FIFO outlives this object: a successor goes on behind the
/// scans that this one said it had taken.
#[derive(Debug)]
pub struct SimulatedDaq {
    scans: Subscriber<CardScan>,
    outputs: Publisher<CardOutput>,
    present: Present,
    period_ns: u64,
    batch: Vec<CardScan>,
    converted: Vec<Scan>,
    last_tick: Option<u64>,
    taken_tick: u64,
    digital_out: u32,
    missed: u64,
}

impl SimulatedDaq {
    /// Joins the simulated card of the service's rig.
    pub fn new(service: &Service, rig: &RigFile) -> Result<Self, PortError> {
        Ok(Self {
            scans: service.subscriber(CARD_SCAN)?,
            outputs: service.publisher(CARD_OUTPUT)?,
            present: Present {
                master: rig.axis_bits(|_| true),
                slave: rig.axis_bits(|axis| axis.slave.is_some()),
                motor: rig.axis_bits(|_| true),
                analog: rig.channel_bits(),
            },
            period_ns: rig.rates.acquisition_period_ns(),
            batch: Vec::with_capacity(2 * CARD_FIFO),
            converted: Vec::with_capacity(2 * CARD_FIFO),
            last_tick: None,
            taken_tick: 0,
            digital_out: 0,
            missed: 0,
        })
    }
}

impl Daq for SimulatedDaq {
    fn kind(&self) -> CardKind {
        CardKind::Simulated
    }

    fn read_due(&mut self, _now_ns: u64) -> Result<&[Scan], DaqError> {
        self.batch.clear();
        self.converted.clear();
        while self.batch.len() < self.batch.capacity() {
            match self.scans.take() {
                Ok(Some(scan)) => self.batch.push(scan),
                Ok(None) => break,
                Err(_) => return Err(DaqError::Link("receiving scans")),
            }
        }
        // Scans that a predecessor has published already; the card remembers how far it came.
        if self.last_tick.is_none()
            && let Some(newest) = self.batch.last()
            && newest.taken_tick > 0
        {
            self.last_tick = Some(newest.taken_tick);
        }
        for scan in &self.batch {
            if let Some(last) = self.last_tick {
                if scan.tick <= last {
                    continue;
                }
                self.missed += scan.tick - last - 1;
            }
            self.last_tick = Some(scan.tick);
            let filled_in = is_filled_in(scan.time_ns, scan.scan_time_ns, self.period_ns);
            self.converted.push(Scan { filled_in, ..Scan::of_card(scan, self.present) });
        }
        Ok(&self.converted)
    }

    fn taken(&mut self, tick: u64) {
        self.taken_tick = self.taken_tick.max(tick);
    }

    fn write(&mut self, volts: [f64; AXES]) -> Result<(), DaqError> {
        let finite = volts.iter().all(|v| v.is_finite());
        let output = CardOutput {
            volts: if finite { volts } else { [0.0; AXES] },
            taken_tick: self.taken_tick,
            digital_out: self.digital_out,
            ..CardOutput::default()
        };
        self.outputs.send(output).map_err(|_| DaqError::Link("sending volts"))?;
        if finite { Ok(()) } else { Err(DaqError::NotFinite) }
    }

    fn write_digital(&mut self, levels: u32) -> Result<(), DaqError> {
        // Sent with the volts, which are written in each cycle.
        self.digital_out = levels;
        Ok(())
    }

    fn scans_missed(&self) -> u64 {
        self.missed
    }

    fn losses(&self) -> Losses {
        Losses::default().received(self.scans.counters()).sent(self.outputs.undelivered())
    }
}
