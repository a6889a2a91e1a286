//! The integrator: position Verlet with sub-steps, as for the hydrostatic line.
//!
//! Cable forces are taken at the middle of the step, damping at the mean speed, dry friction as in
//! [`crate::friction`] with its level from the tension at the middle. Second order; nothing is
//! allocated.

use super::lines::{Coupling, Lines, Supports};
use super::modes::modes;
use super::{Parameters, State};
use crate::effects::{Effect, Moment, Side, SideLoad, Sited};
use crate::friction::{Advance, Load, Smoothing, advance, impose};
use crate::shared::Shared;
use crate::transmission::{
    Correction, EnergyBalance, ImposedMotion, Input, Motion, Reading, Transmission, sub_steps,
};
use crate::{ParameterError, ParameterSet};

/// Phase of the highest mode per internal step, rad.
const PHASE_PER_STEP: f64 = 0.1;
/// What an estimator may do with: twice the phase and the decay, where the highest mode is 0.2 %
/// slow.
const COARSE: f64 = 2.0;
/// Decay of the fastest damping per internal step.
const DECAY_PER_STEP: f64 = 0.2;
/// Longest internal step, s.
const LONGEST_STEP_S: f64 = 0.25e-3;

/// The transmission, moving.
#[derive(Clone, Debug)]
pub struct Plant {
    parameters: Parameters,
    lines: Lines,
    supports: Supports,
    /// Supports of a line between its ends.
    inner_supports: f64,
    inertia: [f64; 2],
    middle_mass_kg: f64,
    longest_step_s: f64,
    /// The longest that modes and damping allow.
    stable_step_s: f64,
    effects: Sited,
    state: State,
    /// Change of the four speeds over the last internal step: extrapolates the mean speed of the
    /// next.
    increments: [f64; 4],
    reading: Reading,
    energy: EnergyBalance,
    stored_at_start_j: f64,
}

/// An internal step in which the master has moved and the slave has not.
#[derive(Clone, Copy)]
pub(crate) struct Stage {
    /// All that acts on the slave.
    slave: Load,
    master: Advance,
    coupling: Coupling,
    half: [f64; 4],
    mean: [f64; 4],
    moment: Moment,
    slave_effect: f64,
    hand_torque_nm: f64,
    transmitted: f64,
}

impl Plant {
    /// A plant at rest at zero under its pretension.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`] for a parameter of the plant or of an effect;
    /// [`ParameterError::EffectNotApplicable`] for an effect that needs a fluid.
    pub fn new(
        parameters: Parameters,
        effects: Vec<Box<dyn Effect>>,
    ) -> Result<Self, ParameterError> {
        parameters.check()?;
        let mut real = parameters;
        let effects = Sited::install(effects, &mut real)?;
        let extra = effects.extra_inertia;
        let inertia = [
            real.total_master_inertia_kg_m2() + extra[0],
            real.total_slave_inertia_kg_m2() + extra[1],
        ];
        let middle_mass_kg = real.middle_mass_kg();
        // Toe, sag and set only soften; the rubbing branch stiffens.
        let stiffer = effects.stiffness_factor * (1.0 + real.fibre_branch_ratio);
        let highest = modes(&real, extra, stiffer)[3];
        let lines = Lines::new(&real);
        let [a_m, a_s] = lines.radii_m;
        let decay = 2.0
            * real.cables
            * real.cable_damping_n_s_per_m
            * (1.0 / middle_mass_kg + a_m * a_m / inertia[0] + a_s * a_s / inertia[1]);
        let stable_step_s = (PHASE_PER_STEP / highest.max(effects.rate_rad_s))
            .min(DECAY_PER_STEP / decay.max(1e-9));
        let mut plant = Self {
            lines,
            supports: Supports::new(&real),
            inner_supports: real.supports() - 2.0,
            inertia,
            middle_mass_kg,
            longest_step_s: LONGEST_STEP_S.min(stable_step_s),
            stable_step_s,
            effects,
            parameters: real,
            state: State::default(),
            increments: [0.0; 4],
            reading: Reading::default(),
            energy: EnergyBalance::default(),
            stored_at_start_j: 0.0,
        };
        plant.set_state(State::default());
        Ok(plant)
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
        self.longest_step_s
    }

