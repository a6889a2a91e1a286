//! The card in one process with its caller: the same card, clocked by hand.

use std::collections::VecDeque;

use ipc_types::{AXES, CARD_FIFO, CardKind};
use rig::RigFile;
use runtime::daq::{Daq, DaqError, Present, Scan};

use crate::card::Card;
use crate::machine::CardError;

/// A simulated card that time passes on only when [`LockStepDaq::advance`] is called.
#[derive(Debug)]
pub struct LockStepDaq {
    card: Card,
    fifo: VecDeque<Scan>,
    batch: Vec<Scan>,
    present: Present,
    tick: u64,
    period_ns: u64,
    missed: u64,
    keeps_power: bool,
    sequence: u64,
}

impl LockStepDaq {
    /// A card whose enable line toggles by itself (`keeps_power`), or only through
    /// [`LockStepDaq::card`].
    pub fn new(
        rig: &RigFile,
        effects: &[String],
        line_ns: u64,
        keeps_power: bool,
    ) -> Result<Self, CardError> {
        Ok(Self {
            card: Card::new(rig, effects, line_ns)?,
            fifo: VecDeque::with_capacity(CARD_FIFO),
            batch: Vec::with_capacity(CARD_FIFO),
            present: present(rig),
            tick: 1,
            period_ns: 1_000_000_000 / u64::from(rig.rates.acquisition_hz),
            missed: 0,
            keeps_power,
            sequence: 0,
        })
    }

    /// The card itself.
    pub fn card(&mut self) -> &mut Card {
        &mut self.card
    }

    /// The card's time (ns).
    pub fn now_ns(&self) -> u64 {
        self.tick * self.period_ns
    }

    /// Lets `ticks` periods pass.
    pub fn advance(&mut self, ticks: u64) {
        for _ in 0..ticks {
            self.tick += 1;
            let now = self.now_ns();
            if self.keeps_power {
                self.card.enable_line(1, self.tick, now);
            }
            let scan = self.card.clock(self.tick, now);
            if self.card.scan_is_lost() {
                self.missed += 1;
                continue;
            }
            if self.fifo.len() == CARD_FIFO {
                self.fifo.pop_front();
                self.missed += 1;
            }
            self.fifo.push_back(Scan::of_card(&scan, self.present));
        }
    }
}

/// What the rig declares is there.
fn present(rig: &RigFile) -> Present {
    Present {
        master: rig.axis_bits(|_| true),
        slave: rig.axis_bits(|axis| axis.slave.is_some()),
        motor: rig.axis_bits(|_| true),
        analog: rig.channel_bits(),
    }
}

impl Daq for LockStepDaq {
    fn kind(&self) -> CardKind {
        CardKind::Simulated
    }

    fn read_due(&mut self, _now_ns: u64) -> Result<&[Scan], DaqError> {
        self.batch.clear();
        self.batch.extend(self.fifo.drain(..));
        Ok(&self.batch)
    }

    fn taken(&mut self, tick: u64) {
        self.card.taken(tick);
    }

    fn write(&mut self, volts: [f64; AXES]) -> Result<(), DaqError> {
        self.sequence += 1;
        if volts.iter().all(|v| v.is_finite()) {
            self.card.write(volts, self.sequence, 0);
            Ok(())
        } else {
            self.card.write([0.0; AXES], self.sequence, 0);
            Err(DaqError::NotFinite)
        }
    }

    fn write_digital(&mut self, levels: u32) -> Result<(), DaqError> {
        self.card.set_digital(levels);
        Ok(())
    }

    fn scans_missed(&self) -> u64 {
        self.missed
    }
}
