//! The scanner's trigger line: from volts to pulses, and from pulses to volumes.
//!
//! An MR scanner sends a pulse with every volume. [`PulseDetector`] finds the pulses in the samples
//! of the line. [`VolumeClock`] numbers the volumes, one pulse at a time: it tells a pulse that
//! belongs to no volume from one that does, and finds out which volumes had none. [`reconcile`]
//! does the same for a whole recording and gives every volume a time. Everything here takes time
//! as an argument, and allocates nothing but the result of [`reconcile`].

mod pulse_detector;
mod reconciliation;
mod volume_clock;

pub use ipc_types::LineEvent as LineEventKind;
pub use pulse_detector::{Line, LineEvent, LineKind, PulseDetector};
pub use reconciliation::{Reconciliation, TimingLine, VolumeTime, between, reconcile};
pub use volume_clock::{Counted, Counts, REPETITION_S, Series, VolumeClock};
