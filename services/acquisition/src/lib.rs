//! The acquisition process: reads the card, converts, holds the gate, publishes samples.
//!
//! The loop is thin: [`runtime::daq::Daq`] is the card, [`runtime::gate::Gate`] decides what is
//! written, [`homing::Homing`] has the zeros of the encoders, [`Converter`] turns counts and volts
//! into SI, [`Trigger`] finds the scanner's pulses, [`sync_pulse`] tells other instruments when a
//! session begins. [`DRIVERS`] lists the cards that it can be started with: the simulator process,
//! a measured record, none, or a card with a Linux comedi driver.

mod cards;
mod convert;
pub mod homing;
mod homing_file;
mod process;
pub mod sync_pulse;
mod trigger;

pub use cards::{
    CardError, CardOptions, CheckedComedi, ComediDaq, DRIVERS, Driver, NullDaq, Opened, ReplayDaq,
    ReplayError, SimulatedDaq, StartError,
};
pub use convert::Converter;
pub use process::{AcquisitionError, run};
pub use trigger::Trigger;
