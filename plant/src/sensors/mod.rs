//! From the true state to volts.
//!
//! Each instrument is pure: time, position and torque are arguments, noise is seeded, a reading
//! allocates nothing.
//!
//! - [`TorqueCell`] is the optical torque cell, [`Drift`] its wandering zero;
//! - [`Emg`] are six surface electrodes over the muscles that make the hand's torque;
//! - [`ScannerTrigger`] is the scanner's pulse per volume.

mod emg;
mod filter;
mod torque_cell;
mod trigger;

pub use emg::{EMG_CHANNELS, Emg, EmgParameters};
pub use filter::{BandPass, Biquad};
pub use torque_cell::{Drift, TorqueCell, TorqueCellParameters};
pub use trigger::ScannerTrigger;
