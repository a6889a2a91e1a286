//! The four halves of cables between the masses: tension, friction at the supports, energy.

use super::{Element, Parameters, State};
use crate::effects::{End, Link, Moment, Sited};
use crate::friction::DryFriction;

/// Direction in which a tension pulls its pulley: by line and end (master, slave).
pub(super) const PULL: [[f64; 2]; 2] = [[-1.0, 1.0], [1.0, -1.0]];

/// What the cables do to the masses in one internal step, by line and end.
#[derive(Clone, Copy, Default)]
pub(super) struct Coupling {
    /// Force on the pulley's coordinate beyond that of the pretension, N.
    pub(super) pulley: [[f64; 2]; 2],
    /// Force on the cable's middle, against its coordinate, beyond that of the pretension, N.
    pub(super) middle: [[f64; 2]; 2],
    /// What effects add to it with the middle's speed, N·s/m.
    pub(super) middle_damping: [[f64; 2]; 2],
    /// Tension, N.
    pub(super) tension: [[f64; 2]; 2],
    /// The declared law's spring and damper, N.
    spring: [[f64; 2]; 2],
    damper: [[f64; 2]; 2],
    /// By how much effects changed the deflection since the last step, m.
    shift: [[f64; 2]; 2],
}

/// The cables with their history.
#[derive(Clone, Debug)]
pub(super) struct Lines {
    elements: [[Element; 2]; 2],
    /// Elongation at rest under pretension, m.
    rest_m: f64,
    /// Deflection that effects add, m.
    offset_m: [[f64; 2]; 2],
    cables: f64,
    pretension_n: f64,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
    pub(super) radii_m: [f64; 2],
}

impl Lines {
    pub(super) fn new(parameters: &Parameters) -> Self {
        let law = parameters.element_law(0.5 * parameters.line_length_m);
        let (element, rest_m) =
            Element::bedded(law, parameters.bedding_tension_n, parameters.pretension_n);
        Self {
            elements: [[element; 2]; 2],
            rest_m,
            offset_m: [[0.0; 2]; 2],
            cables: parameters.cables,
            pretension_n: parameters.cables * parameters.pretension_n,
            stiffness_n_per_m: 2.0 * parameters.line_stiffness_n_per_m(),
            damping_n_s_per_m: parameters.cables * parameters.cable_damping_n_s_per_m,
            radii_m: [parameters.master_pulley_radius_m, parameters.slave_pulley_radius_m()],
        }
    }

    /// The four links, each once: positions and speeds in the middle of the step.
    pub(super) fn couple(
        &mut self,
        half: &[f64; 4],
        mean: &[f64; 4],
        effects: &mut Sited,
        moment: &Moment,
    ) -> Coupling {
        let mut coupling = Coupling::default();
        for line in 0..2 {
            for (index, end) in [(0, End::Master), (1, End::Slave)] {
                let (radius, pull) = (self.radii_m[index], PULL[line][index]);
                let (deflection, rate) =
                    (half[2 + line] - radius * half[index], mean[2 + line] - radius * mean[index]);
                let mut link = Link {
                    end,
                    line,
                    stiffness_n_per_m: self.stiffness_n_per_m,
                    damping_n_s_per_m: self.damping_n_s_per_m,
                    displacement_m_per_rad: radius,
                    deflection_m: deflection,
                    rate_m_s: rate,
                    fluid_position_m: half[2 + line],
                    fluid_velocity_m_s: mean[2 + line],
                    force_n: 0.0,
                    fluid_force_n: 0.0,
                    fluid_damping_n_s_per_m: 0.0,
                };
                let at_end = if index == 0 { &mut effects.master } else { &mut effects.slave };
                for effect in effects.line.iter_mut().chain(at_end.iter_mut()) {
                    effect.deflect(&mut link, moment);
                }
                let offset = link.deflection_m - deflection;
                coupling.shift[line][index] = offset - self.offset_m[line][index];
                self.offset_m[line][index] = offset;
                let elongation = self.rest_m + pull * link.deflection_m;
                let tension = self.cables * self.elements[line][index].extend(elongation);
                // A damper cannot make the cable push.
                let damper = (pull * self.damping_n_s_per_m * link.rate_m_s).max(-tension);
                coupling.spring[line][index] = pull * (tension - self.pretension_n);
                coupling.damper[line][index] = pull * damper;
                link.force_n = pull * (tension + damper - self.pretension_n);
                link.fluid_force_n = link.force_n;
                for effect in effects.line.iter_mut().chain(at_end.iter_mut()) {
                    effect.link(&mut link, moment);
                }
                // Nor can an effect.
                let pulling = |force: f64| (self.pretension_n + pull * force).max(0.0);
                let resisted = link.fluid_damping_n_s_per_m * link.fluid_velocity_m_s;
                let (at_pulley, at_middle) =
                    (pulling(link.force_n), pulling(link.fluid_force_n + resisted));
                coupling.tension[line][index] = at_pulley;
                coupling.pulley[line][index] = pull * (at_pulley - self.pretension_n);
                coupling.middle[line][index] = pull * (at_middle - self.pretension_n) - resisted;
                coupling.middle_damping[line][index] = link.fluid_damping_n_s_per_m;
            }
        }
        coupling
    }

