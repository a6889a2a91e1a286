//! The hydrostatic transmission of thesis chapter 3, in its energy-consistent form.
//!
//! Two lines join master and slave in a ring. Each is a fluid mass between two springs of stiffness
//! `2K` (fig. 3.1). With `a_m = α_m r_mp` and `a_s = α_s r_sp` (fluid displacement per pulley
//! angle):
//!
//! ```text
//! F_m,i = 2K (s_i - a_m q_m) + D (ṡ_i - a_m q̇_m)               eq. 3.1.9
//! F_s,i = 2K (s_i - a_s q_s) + D (ṡ_i - a_s q̇_s)
//! m_l s̈_i = -F_lf(ṡ_i) - F_m,i - F_s,i                         eq. 3.1.8
//! I_m q̈_m = τ_m - τ_mf - r_mp F_mf + a_m (F_m,1 + F_m,2)       eq. 3.1.12, with α (see below)
//! I_s q̈_s = τ_hand - τ_sf + a_s (F_s,1 + F_s,2)
//! ```
//!
//! Eq. 3.1.12 is printed without the area ratios α; virtual work needs them, because eq. 3.1.9
//! scales displacement by α. As printed, power would not balance. All friction carries the sign of
//! its own speed, which the print leaves out. Both `s_i` count positive with a positive master, as
//! in the print: the fluid of line 2 really flows the other way round the ring, so its pressure
//! change has the opposite sign.

pub mod compliance;
mod oil_line;
mod parameters;

pub use crate::transmission::{
    Correction, EnergyBalance, ImposedMotion, Input, Reading, State, Transmission,
};
pub use oil_line::OilLine;
pub use parameters::Parameters;

/// The hydrostatic transmission in motion.
pub type Plant = crate::transmission::Plant<OilLine>;
