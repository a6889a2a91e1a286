//! Faults of the simulated card and machine, put in while it runs.
//!
//! [`LIST`] is the one list of their kinds. Those of the card act between plant and sample, or
//! between what is written and the motor ([`Injection`]); those of the machine are breakdowns in
//! the plant's physics ([`plant::effects::breakdowns`]). None draws random numbers, and none
//! changes what others draw: the readings of a card with a fault are those of one without, but for
//! the fault.

mod active;
mod fault;
mod injector;
mod kinds;

pub(crate) use active::{ActiveFaults, Counters};
pub use active::{FaultNotice, Injection, MOST_FAULTS};
pub use fault::{At, Fault, FaultError, FaultFilter};
pub use injector::FaultInjector;
pub use kinds::{Action, Acts, FaultKind, LIST, Place, Promise, Size, kind};
