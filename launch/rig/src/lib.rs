//! Rig files and protocols: what a laboratory writes, checked before anything runs.
//!
//! A rig file (`rig.toml`) says what the machine is: rates, axes with their encoders and limits,
//! analog channels, the declared model. A protocol (`protocol.toml`) says what it shall do: timed
//! movements. Both are read whole: every problem is reported at once, with file, line, key, what
//! was expected, what was found and what to do. The text alone decides; nothing here reads a clock
//! or touches a device, and the only I/O is [`RigFile::load`] and [`protocol::Protocol::load`].
//! [`load_rig`] and [`load_protocol`] take the name of a file that comes with farreach, too.
//!
//! ```text
//! rig.toml:51: axes.0.limits.volts_max: expected a number from 0.1 to 10, found 24; the card puts out ±10 V
//! rig.toml:52: axes.0.torque.volt_per_nm: expected one of channel, offset_v, volts_per_nm, found an unknown key; did you
//! mean `volts_per_nm`?
//! ```
//!
//! Degrees and counts exist only in the files. Code sees SI: rad or m by the axis's unit, N·m or N,
//! s, V.
#![forbid(unsafe_code)]

mod axis;
mod channel;
mod compensation;
mod effect;
mod error;
mod force;
mod identity;
mod model;
mod one_channel;
pub mod protocol;

mod rates;
mod read;
mod rig_file;
mod shipped;
mod simulation;
mod stability;

pub use axis::{Axis, AxisControl, AxisUnit, Encoder, Feedforward, Limits, TorqueChannel};
pub use channel::{Channel, ChannelKind};
pub use compensation::{
    CURVE_POINTS, Compensation, CompensationKind, ControlOptions, FrictionCurve, IdentifiedAxis,
    Observer, SlaveLoop,
};
pub use effect::{ModelEffect, ModelEffectError};
pub use error::{FileError, Problem, ProtocolError, RigError};
pub use force::{ACCELERATION_HZ, ForceControl};
pub use identity::{identity, identity_of_bytes};
pub use model::{Model, ModelKind, Parameter, ParameterSource};
pub use rates::{Phases, Rates};
pub use rig_file::{Replay, RigFile};
pub use shipped::{PROTOCOLS, RIGS, Shipped, load_protocol, load_rig};
pub use simulation::{Hand, HandKind, Simulation};
