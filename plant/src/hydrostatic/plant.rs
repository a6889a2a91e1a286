//! The integrator.
//!
//! Position Verlet (drift, kick, drift) with sub-steps: forces are taken at the middle of the step,
//! damping at the mean speed, dry friction as in [`crate::friction`]. It is of second order, needs
//! no linear solve, and keeps the energy of linear springs exactly but for a bounded term of `(ω
//! h)²/8`, where explicit Euler feeds the line's mode until it diverges. The sub-step follows from
//! the highest mode.

use super::{Parameters, State, modes::modes};
use crate::effects::{Effect, End, Link, Moment, Side, SideLoad, Sited};
use crate::fluid::Pipe;
use crate::friction::{Advance, DryFriction, Load, Smoothing, Stribeck, advance, impose};
use crate::shared::Shared;
use crate::transmission::{
    Correction, EnergyBalance, ImposedMotion, Input, Motion, Reading, Transmission, sub_steps,
};
use crate::{ParameterError, ParameterSet};

/// Phase of the highest mode per internal step, rad.
const PHASE_PER_STEP: f64 = 0.15;
/// What an estimator may do with: twice the phase and the decay, where the highest mode is 0.4 %
/// slow.
const COARSE: f64 = 2.0;
/// Decay of the fastest damping per internal step.
const DECAY_PER_STEP: f64 = 0.2;
/// Longest internal step, s.
const LONGEST_STEP_S: f64 = 0.25e-3;

/// What follows from the parameters and stays.
#[derive(Clone, Debug)]
struct Constants {
    half_line_n_per_m: [f64; 2],
    displacement: [f64; 2],
    inertia: [f64; 2],
    fluid_mass_kg: f64,
    pipe: Pipe,
    piston: Stribeck,
    slave: Stribeck,
    smoothing: Smoothing,
    longest_step_s: f64,
    /// The longest that modes and damping allow.
    stable_step_s: f64,
}

/// The transmission, moving.
#[derive(Clone, Debug)]
pub struct Plant {
    parameters: Parameters,
    constants: Constants,
    effects: Sited,
    state: State,
    /// Change of the four speeds over the last internal step: extrapolates the mean speed of the
    /// next.
    increments: [f64; 4],
    reading: Reading,
    energy: EnergyBalance,
    stored_at_start_j: f64,
}

/// What the lines do to the masses in one internal step.
#[derive(Clone, Copy, Default)]
struct Coupling {
    /// Force on the piston's coordinate, per line and end.
    piston: [[f64; 2]; 2],
    /// Force on the fluid, against its coordinate.
    fluid: [[f64; 2]; 2],
    /// What effects add to it with the fluid's speed, N·s/m.
    fluid_damping: [[f64; 2]; 2],
    /// The declared law's damper and spring.
    damper: [[f64; 2]; 2],
    spring: [[f64; 2]; 2],
}

/// What acts on the slave once the master has moved.
#[derive(Clone, Copy)]
struct Acting {
    load: Load,
    /// Part of it that effects make (N·m).
    effect: f64,
    /// Part of it that the lines make (N·m).
    transmitted: f64,
    hand_torque_nm: f64,
}

/// An internal step in which the master has moved and the slave has not, for whoever moves the
/// slave from outside.
#[derive(Clone, Copy)]
pub(crate) struct Stage {
    acting: Acting,
    master: Advance,
    coupling: Coupling,
    mean: [f64; 4],
    moment: Moment,
}

