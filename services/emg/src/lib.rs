//! From the voltages of surface electrodes to the activity of muscles.
//!
//! A [`Conditioner`] filters one electrode: band-pass, notch, rectification, envelope.
//! [`zero_phase`] does the same for a whole recording, without delay. [`ArtefactTemplate`] takes
//! the scanner's gradient artefact out before that; [`offline_artefact`] finds that of a recording.
//! [`ZeroPhase`] and [`offline_artefact_of`] do so where a recording is longer than the memory.
//! [`MuscleActivity`] does all of it for the electrodes of a rig and returns the activity of
//! agonists and antagonists; [`MovingMaximum`] finds the maximum of a contraction. Nothing here
//! reads a clock, and after construction nothing allocates but what is for recordings.

mod artefact_template;
mod conditioner;
mod moving_maximum;
mod muscle_activity;
mod offline_artefact;
mod signal;
mod zero_phase;

pub use artefact_template::{ArtefactTemplate, LONGEST_REPETITION_S};
pub use conditioner::{Activity, Conditioner, Conditioning, ConditioningError, HIGHEST_SHARE};
pub use moving_maximum::{MAXIMUM_WINDOW_S, MovingMaximum};
pub use muscle_activity::{Electrode, Group, MuscleActivity, MuscleSample};
pub use offline_artefact::{InVolume, offline_artefact, offline_artefact_of};
pub use signal::Signal;
pub use zero_phase::{ZeroPhase, zero_phase};
