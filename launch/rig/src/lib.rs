//! Rig files and protocols: what a laboratory writes, checked before anything runs.
//!
//! A rig file (`rig.toml`) describes the rig: rates, axes with their encoders and limits, analog
//! channels, the declared model. A protocol (`protocol.toml`) describes an experiment as timed
//! movements. Both are read whole: every problem is reported at once, with file, line, key, what
//! was expected, what was found and what to do. The result depends on the text alone; the only I/O
//! is [`RigFile::load`] and [`protocol::Protocol::load`]. [`load_rig`] and [`load_protocol`] also
//! accept the name of a file that comes with farreach. [`load_declaration`] accepts a file that
//! declares a model alone.
//!
//! ```text
//! rig.toml:51: axes.0.limits.volts_max: expected a number from 0.1 to 10, found 24; …
//! rig.toml:52: axes.0.torque.volt_per_nm: expected one of channel, offset_v, volts_per_nm,
//! found an unknown key; did you mean `volts_per_nm`?
//! ```
//!
//! Degrees and counts exist in the files only. Code sees SI: rad or m by the axis's unit, N·m or N,
//! s, V.
#![forbid(unsafe_code)]

mod axis;
mod axis_control;
mod axis_unit;
mod built_in_files;
mod channel;
mod check;
mod checked_toml;
mod comedi_card;
mod compensation;
mod content_hash;
mod effect;
mod encoder;
mod error;
mod force_control;
mod grid_ages;
mod homing;
mod limits;
mod load;
mod measured_phases;
mod model;
mod muscles;
mod parameter;
mod plausibility;
pub mod protocol;
mod range_of_motion;
mod rates;
mod rig_file;
mod safety;
mod scanner_line;
mod simulated_scanner;
mod simulation;
mod siso_parameters;
mod stability_model;
mod sync_output;
mod torque_channel;

pub use axis::Axis;
pub use axis_control::{AxisControl, Feedforward};
pub use axis_unit::AxisUnit;
pub use built_in_files::{
    PROTOCOLS, RIGS, Shipped, home_protocol, load_declaration, load_protocol, load_rig,
};
pub use channel::{Channel, ChannelKind};
pub use comedi_card::{
    Calibration, ComediAxis, ComediCard, DigitalLines, EncoderCounter, InputCalibration,
    MotorOutput, SignalLine,
};
pub use compensation::{Compensation, CompensationKind, ControlOptions, Observer, SlaveLoop};
pub use content_hash::identity;
pub use effect::{ModelEffect, ModelEffectError};
pub use encoder::Encoder;
pub use error::{FileError, Problem, ProtocolError, RigError};
pub use force_control::{ACCELERATION_HZ, ForceControl};
pub use grid_ages::MissedTimeout;
pub use homing::{Homing, StopSearch};
pub use limits::Limits;
pub use model::{ForceSource, Model, ModelKind};
pub use parameter::{Parameter, ParameterSource};
pub use plausibility::{Plausibility, ThermalRating};
pub use range_of_motion::RangeOfMotion;
pub use rates::{Phases, Rates};
pub use rig_file::{Replay, RigFile};
pub use safety::{Safety, WithoutLogger};
pub use scanner_line::{ScannerInput, ScannerLine};
pub use simulated_scanner::DIGITAL_HIGH_V;
pub use simulation::{Hand, HandKind, Simulation};
pub use siso_parameters::is_rotary;
pub use sync_output::SyncOutput;
pub use torque_channel::TorqueChannel;

#[cfg(test)]
mod tests {
    mod generated_pages;
}