impl Plant {
    /// A plant at rest at zero.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`] for a parameter of the plant or of an effect.
    pub fn new(
        parameters: Parameters,
        effects: Vec<Box<dyn Effect>>,
    ) -> Result<Self, ParameterError> {
        parameters.check()?;
        let mut real = parameters;
        let effects = Sited::install(effects, &mut real)?;
        let extra = effects.extra_inertia;
        let displacement =
            [real.master_displacement_m_per_rad(), real.slave_displacement_m_per_rad()];
        let inertia =
            [real.master_inertia_kg_m2() + extra[0], real.slave_inertia_kg_m2() + extra[1]];
        let highest = modes(&real, extra[0], extra[1])[3] * effects.stiffness_factor.sqrt();
        let fluid_mass_kg = real.fluid_mass_kg();
        let decay = 2.0
            * real.port_damping_n_s_per_m
            * (1.0 / fluid_mass_kg
                + displacement[0].powi(2) / inertia[0]
                + displacement[1].powi(2) / inertia[1]);
        let stable_step_s = (PHASE_PER_STEP / highest.max(effects.rate_rad_s))
            .min(DECAY_PER_STEP / decay.max(1e-9));
        let constants = Constants {
            half_line_n_per_m: real.half_line_stiffness_n_per_m(),
            displacement,
            inertia,
            fluid_mass_kg,
            pipe: real.pipe(),
            piston: real.master_piston_friction(),
            slave: real.slave_friction(),
            smoothing: Smoothing {
                speed: real.friction_smoothing_rad_s,
                shape: real.friction_smoothing_shape,
            },
            longest_step_s: LONGEST_STEP_S.min(stable_step_s),
            stable_step_s,
        };
        Ok(Self {
            parameters: real,
            constants,
            effects,
            state: State::default(),
            increments: [0.0; 4],
            reading: Reading::default(),
            energy: EnergyBalance::default(),
            stored_at_start_j: 0.0,
        })
    }

    /// The parameters with which the plant moves, effects included.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The true state at the end of the last step.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// What the instruments would read at the end of the last step (sensor effects included).
    pub fn reading(&self) -> &Reading {
        &self.reading
    }

    /// Longest internal step, s.
    pub fn longest_step_s(&self) -> f64 {
        self.constants.longest_step_s
    }

    /// Lets internal steps be as long as `longest_s` where modes and damping allow it: quicker, and
    /// coarser in how friction and effects follow the speed. Without it they are of 0.25 ms at
    /// most.
    #[must_use]
    pub fn with_longest_step(mut self, longest_s: f64) -> Self {
        self.constants.longest_step_s = longest_s.min(COARSE * self.constants.stable_step_s);
        self
    }

    /// Where the energy went since the start, or since the last [`Plant::set_state`].
    pub fn energy(&self) -> EnergyBalance {
        EnergyBalance { stored_j: self.stored_j() - self.stored_at_start_j, ..self.energy }
    }

    /// Puts positions and speeds, and starts the energy balance again; forces are computed with the
    /// next step.
    ///
    /// The inner state of effects stays.
    pub fn set_state(&mut self, state: State) {
        self.state = state;
        self.increments = [0.0; 4];
        self.energy = EnergyBalance::default();
        self.stored_at_start_j = self.stored_j();
        self.read(0.0, 0.0);
    }

    /// Adds to positions and speeds without a fresh start: how an observer pulls the model toward a
    /// measurement.
    ///
    /// The energy that this puts in is left out of the balance.
    pub fn correct(&mut self, correction: Correction) {
        let before = self.stored_j();
        self.state.master_position_rad += correction.master_position_rad;
        self.state.master_velocity_rad_s += correction.master_velocity_rad_s;
        self.state.slave_position_rad += correction.slave_position_rad;
        self.state.slave_velocity_rad_s += correction.slave_velocity_rad_s;
        self.stored_at_start_j += self.stored_j() - before;
    }

    /// Moves the plant on by `dt_s` with the input held; `dt_s` not positive does nothing.
    pub fn step(&mut self, input: Input, dt_s: f64) {
        // Compiled twice: most plants have no effects, and are twice as fast without the hooks for
        // them.
        if self.effects.any {
            self.step_with::<true>(input, dt_s)
        } else {
            self.step_with::<false>(input, dt_s)
        }
    }

