//! From the true state to volts.
//!
//! Each instrument is pure: time, position and torque are arguments, noise is seeded, a reading
//! allocates nothing.
//!
//! - [`TorqueCell`] is the optical torque cell, [`Drift`] its wandering zero;
//! - [`Emg`] are six surface electrodes over the muscles that make the hand's torque;
//! - [`ScannerTrigger`] is the scanner's pulse per volume, [`ScannerEmulator`] a scanner whose
//!   pulses jitter, are missing, or too many.

mod emg;
mod filter;
mod scanner_emulator;
mod torque_cell;
mod trigger;

pub use emg::{EMG_CHANNELS, Emg, EmgParameters};
pub use filter::{BandPass, Biquad};
pub use scanner_emulator::{ScannerEmulator, TriggerFaults};
pub use torque_cell::{Drift, TorqueCell, TorqueCellParameters};
pub use trigger::ScannerTrigger;
