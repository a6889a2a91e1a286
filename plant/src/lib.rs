//! The physics: transmissions, friction, sensors.
//!
//! Pure: no clock, no files, no threads, no randomness but what a caller seeds. Time and inputs are
//! arguments. SI units throughout (rad, m, N·m, N, s, Pa, V); a positive master movement drives the
//! slave positive.
//!
//! ```
//! use plant::hydrostatic::{Input, Parameters, Plant, Transmission};
//!
//! let backlash = plant::effects::parse("backlash@slave=0.01")?;
//! let mut plant = Plant::new(Parameters::calibrated(), vec![backlash])?;
//! for _ in 0..2000 {
//!     plant.step(Input { motor_v: 2.0, hand_torque_nm: 0.0 }, 0.5e-3);
//! }
//! assert!(plant.state().slave_position_rad > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - [`hydrostatic`] is the transmission of thesis chapter 3 in its energy-consistent form;
//! - [`cable`] is the transmission of chapter 5;
//! - [`transmission_kinds`] is either of them, for whoever knows the kind at run time only;
//! - [`coupled_axes`] is one to three of them at one handle;
//! - [`transmission`] is what all transmissions have in common, [`response`] their frequency
//!   response;
//! - [`reflected_dynamics`] has inertia, friction and stiffness of a transmission as its motor
//!   feels them;
//! - [`drive`] is a single mass with friction;
//! - [`friction`] has the laws of friction and exact stick;
//! - [`effects`] are the deviations that a declared model may lack, one file each, put into a plant
//!   by name;
//! - [`sensors`] turn torque and time into volts;
//! - [`stability`] tells whether a sampled control law keeps a transmission stable.

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod cable;
pub mod coupled_axes;
pub mod drive;
pub mod effects;
mod effects_as_parameters;
pub mod fluid;
pub mod fourier;
pub mod friction;
pub mod handle_inertia;
pub mod hydrostatic;
pub mod observer;
mod parameter;
pub mod reflected_dynamics;
pub mod response;
pub mod sensors;
pub mod stability;
pub mod thinning;
pub mod transmission;
pub mod transmission_kinds;

pub use parameter::{ParameterError, ParameterInfo, ParameterSet};