    fn step_with<const EFFECTS: bool>(&mut self, input: Input, dt_s: f64) {
        let (count, step) = sub_steps(dt_s, self.constants.longest_step_s);
        for _ in 0..count {
            let (half, mean) = self.middle(step);
            let moment = Moment::middle(self.state.time_s, step, &half, &mean);
            let motor_torque = self.motor_torque::<EFFECTS>(input.motor_v, &moment);
            let coupling = self.couple::<EFFECTS>(&half, &mean, &moment);
            let master =
                self.move_master::<EFFECTS>(motor_torque, &coupling, (&half, &mean, &moment));
            let acting = self.reach_slave::<EFFECTS>(
                &coupling,
                input.hand_torque_nm,
                (&half, &mean, &moment),
            );
            let slave = advance(self.state.slave_velocity_rad_s, step, &acting.load);
            self.complete::<EFFECTS>([master, slave], &acting, &coupling, &mean, &moment);
        }
        self.read(input.motor_v, input.hand_torque_nm);
    }

    /// One internal step up to where the slave moves, which somebody else does.
    fn begin<const EFFECTS: bool>(&mut self, input: Input, step: f64) -> Stage {
        let (half, mean) = self.middle(step);
        let moment = Moment::middle(self.state.time_s, step, &half, &mean);
        let motor_torque = self.motor_torque::<EFFECTS>(input.motor_v, &moment);
        let coupling = self.couple::<EFFECTS>(&half, &mean, &moment);
        let master = self.move_master::<EFFECTS>(motor_torque, &coupling, (&half, &mean, &moment));
        let acting =
            self.reach_slave::<EFFECTS>(&coupling, input.hand_torque_nm, (&half, &mean, &moment));
        Stage { acting, master, coupling, mean, moment }
    }

    #[inline(always)]
    fn motor_torque<const EFFECTS: bool>(&mut self, motor_v: f64, moment: &Moment) -> f64 {
        let torque_per_volt = self.parameters.motor_torque_per_volt_nm;
        if EFFECTS {
            self.effects.motor_torque(motor_v, torque_per_volt, moment)
        } else {
            torque_per_volt * motor_v
        }
    }

    /// Moves the master over an internal step.
    #[inline(always)]
    fn move_master<const EFFECTS: bool>(
        &mut self,
        motor_torque: f64,
        coupling: &Coupling,
        (half, mean, moment): (&[f64; 4], &[f64; 4], &Moment),
    ) -> Advance {
        let mut master = self.master_load(coupling, half[0], mean[0]);
        let master_effect = if EFFECTS { self.effects.side(&mut master, moment) } else { 0.0 };
        master.load.force += motor_torque;
        let moved = advance(self.state.master_velocity_rad_s, moment.step_s, &master.load);
        self.energy.dissipated_j += moved.dissipated;
        if EFFECTS {
            self.energy.effects_j -= master_effect * moved.displacement;
        }
        self.energy.count_input(motor_torque * moved.displacement);
        self.state.motor_torque_nm = motor_torque;
        moved
    }

    /// Moves the master to where it is to be, whatever that takes, along a cubic from its present
    /// position and speed; the slave moves as it must. [`State::motor_torque_nm`] is then the
    /// torque that it took.
    pub fn step_imposed(&mut self, master: ImposedMotion, hand_torque_nm: f64, dt_s: f64) {
        if self.effects.any {
            self.step_imposed_with::<true>(master, hand_torque_nm, dt_s);
        } else {
            self.step_imposed_with::<false>(master, hand_torque_nm, dt_s);
        }
    }

