//! The acquisition process: reads the card, converts, holds the gate, publishes samples.
//!
//! The loop is thin: [`runtime::daq::Daq`] is the card, [`runtime::gate::Gate`] decides what is
//! written, [`Converter`] turns counts and volts into SI. The card is chosen by a [`Card`]
//! of the options: the simulator process, a measured record, or none.

mod convert;
mod null;
mod process;
mod replay;
mod simulated;

pub use convert::Converter;
pub use null::NullDaq;
pub use process::{AcquisitionError, Card, Options, run};
pub use replay::{ReplayDaq, ReplayError};
pub use simulated::SimulatedDaq;