    /// Where a link's energy went in a step: lost in its damper, and taken by effects, J; the
    /// middle went `middle` at the mean speed `speed`.
    pub(super) fn work(
        &self,
        coupling: &Coupling,
        (line, end): (usize, usize),
        (middle, speed): (f64, f64),
        angle: f64,
    ) -> (f64, f64) {
        let pulley = self.radii_m[end] * angle;
        let relative = middle - pulley;
        let lost = coupling.damper[line][end] * relative;
        let declared = coupling.spring[line][end] * (relative + coupling.shift[line][end]) + lost;
        let on_middle = coupling.middle[line][end] + coupling.middle_damping[line][end] * speed;
        let taken = on_middle * middle - coupling.pulley[line][end] * pulley;
        (lost, taken - declared)
    }

    /// Energy stored and lost in the cables, were they brought to where the masses are, J.
    pub(super) fn energy_j(&self, state: &State) -> (f64, f64) {
        let (mut stored, mut lost) = (0.0, 0.0);
        for line in 0..2 {
            for end in 0..2 {
                let elongation = self.elongation_m(state, line, end);
                let mut element = self.elements[line][end];
                element.extend(elongation);
                stored += self.cables * element.stored_j()
                    - self.pretension_n * (elongation - self.rest_m);
                lost += self.cables * element.dissipated_j();
            }
        }
        (stored, lost)
    }

    /// Lets the cables come to rest where the masses are, and forgets what was lost.
    pub(super) fn relax(&mut self, state: &State) {
        self.offset_m = [[0.0; 2]; 2];
        for line in 0..2 {
            for end in 0..2 {
                let elongation = self.elongation_m(state, line, end);
                self.elements[line][end].relax(elongation);
            }
        }
    }

    fn elongation_m(&self, state: &State, line: usize, end: usize) -> f64 {
        let angle = if end == 0 { state.master_position_rad } else { state.slave_position_rad };
        let deflection =
            state.line_position_m[line] - self.radii_m[end] * angle + self.offset_m[line][end];
        self.rest_m + PULL[line][end] * deflection
    }
}

/// Dry friction at the supports.
#[derive(Clone, Debug)]
pub(super) struct Supports {
    kinetic_ratio: f64,
    stribeck_speed_m_s: f64,
    asymmetry: f64,
    amplitude: f64,
    order_rad_per_m: f64,
}

impl Supports {
    pub(super) fn new(parameters: &Parameters) -> Self {
        Self {
            kinetic_ratio: parameters.kinetic_friction_ratio,
            stribeck_speed_m_s: parameters.stribeck_speed_m_s,
            asymmetry: parameters.friction_asymmetry,
            amplitude: parameters.friction_position_amplitude,
            order_rad_per_m: parameters.friction_position_order_rad_per_m,
        }
    }

    /// Friction of a breakaway level, N, on cable at a displacement, m, that moves at a speed, m/s.
    pub(super) fn friction(
        &self,
        level_n: f64,
        displacement_m: f64,
        speed_m_s: f64,
    ) -> DryFriction {
        let level =
            level_n * (1.0 + self.amplitude * (self.order_rad_per_m * displacement_m).cos());
        let falling = (-speed_m_s.abs() / self.stribeck_speed_m_s).exp();
        let moving = level * (self.kinetic_ratio + (1.0 - self.kinetic_ratio) * falling);
        let (forward, backward) = (1.0 + self.asymmetry, 1.0 - self.asymmetry);
        DryFriction {
            forward: forward * moving,
            backward: backward * moving,
            forward_at_rest: forward * level,
            backward_at_rest: backward * level,
        }
    }
}