    fn step_imposed_with<const EFFECTS: bool>(
        &mut self,
        master: ImposedMotion,
        hand_torque_nm: f64,
        dt_s: f64,
    ) {
        let (count, step) = sub_steps(dt_s, self.constants.longest_step_s);
        let (from, speed_from) = (self.state.master_position_rad, self.state.master_velocity_rad_s);
        for index in 1..=count {
            let part = index as f64 / count as f64;
            let (next, speed_next) = master.approach(from, speed_from, dt_s, part);
            let (position, speed) =
                (self.state.master_position_rad, self.state.master_velocity_rad_s);
            let (mut half, mut mean) = self.middle(step);
            half[0] = 0.5 * (position + next);
            mean[0] = (next - position) / step;
            let moment = Moment::middle(self.state.time_s, step, &half, &mean);
            let coupling = self.couple::<EFFECTS>(&half, &mean, &moment);
            let mut load = self.master_load(&coupling, half[0], mean[0]);
            let effect_torque = if EFFECTS { self.effects.side(&mut load, &moment) } else { 0.0 };
            let driven = impose(speed, speed_next, next - position, step, &load.load);
            self.state.motor_torque_nm = driven.force;
            self.energy.dissipated_j += driven.moved.dissipated;
            self.energy.effects_j -= effect_torque * driven.moved.displacement;
            self.energy.count_input(driven.work);
            let acting =
                self.reach_slave::<EFFECTS>(&coupling, hand_torque_nm, (&half, &mean, &moment));
            let slave = advance(self.state.slave_velocity_rad_s, step, &acting.load);
            self.complete::<EFFECTS>([driven.moved, slave], &acting, &coupling, &mean, &moment);
        }
        self.read(0.0, hand_torque_nm);
    }

    /// What acts on the slave once the master has moved.
    #[inline(always)]
    fn reach_slave<const EFFECTS: bool>(
        &mut self,
        coupling: &Coupling,
        hand_torque_nm: f64,
        (half, mean, moment): (&[f64; 4], &[f64; 4], &Moment),
    ) -> Acting {
        let constants = &self.constants;
        let transmitted =
            constants.displacement[1] * (coupling.piston[0][1] + coupling.piston[1][1]);
        let mut load = SideLoad {
            side: Side::Slave,
            position_rad: half[1],
            velocity_rad_s: mean[1],
            transmitted_nm: transmitted,
            load: Load {
                force: transmitted,
                inertia: constants.inertia[1],
                dry: DryFriction::symmetric(
                    constants.slave.level(mean[1]),
                    constants.slave.level(0.0),
                ),
                smoothing: constants.smoothing,
                ..Load::default()
            },
        };
        let effect = if EFFECTS { self.effects.side(&mut load, moment) } else { 0.0 };
        load.load.force += hand_torque_nm;
        Acting { load: load.load, effect, transmitted, hand_torque_nm }
    }

    /// Everything after the slave has moved: lines, energy, time.
    #[inline(always)]
    fn complete<const EFFECTS: bool>(
        &mut self,
        [master, slave]: [Advance; 2],
        acting: &Acting,
        coupling: &Coupling,
        mean: &[f64; 4],
        moment: &Moment,
    ) {
        let step = moment.step_s;
        if EFFECTS {
            self.effects.moved([master.displacement, slave.displacement], moment);
        }
        self.energy.dissipated_j += slave.dissipated;
        if EFFECTS {
            self.energy.effects_j -= acting.effect * slave.displacement;
        }
        self.energy.count_input(acting.hand_torque_nm * slave.displacement);

        let moved = [master.displacement, slave.displacement];
        let mut lines = [slave; 2];
        for line in 0..2 {
            let mut coefficient = self.constants.pipe.coefficient(mean[2 + line]);
            if EFFECTS {
                coefficient = self.effects.fluid(coefficient, moment);
            }
            // Losses, and what effects take with the fluid's own speed.
            let resistance = if EFFECTS {
                coefficient + coupling.fluid_damping[line][0] + coupling.fluid_damping[line][1]
            } else {
                coefficient
            };
            let half_damping = 0.5 * step * resistance;
            let mass = self.constants.fluid_mass_kg;
            let before = self.state.line_velocity_m_s[line];
            let force = -coupling.fluid[line][0] - coupling.fluid[line][1];
            let after = ((mass - half_damping) * before + step * force) / (mass + half_damping);
            let average = 0.5 * (before + after);
            let displacement = step * average;
            let dissipated = coefficient * average * displacement;
            lines[line] = Advance { velocity: after, displacement, dissipated };
            self.energy.dissipated_j += dissipated;
            if EFFECTS {
                self.effects.flowed(line, displacement, moment);
            }
            for (end, angle) in moved.iter().enumerate() {
                let piston = self.constants.displacement[end] * angle;
                let relative = displacement - piston;
                let (spring, damper) = (coupling.spring[line][end], coupling.damper[line][end]);
                self.energy.dissipated_j += damper * relative;
                if EFFECTS {
                    let fluid =
                        coupling.fluid[line][end] + coupling.fluid_damping[line][end] * average;
                    self.energy.effects_j += fluid * displacement
                        - coupling.piston[line][end] * piston
                        - (spring + damper) * relative;
                }
            }
        }

        let state = &mut self.state;
        let increment = |before: f64, after: f64| if after == 0.0 { 0.0 } else { after - before };
        self.increments = [
            increment(state.master_velocity_rad_s, master.velocity),
            increment(state.slave_velocity_rad_s, slave.velocity),
            lines[0].velocity - state.line_velocity_m_s[0],
            lines[1].velocity - state.line_velocity_m_s[1],
        ];
        state.time_s += step;
        state.master_position_rad += master.displacement;
        state.master_velocity_rad_s = master.velocity;
        state.slave_position_rad += slave.displacement;
        state.slave_velocity_rad_s = slave.velocity;
        for (line, moved) in lines.iter().enumerate() {
            state.line_position_m[line] += moved.displacement;
            state.line_velocity_m_s[line] = moved.velocity;
            state.line_force_master_n[line] = coupling.piston[line][0];
            state.line_force_slave_n[line] = coupling.piston[line][1];
        }
        state.transmitted_torque_nm = acting.transmitted;
    }

