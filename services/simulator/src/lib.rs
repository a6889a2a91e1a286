//! The simulated card, and the process around it.
//!
//! [`Card`] is what a laboratory's card and rig are together, without a clock: DACs that hold
//! whatever was last written, whoever dies; a motor that loses power when the enable line stops
//! toggling; encoders, torque cell, analog inputs; behind them the plant. The process clocks it on
//! the grid and publishes each scan; the topic's history is the card's FIFO, so that it outlives
//! the acquisition that reads it. [`LockStepDaq`] is the same card in one process with its caller,
//! for tests and offline use.

mod card;
mod fault_requests;
pub mod faults;
mod lock_step;
mod machine;
mod process;
mod subject;

pub use card::{Card, PowerUp};
pub use lock_step::LockStepDaq;
pub use machine::{CardError, plant_of};
pub use process::{SimulatorError, run};
pub use subject::Subject;
