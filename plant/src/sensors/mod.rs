//! From the true state to counts and volts.
//!
//! Each instrument is pure: time, position and torque are arguments, noise is seeded, a reading
//! allocates nothing.
//!
//! - [`Encoder`] quantises; [`Phases`] are its two tracks and index, [`QuadratureDecoder`] what
//!   counts their edges; [`EncoderCounter`] is a counter card: wraps, latches at the index;
//!   [`Unwrap`] undoes the wrap;
//! - [`FilteredDifference`] and [`EdgePeriod`] estimate speed from counts, with a known lag;
//! - [`TorqueCell`] is the optical torque cell, [`Drift`] its wandering zero;
//! - [`Emg`] are six surface electrodes over the muscles that make the hand's torque;
//! - [`ScannerTrigger`] is the scanner's pulse per volume.
//!
//! ```
//! use plant::sensors::{EncoderCounter, EncoderCounterParameters, FilteredDifference, Unwrap};
//!
//! // 16 bits wrap after three turns of 20 000 counts; unwrapping recovers twenty turns.
//! let parameters = EncoderCounterParameters { bits: 16.0, ..Default::default() };
//! let mut counter = EncoderCounter::new(&parameters)?;
//! let (mut unwrap, mut speed) = (Unwrap::new(16), FilteredDifference::new(0.5e-3, 5e-3));
//! let mut estimate = 0.0;
//! for tick in 0..=2000 {
//!     let true_position = 40.0 * std::f64::consts::PI * f64::from(tick) * 0.5e-3;
//!     let counts = unwrap.update(counter.read(true_position).raw);
//!     estimate = speed.update(counter.encoder().position(counts)).velocity;
//! }
//! assert!((estimate - 40.0 * std::f64::consts::PI).abs() < 0.1);
//! assert_eq!(counter.read(125.67).latches, 20);
//! # Ok::<(), plant::ParameterError>(())
//! ```

mod counter;
mod emg;
mod encoder;
mod filter;
mod speed;
mod torque_cell;
mod trigger;

pub use counter::{
    CounterReading, EncoderCounter, EncoderCounterParameters, QuadratureDecoder, Unwrap,
};
pub use emg::{EMG_CHANNELS, Emg, EmgParameters, Muscle};
pub use encoder::{Encoder, Phases};
pub use filter::{BandPass, Biquad};
pub use speed::{EdgePeriod, FilteredDifference, Speed};
pub use torque_cell::{Drift, TorqueCell, TorqueCellParameters};
pub use trigger::ScannerTrigger;
