//! From the true state to counts and volts.
//!
//! Each instrument is pure: time, position and torque are arguments, noise is seeded, a reading allocates nothing.
//!
//! - [`Encoder`] quantises; [`Phases`] are its two tracks and index, [`QuadratureDecoder`] what counts their edges;
//!   [`EncoderCounter`] is a counter card: wraps, latches at the index; [`Unwrap`] undoes the wrap;
//! - [`FilteredDifference`] and [`EdgePeriod`] estimate speed from counts, with a known lag;
//! - [`TorqueCell`] is the optical torque cell, [`Drift`] its wandering zero;
//! - [`Emg`] are six surface electrodes over the muscles that make the hand's torque;
//! - [`ScannerTrigger`] is the scanner's pulse per volume.

mod counter;
mod emg;
mod encoder;
mod filter;
mod speed;
mod torque_cell;
mod trigger;

pub use counter::{CounterReading, EncoderCounter, EncoderCounterParameters, QuadratureDecoder, Unwrap};
pub use emg::{EMG_CHANNELS, Emg, EmgParameters, Muscle};
pub use encoder::{Encoder, Phases};
pub use filter::{BandPass, Biquad};
pub use speed::{EdgePeriod, FilteredDifference, Speed};
pub use torque_cell::{Drift, TorqueCell, TorqueCellParameters};
pub use trigger::ScannerTrigger;
