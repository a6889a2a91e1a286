//! The control process and its laws.
//!
//! [`law`] is pure; [`run`] is the loop around it: the newest sample and setpoint in, one command
//! out. [`setpoint_validation`] decides which setpoints it follows. [`cycle`] is what lies between
//! receiving and publishing; `farreach rec resim` runs it again.

pub mod cycle;
pub mod law;
mod process;
pub mod setpoint_validation;

pub use process::run;
