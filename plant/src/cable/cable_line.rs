//! The law of the two cables: elements that only pull, friction at the supports.

use super::{Element, Parameters};
use crate::effects::{Link, Side};
use crate::friction::{Advance, DryFriction, Load, advance};
use crate::transmission::{Coupling, DeclaredForce, LineLaw, Middle, TransmissionParameters};

/// Direction in which a tension pulls its pulley: by line and end (master, slave).
const PULL: [[f64; 2]; 2] = [[-1.0, 1.0], [1.0, -1.0]];

/// The cables with their history, and the friction of motor, supports and slave.
#[derive(Clone, Debug)]
pub struct CableLine {
    parameters: Parameters,
    radii_m: [f64; 2],
    elements: [[Element; 2]; 2],
    /// Elongation at rest under pretension, m.
    rest_m: f64,
    /// Deflection that effects add, m.
    offset_m: [[f64; 2]; 2],
    /// Pretension of all parallel cables, N.
    pretension_n: f64,
    /// Supports of a line between its ends.
    inner_supports: f64,
}

impl CableLine {
    /// Viscous coefficient of a line's cables at one support, N·s/m.
    fn support_viscous(&self) -> f64 {
        self.parameters.cables * self.parameters.support_viscous_n_s_per_m
    }

    /// Dry friction at supports of a breakaway level, N, on cable at a displacement, m, that moves
    /// at a speed, m/s.
    fn dry_friction(&self, level_n: f64, displacement_m: f64, speed_m_s: f64) -> DryFriction {
        let own = &self.parameters;
        let along = (own.friction_position_order_rad_per_m * displacement_m).cos();
        let level = level_n * (1.0 + own.friction_position_amplitude * along);
        let falling = (-speed_m_s.abs() / own.stribeck_speed_m_s).exp();
        let kinetic = own.kinetic_friction_ratio;
        let moving = level * (kinetic + (1.0 - kinetic) * falling);
        let (forward, backward) = (1.0 + own.friction_asymmetry, 1.0 - own.friction_asymmetry);
        DryFriction {
            forward: forward * moving,
            backward: backward * moving,
            forward_at_rest: forward * level,
            backward_at_rest: backward * level,
        }
    }
}

impl LineLaw for CableLine {
    type Parameters = Parameters;

    const PHASE_PER_STEP: f64 = 0.1;
    const MIDDLE_STICKS: bool = true;

    fn new(parameters: &Parameters) -> Self {
        let law = parameters.element_law(0.5 * parameters.line_length_m);
        let (element, rest_m) =
            Element::bedded(law, parameters.bedding_tension_n, parameters.pretension_n);
        Self {
            radii_m: [parameters.master_pulley_radius_m, parameters.slave_pulley_radius_m()],
            elements: [[element; 2]; 2],
            rest_m,
            offset_m: [[0.0; 2]; 2],
            pretension_n: parameters.cables * parameters.pretension_n,
            inner_supports: parameters.supports() - 2.0,
            parameters: parameters.clone(),
        }
    }

    fn highest_mode_rad_s(
        parameters: &Parameters,
        extra_inertia: [f64; 2],
        stiffness_factor: f64,
    ) -> f64 {
        // Toe, sag and set only soften the cable; the friction between fibres stiffens it.
        let stiffer = stiffness_factor * (1.0 + parameters.fibre_branch_ratio);
        parameters.changed_modes_rad_s(extra_inertia, stiffer)[3]
    }

    fn rest(&mut self, line: usize, end: usize, deflection_m: f64, shift_m: f64) {
        self.offset_m[line][end] = shift_m;
        self.elements[line][end].relax(self.rest_m + PULL[line][end] * (deflection_m + shift_m));
    }

