//! The control process and its laws.
//!
//! [`law`] is pure; [`run`] is the loop around it: the newest sample and setpoint in, one command
//! out. [`setpoint_validation`] decides which setpoints it follows.

pub mod law;
mod process;
pub mod setpoint_validation;

pub use process::run;