    /// Lets internal steps be as long as `longest_s` where modes and damping allow it: quicker, and
    /// coarser in how friction and effects follow the speed. Without it they are of 0.25 ms at
    /// most.
    #[must_use]
    pub fn with_longest_step(mut self, longest_s: f64) -> Self {
        self.longest_step_s = longest_s.min(COARSE * self.stable_step_s);
        self
    }

    /// Where the energy went since the start, or since the last [`Plant::set_state`].
    pub fn energy(&self) -> EnergyBalance {
        let (stored, lost) = self.lines.energy_j(&self.state);
        EnergyBalance {
            stored_j: stored + self.kinetic_j() - self.stored_at_start_j,
            dissipated_j: self.energy.dissipated_j + lost,
            ..self.energy
        }
    }

    /// Puts positions and speeds, and starts the energy balance again; tensions are computed with
    /// the next step.
    ///
    /// The cables rest there, as aligned as they were. The inner state of effects stays.
    pub fn set_state(&mut self, state: State) {
        self.state = state;
        self.increments = [0.0; 4];
        self.lines.relax(&self.state);
        self.energy = EnergyBalance::default();
        self.stored_at_start_j = self.lines.energy_j(&self.state).0 + self.kinetic_j();
        self.read(0.0, 0.0);
    }

    /// Adds to positions and speeds without a fresh start: how an observer pulls the model toward a
    /// measurement.
    ///
    /// The energy that this puts in, or that the cables lose by it, is left out of the balance.
    pub fn correct(&mut self, correction: Correction) {
        let total = |plant: &Self| {
            let (stored, lost) = plant.lines.energy_j(&plant.state);
            stored + lost + plant.kinetic_j()
        };
        let before = total(self);
        self.state.master_position_rad += correction.master_position_rad;
        self.state.master_velocity_rad_s += correction.master_velocity_rad_s;
        self.state.slave_position_rad += correction.slave_position_rad;
        self.state.slave_velocity_rad_s += correction.slave_velocity_rad_s;
        self.stored_at_start_j += total(self) - before;
    }

    /// Moves the plant on by `dt_s` with the input held; `dt_s` not positive does nothing.
    pub fn step(&mut self, input: Input, dt_s: f64) {
        let (count, step) = sub_steps(dt_s, self.longest_step_s);
        for _ in 0..count {
            let (stage, load) = self.begin(input, step);
            let slave = advance(self.state.slave_velocity_rad_s, step, &load);
            self.complete(&stage, slave);
        }
        self.read(input.motor_v, input.hand_torque_nm);
    }

    /// Moves the master to where it is to be, whatever that takes, along a cubic from its present
    /// position and speed; the slave moves as it must. [`State::motor_torque_nm`] is then the
    /// torque that it took.
    pub fn step_imposed(&mut self, master: ImposedMotion, hand_torque_nm: f64, dt_s: f64) {
        let (count, step) = sub_steps(dt_s, self.longest_step_s);
        let (from, speed_from) = (self.state.master_position_rad, self.state.master_velocity_rad_s);
        for index in 1..=count {
            let (next, speed_next) =
                master.approach(from, speed_from, dt_s, index as f64 / count as f64);
            let (position, speed) =
                (self.state.master_position_rad, self.state.master_velocity_rad_s);
            let (mut half, mut mean) = self.middle(step);
            half[0] = 0.5 * (position + next);
            mean[0] = (next - position) / step;
            let moment = Moment::middle(self.state.time_s, step, &half, &mean);
            let coupling = self.lines.couple(&half, &mean, &mut self.effects, &moment);
            let (load, effect_torque) =
                self.side_load(Side::Master, &coupling, &half, &mean, &moment);
            let driven = impose(speed, speed_next, next - position, step, &load);
            self.state.motor_torque_nm = driven.force;
            self.energy.dissipated_j += driven.moved.dissipated;
            self.energy.effects_j -= effect_torque * driven.moved.displacement;
            self.energy.count_input(driven.work);
            let stage =
                self.reach_slave(driven.moved, coupling, hand_torque_nm, (half, mean, moment));
            let slave = advance(self.state.slave_velocity_rad_s, step, &stage.slave);
            self.complete(&stage, slave);
        }
        self.read(0.0, hand_torque_nm);
    }

