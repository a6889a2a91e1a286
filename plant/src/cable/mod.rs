//! The cable transmission of thesis chapter 5: two kevlar cables that pull against each other.
//!
//! A cable runs from the master's pulley through three tubes to the slave's, another runs back: one
//! pulls the slave forward, the other backward, and neither pushes. Each is a mass in the middle
//! between two pieces of cable ([`Element`]), with friction where it passes a support. With cable
//! displacement `s_i` in the middle (both positive with a positive master), radii `a_m`, `a_s`, and
//! pretension `T_0`:
//!
//! ```text
//! x_m,1 = x_0 + a_m q_m - s_1   x_s,1 = x_0 + s_1 - a_s q_s   elongation of the forward cable
//! x_m,2 = x_0 - a_m q_m + s_2   x_s,2 = x_0 - s_2 + a_s q_s   of the backward one
//! T     = element(x) + D ẋ ≥ 0                                      § 5.2.1, figs. 5.3, 5.4, § 5.3
//! I_m q̈_m = τ_m - a_m (T_m,1 - T_m,2) - friction
//! m_i s̈_i = ±(T_m,i - T_s,i) - friction
//! I_s q̈_s = τ_hand + a_s (T_s,1 - T_s,2) - friction
//! F(T)  = F_∞ T/(T + T_h) per support                               figs. 5.5, 5.6
//! ```
//!
//! Supports: one at the master's end, two at the joints of the tubes, one at the slave's end. Each
//! one's friction acts on what moves there and follows the tension there, so that it multiplies
//! along the line while it is far from saturation, as a rope's round a capstan.
//!
//! ```
//! use plant::cable::{Input, Parameters, Plant, Transmission};
//!
//! let mut plant = Plant::new(Parameters { cables: 2.0, ..Parameters::calibrated() }, Vec::new())?;
//! plant.step(Input { motor_v: 5.0, hand_torque_nm: 0.0 }, 0.1);
//! assert!(plant.state().slave_position_rad > 0.0);
//! // Fig. 5.4: 20 cm of the cable on a testing machine; the second loading is the stiffer one.
//! let mut specimen = Parameters::printed().specimen(0.2);
//! let first = specimen.extend(1e-4);
//! specimen.extend(specimen.set_m());
//! assert!(specimen.extend(specimen.set_m() + 1e-4) > first);
//! # Ok::<(), plant::ParameterError>(())
//! ```
//!
//! What is printed, assumed and fitted: [`Parameters`] and `docs/errata.md`. Parallel cables
//! ([`Parameters::cables`]) are taken as alike: stiffness, mass, pretension and friction of a line
//! are those of one cable times their number. The slave's inertia stays, so that the resonance
//! rises a little slower than with the square root of the number.

mod cable_line;
mod element;
mod parameters;

pub use crate::transmission::{
    Correction, EnergyBalance, ImposedMotion, Input, Reading, State, Transmission,
};
pub use cable_line::CableLine;
pub use element::{Element, ElementLaw};
pub use parameters::Parameters;

/// The cable transmission in motion.
pub type Plant = crate::transmission::Plant<CableLine>;
