//! Checks of the machine: each a thin measurement and a pure judgement of what it measured.

pub(crate) mod clock;
pub(crate) mod disk;
mod load;
pub(crate) mod memory_lock;
pub(crate) mod processors;
pub(crate) mod scheduling;
pub(crate) mod shared_memory;
pub(crate) mod units;
pub(crate) mod wake;
