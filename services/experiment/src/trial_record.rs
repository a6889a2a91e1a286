//! The slave's positions over one trial, and why a trial may not be learnt from.

use crate::trial_schedule::Schedule;

/// The slave's positions over a block, or over the identification.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialRecord {
    /// Number of the learning run.
    pub run_id: u32,
    /// Number of the block, from 1; 0 for the identification.
    pub block: u32,
    /// First step.
    from: i64,
    /// Steps.
    len: usize,
    /// The slave's position at each step (rad or m); not a number where it was not measured.
    pub slave: Vec<f64>,
    /// Why it cannot be learnt from; `None`: it can.
    pub fault: Option<Fault>,
    /// Whether it is the last one of the run.
    pub last: bool,
}

/// Why a block cannot be learnt from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The motor had no power for part of it.
    NoPower,
    /// It was played with an older reference than the latest one.
    OldReference,
}

impl TrialRecord {
    /// Creates an empty record, long enough for any of a learning run.
    pub fn new(schedule: &Schedule) -> Self {
        let steps = schedule.block_steps().max(schedule.identifying_steps());
        Self {
            run_id: 0,
            block: 0,
            from: 0,
            len: 0,
            slave: vec![f64::NAN; steps],
            fault: None,
            last: false,
        }
    }

    /// The slave's positions at the steps of the record (rad or m).
    pub fn path(&self) -> &[f64] {
        &self.slave[..self.len.min(self.slave.len())]
    }

    /// Clears the record.
    pub fn clear(&mut self) {
        self.slave.fill(f64::NAN);
        (self.fault, self.last, self.len, self.run_id) = (None, false, 0, 0);
    }

    pub(crate) fn begin(&mut self, run_id: u32, block: u32, from: i64, len: usize) {
        (self.run_id, self.block, self.from, self.len) = (run_id, block, from, len);
    }

    pub(crate) fn end(&self) -> i64 {
        self.from + self.len as i64
    }

    pub(crate) fn record(&mut self, step: i64, on_step: bool, slave: f64, powered: bool) {
        if step < self.from || step >= self.end() {
            return;
        }
        if !powered {
            self.fault.get_or_insert(Fault::NoPower);
        }
        if on_step && let Some(value) = self.slave.get_mut((step - self.from) as usize) {
            *value = slave;
        }
    }
}
