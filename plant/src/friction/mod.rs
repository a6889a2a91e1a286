//! Friction: laws with one interface, and one degree of freedom over one step with exact stick.
//!
//! A [`FrictionLaw`] adds to a [`Load`] what friction does at an [`OperatingPoint`]; [`advance`]
//! then moves the mass and says how far, which a [`Bristle`], friction with memory, needs to know.
//! Laws add up: any number of them may contribute to one load. Friction acts against movement;
//! magnitudes are positive; N·m, rad and rad/s for a rotation and N, m and m/s for a translation.
//!
//! No law creates energy, whatever the step: the work done on a mass, less its kinetic energy and
//! what bristles store, never falls.
//!
//! ```
//! use plant::friction::{self, Coulomb, FrictionLaw, Load, OperatingPoint};
//!
//! // A slave of 2 g m² at 10 rad/s under 1 N·m of dry friction stops after I v² / 2 τ = 0.1 rad.
//! let mut law = Coulomb { level: 1.0 };
//! let (mut position, mut velocity, step) = (0.0, 10.0, 0.5e-3);
//! for _ in 0..100 {
//!     let mut load = Load { inertia: 2e-3, ..Load::default() };
//!     law.contribute(&mut load, &OperatingPoint { position, velocity, transmitted: 0.0, step });
//!     let moved = friction::advance(velocity, step, &load);
//!     (position, velocity) = (position + moved.displacement, moved.velocity);
//! }
//! assert_eq!(velocity, 0.0);
//! assert!((position - 0.1_f64).abs() < 1e-12);
//! ```

mod asymmetric;
mod bristle;
mod coulomb;
mod exact_stick_step;
mod load_dependent;
mod piecewise_linear;
mod position_dependent;
mod smoothed;
mod step_load;
mod stribeck;
mod viscous;

pub use asymmetric::Asymmetric;
pub use bristle::Bristle;
pub use coulomb::Coulomb;
pub use exact_stick_step::advance;
pub(crate) use exact_stick_step::impose;
pub use load_dependent::LoadDependent;
pub use piecewise_linear::Stribeck;
pub use position_dependent::PositionDependent;
pub use step_load::{Advance, DryFriction, Load, Smoothing};
pub use stribeck::StribeckCurve;
pub use viscous::Viscous;

use crate::ParameterSet;
use std::fmt;

/// Operating point of a degree of freedom during a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OperatingPoint {
    /// Position at the middle of the step, rad or m.
    pub position: f64,
    /// Predicted mean speed over the step, rad/s or m/s.
    ///
    /// The present speed makes a law first order; extrapolation by the last change of speed makes
    /// it second order.
    pub velocity: f64,
    /// Transmitted load on the degree of freedom, N·m or N; its sign does not matter.
    pub transmitted: f64,
    /// Length of the step, s.
    pub step: f64,
}

/// A law of friction on one degree of freedom.
pub trait FrictionLaw: ParameterSet + fmt::Debug + Send {
    /// Adds to a load what friction does over the coming step. Nothing is allocated.
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint);
}