    fn force(&mut self, link: &mut Link, declared_m: f64, _declared_rate: f64) -> DeclaredForce {
        let (line, end) = (link.line, link.end as usize);
        let pull = PULL[line][end];
        let offset = link.deflection_m - declared_m;
        let shift_m = offset - self.offset_m[line][end];
        self.offset_m[line][end] = offset;
        let elongation = self.rest_m + pull * link.deflection_m;
        let tension = self.parameters.cables * self.elements[line][end].extend(elongation);
        // A damper cannot make the cable push.
        let damper = (pull * link.damping_n_s_per_m * link.rate_m_s).max(-tension);
        link.force_n = pull * (tension + damper - self.pretension_n);
        link.fluid_force_n = link.force_n;
        DeclaredForce {
            spring_n: pull * (tension - self.pretension_n),
            damper_n: pull * damper,
            shift_m,
        }
    }

    fn limit(&self, link: &mut Link) -> f64 {
        let pull = PULL[link.line][link.end as usize];
        let pulling = |force: f64| (self.pretension_n + pull * force).max(0.0);
        let resisted = link.fluid_damping_n_s_per_m * link.fluid_velocity_m_s;
        let (at_pulley, at_middle) =
            (pulling(link.force_n), pulling(link.fluid_force_n + resisted));
        link.force_n = pull * (at_pulley - self.pretension_n);
        link.fluid_force_n = pull * (at_middle - self.pretension_n) - resisted;
        at_pulley
    }

    fn energy_j(&self, line: usize, end: usize, deflection_m: f64, _stiffness: f64) -> (f64, f64) {
        let deflection = deflection_m + self.offset_m[line][end];
        let elongation = self.rest_m + PULL[line][end] * deflection;
        let mut element = self.elements[line][end];
        element.extend(elongation);
        let cables = self.parameters.cables;
        let stored = cables * element.stored_j() - self.pretension_n * (elongation - self.rest_m);
        (stored, cables * element.dissipated_j())
    }

    fn side_friction(
        &self,
        side: Side,
        position_rad: f64,
        velocity_rad_s: f64,
        coupling: &Coupling,
    ) -> Load {
        let (index, own) = (side as usize, &self.parameters);
        let radius = self.radii_m[index];
        let tensions = [coupling.reported_n[0][index], coupling.reported_n[1][index]];
        let level: f64 = tensions.map(|tension| own.support_friction_n(tension)).iter().sum();
        let mut dry = self.dry_friction(level, radius * position_rad, radius * velocity_rad_s);
        dry.scale(radius);
        let (constant, viscous) = match side {
            Side::Master => (own.motor_coulomb_nm, own.motor_viscous_nm_s),
            Side::Slave => (own.slave_bearing_nm, 0.0),
        };
        dry.add(constant, constant);
        let viscous = viscous + 2.0 * radius * radius * self.support_viscous();
        Load { viscous_forward: viscous, viscous_backward: viscous, dry, ..Load::default() }
    }

    fn advance_middle(
        &self,
        middle: &Middle,
        coupling: &Coupling,
        effects: impl FnOnce(f64) -> f64,
    ) -> Advance {
        let (line, speed) = (middle.line, middle.mean_velocity_m_s);
        let [at_master, at_slave] = coupling.reported_n[line];
        let tension = 0.5 * (at_master + at_slave);
        let level = self.inner_supports * self.parameters.support_friction_n(tension);
        let mut dry = self.dry_friction(level, middle.half_position_m, speed);
        let viscous = self.inner_supports * self.support_viscous();
        // An effect knows one coefficient of loss, viscous and dry together.
        let moving = if speed >= 0.0 { dry.forward } else { dry.backward };
        let coefficient = viscous + moving / speed.abs().max(1e-6);
        let changed = effects(coefficient);
        let factor = if coefficient > 0.0 { changed / coefficient } else { 1.0 };
        dry.scale(factor);
        let damping = coupling.middle_damping[line];
        let resistance = damping[0] + damping[1];
        let load = Load {
            force: -coupling.middle_n[line][0] - coupling.middle_n[line][1],
            inertia: middle.mass_kg,
            viscous_forward: factor * viscous + resistance,
            viscous_backward: factor * viscous + resistance,
            dry,
            ..Load::default()
        };
        let moved = advance(middle.velocity_m_s, middle.step_s, &load);
        // What the effects took is not dissipated.
        let taken = resistance * moved.displacement / middle.step_s * moved.displacement;
        Advance { dissipated: moved.dissipated - taken, ..moved }
    }
}
