//! Equation-error method: the force that the measured motion requires is compared with the measured
//! force. Such models are linear in their parameters except for a few nonlinear ones (shapes), so
//! that fits are exact and fast, and there is no drift, as in the simulation of a machine without a
//! spring.

pub mod block_roles;
pub mod fit;
mod grid_prescreen;
mod instrument_noise;
pub mod model;
pub mod signals;
pub mod spline;
