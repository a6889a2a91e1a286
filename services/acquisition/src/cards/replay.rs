//! A measured record where the card would be, at its own pace.

use std::path::Path;

use ipc_types::{AXES, CardKind};
use recording::record::{
    ColumnNames, FindingKind, Mapping, Options, Record, RecordError, SampleColumns, TIME, from_csv,
    from_mcap,
};
use rig::RigFile;
use runtime::daq::{Daq, DaqError, Physical, Present, Scan};
use thiserror::Error;

use super::null::only_zero;

/// Most scans of one call; a later call gets the rest, nothing is dropped.
const BATCH: usize = 512;

/// A record cannot be replayed on this rig.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum ReplayError {
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Its sampling is not the rig's.
    #[error(
        "{record}: sampled at {found:.3} Hz, but {rig} acquires at {expected} Hz; set \
         rates.acquisition_hz to the record's rate (a record is replayed at its own pace, never \
         resampled)"
    )]
    Rate { record: String, found: f64, rig: String, expected: u32 },
    /// None of the columns that the rig file names.
    #[error(
        "{record}: holds no column \"{position}\" (position of axis 0); the rig file's [replay] \
         section says which column is what, the record has: {found}"
    )]
    NoPosition { record: String, position: String, found: String },
    /// It was cut off: to pass a part of it for the whole is the operator's decision.
    #[error(
        "{record}: {what}; keep what can be read with `farreach rec recover {record} -o \
         MENDED.mcap` and replay that"
    )]
    Torn { record: String, what: String },
}

/// A record as a card.
#[derive(Debug)]
pub struct ReplayDaq {
    rows: Vec<Scan>,
    period_ns: u64,
    looped: bool,
    start_tick: Option<u64>,
    next: u64,
    batch: Vec<Scan>,
}

impl ReplayDaq {
    /// Reads a record: MCAP by its extension, else CSV. `[replay]` of the rig file says which
    /// column is what.
    pub fn open(path: &Path, rig: &RigFile, looped: bool) -> Result<Self, ReplayError> {
        let names = &rig.replay;
        let mut options = Options::default();
        let record = if path.extension().is_some_and(|extension| extension == "mcap") {
            let columns = SampleColumns::new(ColumnNames {
                motor: Some(names.motor_v.clone()),
                master: Some(names.position.clone()),
                slave: Some(names.slave_position.clone()),
                torque: Some(names.torque.clone()),
            });
            from_mcap(path, &columns, &options)?
        } else {
            if names.time != TIME {
                let (column, source) = (TIME.to_owned(), names.time.clone());
                options.mapping.push(Mapping { column, source, factor: 1.0 });
            }
            from_csv(path, &options)?
        };
        Self::new(&record, rig, looped)
    }

    /// A record that was read already.
    pub fn new(record: &Record, rig: &RigFile, looped: bool) -> Result<Self, ReplayError> {
        if let Some(torn) = record.findings.iter().find(|finding| finding.kind == FindingKind::Torn)
        {
            return Err(ReplayError::Torn { record: record.name.clone(), what: torn.text.clone() });
        }
        let names = &rig.replay;
        let expected = rig.rates.acquisition_hz;
        if (record.sampling_s * f64::from(expected) - 1.0).abs() > 1e-3 {
            return Err(ReplayError::Rate {
                record: record.name.clone(),
                found: 1.0 / record.sampling_s,
                rig: rig.file_name().to_owned(),
                expected,
            });
        }
        let Some(position) = record.column(&names.position) else {
            return Err(ReplayError::NoPosition {
                record: record.name.clone(),
                position: names.position.clone(),
                found: record.columns.keys().cloned().collect::<Vec<_>>().join(", "),
            });
        };
        let motor = record.column(&names.motor_v);
        let slave = record.column(&names.slave_position);
        let torque = record.column(&names.torque);
        let first = |value: f64| {
            let mut axes = [0.0; AXES];
            axes[0] = value;
            axes
        };
        let at = |column: Option<&[f64]>, row: usize| {
            first(column.and_then(|c| c.get(row)).copied().unwrap_or(0.0))
        };
        let rows = (0..record.len())
            .map(|row| Scan {
                record_time_s: record.time_s[row],
                motor_v: at(motor, row),
                physical: Physical {
                    master_position: at(Some(position), row),
                    slave_position: at(slave, row),
                    slave_torque: at(torque, row),
                    master: 1,
                    slave: u8::from(slave.is_some()),
                    torque: u8::from(torque.is_some()),
                },
                present: Present { motor: u8::from(motor.is_some()), ..Present::default() },
                ..Scan::default()
            })
            .collect();
        let period_ns = 1_000_000_000 / u64::from(expected);
        Ok(Self {
            rows,
            period_ns,
            looped,
            start_tick: None,
            next: 0,
            batch: Vec::with_capacity(BATCH),
        })
    }

    /// Rows of the record.
    pub fn rows(&self) -> usize {
        self.rows.len()
    }
}

impl Daq for ReplayDaq {
    fn kind(&self) -> CardKind {
        CardKind::Replay
    }

    fn read_due(&mut self, now_ns: u64) -> Result<&[Scan], DaqError> {
        self.batch.clear();
        let newest = now_ns / self.period_ns;
        let start = *self.start_tick.get_or_insert(newest);
        let due = newest.saturating_sub(start) + 1;
        let length = self.rows.len() as u64;
        while self.next < due && self.batch.len() < BATCH && (self.looped || self.next < length) {
            let Some(row) = self.rows.get((self.next % length.max(1)) as usize) else { break };
            let tick = start + self.next;
            self.batch.push(Scan { tick, time_ns: tick * self.period_ns, ..*row });
            self.next += 1;
        }
        Ok(&self.batch)
    }

    fn taken(&mut self, _tick: u64) {}

    fn write(&mut self, volts: [f64; AXES]) -> Result<(), DaqError> {
        only_zero(volts)
    }

    fn scans_missed(&self) -> u64 {
        0
    }

    fn finished(&self) -> bool {
        !self.looped && self.next >= self.rows.len() as u64
    }
}
