//! The timing of a learning run, in control steps.

use rig::protocol::Learn;

/// The timing of a learning run on one rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// The segment's parameters.
    pub learn: Learn,
    /// Control steps in a cycle.
    pub cycle: usize,
    /// Period of control (ns).
    pub step_ns: u64,
    /// Period of the samples (ns).
    pub sample_ns: u64,
}

impl Schedule {
    /// Steps in a block.
    pub fn block_steps(&self) -> usize {
        self.cycle * self.learn.cycles_per_block as usize
    }

    /// Steps of the identification.
    pub fn identifying_steps(&self) -> usize {
        self.cycle * self.learn.identifying_cycles() as usize
    }

    /// Steps of the transition from one reference to the next.
    pub fn change_steps(&self) -> usize {
        self.cycle / 2
    }

    /// Duration of the transition (s).
    pub fn change_s(&self) -> f64 {
        self.change_steps() as f64 * self.step_ns as f64 * 1e-9
    }

    /// Latest step of a block at which a transition may begin: a quarter of a cycle is left to
    /// settle.
    pub(crate) fn latest_change(&self) -> i64 {
        (self.cycle * self.learn.settling_cycles as usize - self.change_steps() - self.cycle / 4)
            as i64
    }

    /// Time for which a record stays open after its end, for late samples (steps).
    pub(crate) fn grace(&self) -> i64 {
        (self.cycle / 16).clamp(1, 10) as i64
    }
}