    /// What acts on the slave once the master has moved.
    fn reach_slave(
        &mut self,
        master: Advance,
        coupling: Coupling,
        hand_torque_nm: f64,
        (half, mean, moment): ([f64; 4], [f64; 4], Moment),
    ) -> Stage {
        let transmitted = self.lines.radii_m[1] * (coupling.pulley[0][1] + coupling.pulley[1][1]);
        let (mut slave, slave_effect) =
            self.side_load(Side::Slave, &coupling, &half, &mean, &moment);
        slave.force += hand_torque_nm;
        Stage {
            slave,
            master,
            coupling,
            half,
            mean,
            moment,
            slave_effect,
            hand_torque_nm,
            transmitted,
        }
    }

    /// Everything after the slave has moved: cables, energy, time.
    fn complete(&mut self, stage: &Stage, slave: Advance) {
        let Stage { master, coupling, half, mean, moment, .. } = stage;
        let step = moment.step_s;
        self.effects.moved([master.displacement, slave.displacement], moment);
        self.energy.dissipated_j += slave.dissipated;
        self.energy.effects_j -= stage.slave_effect * slave.displacement;
        self.energy.count_input(stage.hand_torque_nm * slave.displacement);

        let mut lines = [slave; 2];
        for line in 0..2 {
            let mut load = self.line_load(line, coupling, half[2 + line], mean[2 + line], moment);
            let resistance = coupling.middle_damping[line][0] + coupling.middle_damping[line][1];
            load.viscous_forward += resistance;
            load.viscous_backward += resistance;
            let moved = advance(self.state.line_velocity_m_s[line], step, &load);
            let speed = moved.displacement / step;
            // What the effects took is not lost.
            self.energy.dissipated_j += moved.dissipated - resistance * speed * moved.displacement;
            self.effects.flowed(line, moved.displacement, moment);
            for (end, angle) in [master.displacement, slave.displacement].into_iter().enumerate() {
                let (lost, taken) =
                    self.lines.work(coupling, (line, end), (moved.displacement, speed), angle);
                self.energy.dissipated_j += lost;
                self.energy.effects_j += taken;
            }
            lines[line] = moved;
        }

        let state = &mut self.state;
        let increment = |before: f64, after: f64| if after == 0.0 { 0.0 } else { after - before };
        self.increments = [
            increment(state.master_velocity_rad_s, master.velocity),
            increment(state.slave_velocity_rad_s, slave.velocity),
            increment(state.line_velocity_m_s[0], lines[0].velocity),
            increment(state.line_velocity_m_s[1], lines[1].velocity),
        ];
        state.time_s += step;
        state.master_position_rad += master.displacement;
        state.master_velocity_rad_s = master.velocity;
        state.slave_position_rad += slave.displacement;
        state.slave_velocity_rad_s = slave.velocity;
        for (line, moved) in lines.iter().enumerate() {
            state.line_position_m[line] += moved.displacement;
            state.line_velocity_m_s[line] = moved.velocity;
            state.line_tension_master_n[line] = coupling.tension[line][0];
            state.line_tension_slave_n[line] = coupling.tension[line][1];
        }
        state.transmitted_torque_nm = stage.transmitted;
    }

    /// All that acts on one side but motor or hand; and the torque that effects add.
    fn side_load(
        &mut self,
        side: Side,
        coupling: &Coupling,
        half: &[f64; 4],
        mean: &[f64; 4],
        moment: &Moment,
    ) -> (Load, f64) {
        let index = side as usize;
        let radius = self.lines.radii_m[index];
        let transmitted = radius * (coupling.pulley[0][index] + coupling.pulley[1][index]);
        let tensions = [coupling.tension[0][index], coupling.tension[1][index]];
        let level: f64 =
            tensions.map(|tension| self.parameters.support_friction_n(tension)).iter().sum();
        let mut dry = self.supports.friction(level, radius * half[index], radius * mean[index]);
        dry.scale(radius);
        let (own, viscous) = match side {
            Side::Master => (self.parameters.motor_coulomb_nm, self.parameters.motor_viscous_nm_s),
            Side::Slave => (self.parameters.slave_bearing_nm, 0.0),
        };
        dry.add(own, own);
        let viscous = viscous + 2.0 * radius * radius * self.support_viscous();
        let mut load = SideLoad {
            side,
            position_rad: half[index],
            velocity_rad_s: mean[index],
            transmitted_nm: transmitted,
            load: Load {
                force: transmitted,
                inertia: self.inertia[index],
                viscous_forward: viscous,
                viscous_backward: viscous,
                dry,
                smoothing: Smoothing::default(),
            },
        };
        let added = self.effects.side(&mut load, moment);
        (load.load, added)
    }

