//! No card: scans that hold nothing, so that the chain can be run and timed by itself.

use ipc_types::{AXES, CardKind};
use runtime::daq::{Daq, DaqError, Scan};

/// Most scans of one call: what the FIFO of such a card would hold.
const BATCH: usize = CardKind::Null.capabilities().fifo_depth;

/// A card without inputs and outputs.
#[derive(Debug)]
pub struct NullDaq {
    period_ns: u64,
    last_tick: Option<u64>,
    batch: Vec<Scan>,
    missed: u64,
}

impl NullDaq {
    /// A card that is scanned `rate_hz` times a second.
    pub fn new(rate_hz: u32) -> Self {
        let period_ns = 1_000_000_000 / u64::from(rate_hz.max(1));
        Self { period_ns, last_tick: None, batch: Vec::with_capacity(BATCH), missed: 0 }
    }
}

impl Daq for NullDaq {
    fn kind(&self) -> CardKind {
        CardKind::Null
    }

    fn read_due(&mut self, now_ns: u64) -> Result<&[Scan], DaqError> {
        self.batch.clear();
        let newest = now_ns / self.period_ns;
        let mut first = self.last_tick.map_or(newest, |last| last + 1);
        let oldest_kept = (newest + 1).saturating_sub(BATCH as u64);
        if first < oldest_kept {
            self.missed += oldest_kept - first;
            first = oldest_kept;
        }
        for tick in first..=newest {
            self.batch.push(Scan { tick, time_ns: tick * self.period_ns, ..Scan::default() });
        }
        self.last_tick = Some(self.last_tick.map_or(newest, |last| last.max(newest)));
        Ok(&self.batch)
    }

    fn taken(&mut self, _tick: u64) {}

    fn write(&mut self, volts: [f64; AXES]) -> Result<(), DaqError> {
        only_zero(volts)
    }

    fn scans_missed(&self) -> u64 {
        self.missed
    }
}

/// What a card without outputs says to a write.
pub(super) fn only_zero(volts: [f64; AXES]) -> Result<(), DaqError> {
    if !volts.iter().all(|v| v.is_finite()) {
        Err(DaqError::NotFinite)
    } else if volts.iter().any(|v| *v != 0.0) {
        Err(DaqError::NoOutput)
    } else {
        Ok(())
    }
}
