//! The law of the two oil lines: linear springs and dampers, fluid friction in between.

use super::Parameters;
use crate::effects::{Link, Side};
use crate::fluid::Pipe;
use crate::friction::{Advance, DryFriction, Load, Smoothing, Stribeck};
use crate::transmission::{Coupling, DeclaredForce, LineLaw, Middle};

/// The oil lines, and the friction of motor, pistons and slave; see the module's equations.
#[derive(Clone, Debug)]
pub struct OilLine {
    pipe: Pipe,
    motor_coulomb_nm: f64,
    motor_viscous_nm_s: f64,
    piston: Stribeck,
    slave: Stribeck,
    smoothing: Smoothing,
}

impl LineLaw for OilLine {
    type Parameters = Parameters;

    const PHASE_PER_STEP: f64 = 0.15;
    const MIDDLE_STICKS: bool = false;

    fn new(parameters: &Parameters) -> Self {
        Self {
            pipe: parameters.pipe(),
            motor_coulomb_nm: parameters.motor_coulomb_nm,
            motor_viscous_nm_s: parameters.motor_viscous_nm_s,
            piston: parameters.master_piston_friction(),
            slave: parameters.slave_friction(),
            smoothing: Smoothing {
                speed: parameters.friction_smoothing_rad_s,
                shape: parameters.friction_smoothing_shape,
            },
        }
    }

    #[inline(always)]
    fn force(&mut self, link: &mut Link, declared_m: f64, declared_rate_m_s: f64) -> DeclaredForce {
        let (stiffness, damping) = (link.stiffness_n_per_m, link.damping_n_s_per_m);
        link.force_n = stiffness * link.deflection_m + damping * link.rate_m_s;
        link.fluid_force_n = link.force_n;
        DeclaredForce {
            spring_n: stiffness * declared_m,
            damper_n: damping * declared_rate_m_s,
            shift_m: 0.0,
        }
    }

    fn energy_j(&self, _line: usize, _end: usize, deflection_m: f64, stiffness: f64) -> (f64, f64) {
        (0.5 * stiffness * deflection_m * deflection_m, 0.0)
    }

    #[inline(always)]
    fn side_friction(
        &self,
        side: Side,
        _position_rad: f64,
        velocity_rad_s: f64,
        _coupling: &Coupling,
    ) -> Load {
        let (viscous, moving, at_rest) = match side {
            Side::Master => (
                self.motor_viscous_nm_s,
                self.motor_coulomb_nm + self.piston.level(velocity_rad_s),
                self.motor_coulomb_nm + self.piston.level(0.0),
            ),
            Side::Slave => (0.0, self.slave.level(velocity_rad_s), self.slave.level(0.0)),
        };
        Load {
            viscous_forward: viscous,
            viscous_backward: viscous,
            dry: DryFriction::symmetric(moving, at_rest),
            smoothing: self.smoothing,
            ..Load::default()
        }
    }

    #[inline(always)]
    fn advance_middle(
        &self,
        middle: &Middle,
        coupling: &Coupling,
        effects: impl FnOnce(f64) -> f64,
    ) -> Advance {
        let Middle { line, step_s: step, mass_kg: mass, velocity_m_s: before, .. } = *middle;
        let coefficient = effects(self.pipe.coefficient(middle.mean_velocity_m_s));
        // Losses, and what effects take with the fluid's own velocity.
        let [at_master, at_slave] = coupling.middle_damping[line];
        let half_damping = 0.5 * step * (coefficient + at_master + at_slave);
        let force = -coupling.middle_n[line][0] - coupling.middle_n[line][1];
        let after = ((mass - half_damping) * before + step * force) / (mass + half_damping);
        let average = 0.5 * (before + after);
        let displacement = step * average;
        Advance { velocity: after, displacement, dissipated: coefficient * average * displacement }
    }
}
