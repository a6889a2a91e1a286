//! The control process and its laws.
//!
//! [`law`] is pure; [`run`] is the loop around it: the newest sample and setpoint in, one command out. [`admit`] decides which
//! setpoints it follows. [`learning`] is pure too: it
//! makes the reference of a periodic movement better from cycle to cycle.

pub mod admit;
pub mod law;
pub mod learning;
mod process;

pub use process::{ControlError, Options, law_config, run};