    /// The four links, each once.
    #[inline(always)]
    fn couple<const EFFECTS: bool>(
        &mut self,
        half: &[f64; 4],
        mean: &[f64; 4],
        moment: &Moment,
    ) -> Coupling {
        let mut coupling = Coupling::default();
        let (stiffnesses, damping) =
            (self.constants.half_line_n_per_m, self.parameters.port_damping_n_s_per_m);
        for line in 0..2 {
            for (index, end) in [(0, End::Master), (1, End::Slave)] {
                let (displacement, stiffness) =
                    (self.constants.displacement[index], stiffnesses[index]);
                let deflection = half[2 + line] - displacement * half[index];
                let rate = mean[2 + line] - displacement * mean[index];
                let (spring, damper) = (stiffness * deflection, damping * rate);
                coupling.spring[line][index] = spring;
                coupling.damper[line][index] = damper;
                let at_end =
                    if index == 0 { &mut self.effects.master } else { &mut self.effects.slave };
                if !EFFECTS || (self.effects.line.is_empty() && at_end.is_empty()) {
                    coupling.piston[line][index] = spring + damper;
                    coupling.fluid[line][index] = spring + damper;
                    continue;
                }
                let mut link = Link {
                    end,
                    line,
                    stiffness_n_per_m: stiffness,
                    damping_n_s_per_m: damping,
                    displacement_m_per_rad: displacement,
                    deflection_m: deflection,
                    rate_m_s: rate,
                    fluid_position_m: half[2 + line],
                    fluid_velocity_m_s: mean[2 + line],
                    force_n: 0.0,
                    fluid_force_n: 0.0,
                    fluid_damping_n_s_per_m: 0.0,
                };
                for effect in self.effects.line.iter_mut().chain(at_end.iter_mut()) {
                    effect.deflect(&mut link, moment);
                }
                link.force_n = stiffness * link.deflection_m + damping * link.rate_m_s;
                link.fluid_force_n = link.force_n;
                for effect in self.effects.line.iter_mut().chain(at_end.iter_mut()) {
                    effect.link(&mut link, moment);
                }
                coupling.piston[line][index] = link.force_n;
                coupling.fluid[line][index] = link.fluid_force_n;
                coupling.fluid_damping[line][index] = link.fluid_damping_n_s_per_m;
            }
        }
        coupling
    }

