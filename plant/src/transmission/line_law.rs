//! What distinguishes one transmission from another: the law of its two lines.

use std::fmt;

use super::TransmissionParameters;
use crate::effects::{Link, Side};
use crate::friction::{Advance, Load};

/// The law of a transmission's two lines.
///
/// Each line is a mass in the middle (the fluid, half the cable) between two links, one to the
/// master and one to the slave. The law gives the force of a link, the friction at each side and
/// the motion of the middle; the integrator ([`super::Plant`]) does everything else. Hooks are
/// called once per link, side or line and internal step; they must not allocate.
pub trait LineLaw: Clone + fmt::Debug + Send {
    /// The constants of the transmission.
    type Parameters: TransmissionParameters + Clone + fmt::Debug + Send;

    /// Largest phase of the highest mode in one internal step, rad.
    const PHASE_PER_STEP: f64;
    /// Whether dry friction can stop the middle of a line.
    const MIDDLE_STICKS: bool;

    /// The law with the constants of a transmission, lines at rest.
    fn new(parameters: &Self::Parameters) -> Self;

    /// Angular frequency of the highest mode (rad/s), with inertia (kg·m²) added at master and
    /// slave and links that effects stiffen by up to `stiffness_factor`.
    fn highest_mode_rad_s(
        parameters: &Self::Parameters,
        extra_inertia: [f64; 2],
        stiffness_factor: f64,
    ) -> f64 {
        parameters.changed_modes_rad_s(extra_inertia, 1.0)[3] * stiffness_factor.sqrt()
    }

    /// Lets a link rest at a deflection (m), which effects change by `shift_m`: its history is
    /// forgotten.
    fn rest(&mut self, _line: usize, _end: usize, _deflection_m: f64, _shift_m: f64) {}

    /// Computes the force of a link whose deflection effects may have changed from `declared_m` and
    /// whose rate they may have changed from `declared_rate_m_s`.
    ///
    /// Sets `force_n` and `fluid_force_n` of the link.
    fn force(&mut self, link: &mut Link, declared_m: f64, declared_rate_m_s: f64) -> DeclaredForce;

    /// Limits the force of a link to what the line can transmit, after effects have changed it.
    /// Returns the force that [`super::State::line_force_n`] reports, N.
    fn limit(&self, link: &mut Link) -> f64 {
        link.force_n
    }

    /// Energy that a link stores and the energy that it has dissipated, J, at a deflection (m)
    /// under a declared stiffness (N/m).
    fn energy_j(&self, line: usize, end: usize, deflection_m: f64, stiffness: f64) -> (f64, f64);

    /// Friction on one side without effects; force and inertia of the load are left unset.
    fn side_friction(
        &self,
        side: Side,
        position_rad: f64,
        velocity_rad_s: f64,
        coupling: &Coupling,
    ) -> Load;

    /// Moves the middle of a line by one internal step. `effects` returns the line's loss
    /// coefficient (N·s/m) with effects from that without.
    fn advance_middle(
        &self,
        middle: &Middle,
        coupling: &Coupling,
        effects: impl FnOnce(f64) -> f64,
    ) -> Advance;
}

/// The force of a link as the declared law has it, effects left out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeclaredForce {
    /// The spring's part, N.
    pub spring_n: f64,
    /// The damper's part, N.
    pub damper_n: f64,
    /// By how much effects changed the deflection since the last step, m, where `spring_n` follows
    /// the changed one.
    pub shift_m: f64,
}

/// The forces of the links during one internal step, each by line and end (master, slave).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coupling {
    /// Force on the coordinate of piston or pulley, N.
    pub end_n: [[f64; 2]; 2],
    /// Force on the line's middle, against its coordinate, N.
    pub middle_n: [[f64; 2]; 2],
    /// Damping of the middle's own velocity, which effects add to it, N·s/m.
    pub middle_damping: [[f64; 2]; 2],
    /// The force that [`super::State::line_force_n`] reports, N.
    pub reported_n: [[f64; 2]; 2],
    /// What the declared law says.
    pub declared: [[DeclaredForce; 2]; 2],
}

/// The middle of a line at the beginning of an internal step, and as predicted for its midpoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Middle {
    /// Line 0 or 1.
    pub line: usize,
    /// Length of the step, s.
    pub step_s: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Velocity at the beginning, m/s.
    pub velocity_m_s: f64,
    /// Position at the midpoint, m.
    pub half_position_m: f64,
    /// Velocity at the midpoint, extrapolated, m/s.
    pub mean_velocity_m_s: f64,
}
