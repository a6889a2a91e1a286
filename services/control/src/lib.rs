//! The control process and its laws.
//!
//! [`law`] is pure; [`run`] is the loop around it: the newest sample and setpoint in, one command
//! out. [`admit`] decides which setpoints it follows.

pub mod admit;
pub mod law;
mod process;

pub use process::{ControlError, Options, law_config, run};