    #[inline(always)]
    fn master_load(&self, coupling: &Coupling, position_rad: f64, velocity_rad_s: f64) -> SideLoad {
        let (parameters, constants) = (&self.parameters, &self.constants);
        let transmitted =
            constants.displacement[0] * (coupling.piston[0][0] + coupling.piston[1][0]);
        let dry = parameters.motor_coulomb_nm;
        SideLoad {
            side: Side::Master,
            position_rad,
            velocity_rad_s,
            transmitted_nm: transmitted,
            load: Load {
                force: transmitted,
                inertia: constants.inertia[0],
                viscous_forward: parameters.motor_viscous_nm_s,
                viscous_backward: parameters.motor_viscous_nm_s,
                dry: DryFriction::symmetric(
                    dry + constants.piston.level(velocity_rad_s),
                    dry + constants.piston.level(0.0),
                ),
                smoothing: constants.smoothing,
            },
        }
    }

    /// Positions at the middle of the step, and speeds there as extrapolated.
    #[inline(always)]
    fn middle(&self, step: f64) -> ([f64; 4], [f64; 4]) {
        let state = &self.state;
        let positions = [
            state.master_position_rad,
            state.slave_position_rad,
            state.line_position_m[0],
            state.line_position_m[1],
        ];
        let speeds = [
            state.master_velocity_rad_s,
            state.slave_velocity_rad_s,
            state.line_velocity_m_s[0],
            state.line_velocity_m_s[1],
        ];
        let half = std::array::from_fn(|index| positions[index] + 0.5 * step * speeds[index]);
        let mean = std::array::from_fn(|index| {
            let mean = speeds[index] + 0.5 * self.increments[index];
            // A movement that is about to stop does not count as one the other way.
            if index < 2 && mean * speeds[index] < 0.0 { 0.0 } else { mean }
        });
        (half, mean)
    }

    fn stored_j(&self) -> f64 {
        let (state, constants) = (&self.state, &self.constants);
        let mut energy = 0.5 * constants.inertia[0] * state.master_velocity_rad_s.powi(2)
            + 0.5 * constants.inertia[1] * state.slave_velocity_rad_s.powi(2);
        for line in 0..2 {
            energy += 0.5 * constants.fluid_mass_kg * state.line_velocity_m_s[line].powi(2);
            for (end, position) in
                [state.master_position_rad, state.slave_position_rad].into_iter().enumerate()
            {
                let deflection =
                    state.line_position_m[line] - constants.displacement[end] * position;
                energy += 0.5 * constants.half_line_n_per_m[end] * deflection * deflection;
            }
        }
        energy
    }

    fn read(&mut self, motor_v: f64, hand_torque_nm: f64) {
        self.reading = self.effects.sense(&Motion::from(&self.state), motor_v, hand_torque_nm);
    }
}

/// For a handle that several transmissions share: it moves the slaves itself.
impl Shared for Plant {
    type Stage = Stage;

    fn begin(&mut self, input: Input, step_s: f64) -> (Stage, Load) {
        let stage = if self.effects.any {
            self.begin::<true>(input, step_s)
        } else {
            self.begin::<false>(input, step_s)
        };
        (stage, stage.acting.load)
    }

    fn complete(&mut self, stage: Stage, slave: Advance) {
        let Stage { acting, master, coupling, mean, moment } = &stage;
        let moved = [*master, slave];
        if self.effects.any {
            self.complete::<true>(moved, acting, coupling, mean, moment);
        } else {
            self.complete::<false>(moved, acting, coupling, mean, moment);
        }
    }

    fn observe(&mut self, input: Input) {
        self.read(input.motor_v, input.hand_torque_nm);
    }

    fn longest_step_s(&self) -> f64 {
        self.constants.longest_step_s
    }

    fn slave_inertia_kg_m2(&self) -> f64 {
        self.constants.inertia[1]
    }
}

impl Transmission for Plant {
    fn step(&mut self, input: Input, dt_s: f64) {
        Self::step(self, input, dt_s);
    }

    fn step_imposed(&mut self, master: ImposedMotion, hand_torque_nm: f64, dt_s: f64) {
        Self::step_imposed(self, master, hand_torque_nm, dt_s);
    }

    fn motion(&self) -> Motion {
        Motion::from(&self.state)
    }

    fn reading(&self) -> Reading {
        self.reading
    }

    fn energy(&self) -> EnergyBalance {
        Self::energy(self)
    }
}