    /// What acts on the middle of a line's cables.
    fn line_load(
        &mut self,
        line: usize,
        coupling: &Coupling,
        position: f64,
        speed: f64,
        moment: &Moment,
    ) -> Load {
        let tension = 0.5 * (coupling.tension[line][0] + coupling.tension[line][1]);
        let level = self.inner_supports * self.parameters.support_friction_n(tension);
        let mut dry = self.supports.friction(level, position, speed);
        let viscous = self.inner_supports * self.support_viscous();
        // An effect knows one coefficient of loss, viscous and dry together.
        let moving = if speed >= 0.0 { dry.forward } else { dry.backward };
        let coefficient = viscous + moving / speed.abs().max(1e-6);
        let changed = self.effects.fluid(coefficient, moment);
        let factor = if coefficient > 0.0 { changed / coefficient } else { 1.0 };
        dry.scale(factor);
        Load {
            force: -coupling.middle[line][0] - coupling.middle[line][1],
            inertia: self.middle_mass_kg,
            viscous_forward: factor * viscous,
            viscous_backward: factor * viscous,
            dry,
            smoothing: Smoothing::default(),
        }
    }

    /// Viscous coefficient of a line's cables at one support, N·s/m.
    fn support_viscous(&self) -> f64 {
        self.parameters.cables * self.parameters.support_viscous_n_s_per_m
    }

    /// Positions at the middle of the step, and speeds there as extrapolated.
    fn middle(&self, step: f64) -> ([f64; 4], [f64; 4]) {
        let state = &self.state;
        let [first, second] = state.line_position_m;
        let positions = [state.master_position_rad, state.slave_position_rad, first, second];
        let [first, second] = state.line_velocity_m_s;
        let speeds = [state.master_velocity_rad_s, state.slave_velocity_rad_s, first, second];
        let half = std::array::from_fn(|index| positions[index] + 0.5 * step * speeds[index]);
        let mean = std::array::from_fn(|index| {
            let mean = speeds[index] + 0.5 * self.increments[index];
            // A movement that is about to stop does not count as one the other way.
            if mean * speeds[index] < 0.0 { 0.0 } else { mean }
        });
        (half, mean)
    }

    fn kinetic_j(&self) -> f64 {
        let state = &self.state;
        let lines: f64 = state.line_velocity_m_s.iter().map(|speed| speed * speed).sum();
        0.5 * (self.inertia[0] * state.master_velocity_rad_s.powi(2)
            + self.inertia[1] * state.slave_velocity_rad_s.powi(2)
            + self.middle_mass_kg * lines)
    }

    fn read(&mut self, motor_v: f64, hand_torque_nm: f64) {
        self.reading = self.effects.sense(&Motion::from(&self.state), motor_v, hand_torque_nm);
    }
}

/// For a handle that several transmissions share: it moves the slaves itself.
impl Shared for Plant {
    type Stage = Stage;

    fn begin(&mut self, input: Input, step: f64) -> (Stage, Load) {
        let (half, mean) = self.middle(step);
        let moment = Moment::middle(self.state.time_s, step, &half, &mean);
        let motor_torque = self.effects.motor_torque(
            input.motor_v,
            self.parameters.motor_torque_per_volt_nm,
            &moment,
        );
        let coupling = self.lines.couple(&half, &mean, &mut self.effects, &moment);
        let (mut master, effect_torque) =
            self.side_load(Side::Master, &coupling, &half, &mean, &moment);
        master.force += motor_torque;
        let moved = advance(self.state.master_velocity_rad_s, step, &master);
        self.energy.dissipated_j += moved.dissipated;
        self.energy.effects_j -= effect_torque * moved.displacement;
        self.energy.count_input(motor_torque * moved.displacement);
        self.state.motor_torque_nm = motor_torque;
        let stage = self.reach_slave(moved, coupling, input.hand_torque_nm, (half, mean, moment));
        (stage, stage.slave)
    }

    fn complete(&mut self, stage: Stage, slave: Advance) {
        Self::complete(self, &stage, slave);
    }

    fn observe(&mut self, input: Input) {
        self.read(input.motor_v, input.hand_torque_nm);
    }

    fn longest_step_s(&self) -> f64 {
        self.longest_step_s
    }

    fn slave_inertia_kg_m2(&self) -> f64 {
        self.inertia[1]
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
