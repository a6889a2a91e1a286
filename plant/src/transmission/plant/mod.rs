//! The integrator, the same for every transmission.
//!
//! Position Verlet (drift, kick, drift) with sub-steps: forces are taken at the midpoint of the
//! step, damping at the mean velocity, dry friction as in [`crate::friction`]. It is of second
//! order, needs no linear solve, and conserves the energy of linear springs except for a bounded
//! term of `(ω h)²/8`, where explicit Euler feeds the line's mode until it diverges. The sub-step
//! follows from the highest mode and the fastest damping. Nothing is allocated in a step.

mod step;

use super::line_law::{Coupling, LineLaw};
use super::{
    Correction, EnergyBalance, ImposedMotion, Input, Motion, Reading, State, Transmission,
    TransmissionParameters,
};
use crate::effects::{Effect, Moment, Reach, Site, Sited};
use crate::friction::{Advance, Load};
use crate::handle_inertia::AXES;
use crate::{ParameterError, ParameterSet};

/// What [`Plant::with_longest_step`] may multiply the phase by: the highest mode is then at most
/// 1.5 % slow. So much is rarely used, but where the number of steps changed with a parameter, a
/// fit would stop at the jump.
const COARSE_PHASE: f64 = 4.0;
/// What it may multiply the decay by, and the phase of what effects do.
const COARSE_RATE: f64 = 2.5;
/// Largest decay of the fastest damping in one internal step.
const DECAY_PER_STEP: f64 = 0.2;
/// Longest internal step, s.
const LONGEST_STEP_S: f64 = 0.25e-3;

/// What follows from the parameters once; pairs are of master and slave.
#[derive(Clone, Debug)]
struct Constants {
    torque_per_volt_nm: f64,
    half_line_n_per_m: [f64; 2],
    link_damping_n_s_per_m: f64,
    displacement: [f64; 2],
    inertia: [f64; 2],
    middle_mass_kg: f64,
    longest_step_s: f64,
    /// The longest that [`Plant::with_longest_step`] allows.
    coarse_step_s: f64,
}

/// A transmission in motion: its state, the effects in it, and the law of its lines.
#[derive(Clone, Debug)]
pub struct Plant<L: LineLaw> {
    parameters: L::Parameters,
    constants: Constants,
    law: L,
    effects: Sited,
    state: State,
    /// Change of the four velocities over the last internal step: extrapolates the mean velocity
    /// of the next.
    increments: [f64; 4],
    reading: Reading,
    energy: EnergyBalance,
    stored_at_start_j: f64,
    /// Whether the energy balance is kept.
    balances_energy: bool,
}

/// Positions and velocities of master, slave and both lines at the midpoint of an internal step.
#[derive(Clone, Copy)]
struct Midpoint {
    half: [f64; 4],
    mean: [f64; 4],
    moment: Moment,
}

/// An internal step in which the master has moved and the slave has not yet.
#[derive(Clone, Copy)]
pub(crate) struct PendingStep {
    /// What acts on the slave.
    pub(crate) load: Load,
    /// Part of its torque that effects add, N·m.
    effect_nm: f64,
    /// Part of its torque that the lines transmit, N·m.
    transmitted_nm: f64,
    hand_torque_nm: f64,
    master: Advance,
    coupling: Coupling,
    at: Midpoint,
}

/// Calls a method in its version with all hooks of effects or in that without any.
macro_rules! by_effects {
    ($self:ident.$method:ident($($argument:expr),*)) => {
        match $self.effects.reach {
            Reach::Nothing => $self.$method::<false, false>($($argument),*),
            Reach::Sides | Reach::Links => $self.$method::<true, true>($($argument),*),
        }
    };
}

impl<L: LineLaw> Plant<L> {
    /// A transmission at rest at zero.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`] for a parameter of the transmission or of an effect;
    /// [`ParameterError::EffectNotApplicable`] for an effect that does not act on such lines.
    pub fn new(
        parameters: L::Parameters,
        effects: Vec<Box<dyn Effect>>,
    ) -> Result<Self, ParameterError> {
        parameters.check()?;
        let mut parameters = parameters;
        let effects = Sited::install(effects, &mut parameters)?;
        let extra = [Site::Master, Site::Slave].map(|site| effects.extra_inertia[site as usize]);
        let [master, slave] = TransmissionParameters::inertia_kg_m2(&parameters);
        let inertia = [master + extra[0], slave + extra[1]];
        let displacement = parameters.displacement_m_per_rad();
        let middle_mass_kg = parameters.middle_mass_kg();
        let link_damping_n_s_per_m = parameters.link_damping_n_s_per_m();
        let highest = L::highest_mode_rad_s(&parameters, extra, effects.stiffness_factor);
        let decay = 2.0
            * link_damping_n_s_per_m
            * (1.0 / middle_mass_kg
                + displacement[0].powi(2) / inertia[0]
                + displacement[1].powi(2) / inertia[1]);
        let by_mode = L::PHASE_PER_STEP / highest.max(1e-9);
        let by_rate = (L::PHASE_PER_STEP / effects.rate_rad_s.max(1e-9))
            .min(DECAY_PER_STEP / decay.max(1e-9));
        let constants = Constants {
            torque_per_volt_nm: parameters.motor_torque_per_volt_nm(),
            half_line_n_per_m: parameters.half_line_stiffness_n_per_m(),
            link_damping_n_s_per_m,
            displacement,
            inertia,
            middle_mass_kg,
            longest_step_s: LONGEST_STEP_S.min(by_mode).min(by_rate),
            coarse_step_s: (COARSE_PHASE * by_mode).min(COARSE_RATE * by_rate),
        };
        let mut plant = Self {
            law: L::new(&parameters),
            parameters,
            constants,
            effects,
            state: State::default(),
            increments: [0.0; 4],
            reading: Reading::default(),
            energy: EnergyBalance::default(),
            stored_at_start_j: 0.0,
            balances_energy: true,
        };
        plant.rest();
        Ok(plant)
    }

    /// The parameters of the simulation, effects included.
    pub fn parameters(&self) -> &L::Parameters {
        &self.parameters
    }

    /// The true state at the end of the last step.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Longest internal step, s.
    pub fn longest_step_s(&self) -> f64 {
        self.constants.longest_step_s
    }

    /// Allows internal steps as long as `longest_s` where modes and damping permit: faster, and
    /// coarser in how friction and effects follow the velocity. The default is at most 0.25 ms.
    #[must_use]
    pub fn with_longest_step(mut self, longest_s: f64) -> Self {
        self.set_longest_step(longest_s);
        self
    }

    pub(crate) fn set_longest_step(&mut self, longest_s: f64) {
        self.constants.longest_step_s = longest_s.min(self.constants.coarse_step_s);
    }

    /// Keeps no energy balance: for estimators, which simulate thousands of records.
    /// [`Transmission::energy`] then means nothing.
    #[must_use]
    pub fn without_energy_balance(mut self) -> Self {
        self.forgo_energy_balance();
        self
    }

    pub(crate) fn forgo_energy_balance(&mut self) {
        self.balances_energy = false;
    }

    /// Sets positions and velocities and restarts the energy balance; forces are computed in the
    /// next step.
    ///
    /// Lines with a history come to rest there. The inner state of effects stays.
    pub fn set_state(&mut self, state: State) {
        self.state = state;
        self.increments = [0.0; 4];
        self.rest();
        self.read(0.0, 0.0);
    }

    /// Puts the plant to rest with the master at `master_rad` and the slave at `slave_rad` or, for
    /// `None`, where the unloaded lines would have it. The middle of each line rests midway
    /// between the displacements of its two ends.
    pub fn rest_at(&mut self, master_rad: f64, slave_rad: Option<f64>) {
        let [master, slave] = self.constants.displacement;
        let slave_rad = slave_rad.unwrap_or(master_rad * master / slave);
        self.set_state(State {
            master_position_rad: master_rad,
            slave_position_rad: slave_rad,
            line_position_m: [0.5 * (master * master_rad + slave * slave_rad); 2],
            ..State::default()
        });
    }

    /// Adds to positions and velocities without a restart, as an observer that corrects the model
    /// by a measurement does.
    ///
    /// The energy that this adds, or makes the lines lose, is left out of the balance.
    pub fn correct(&mut self, correction: Correction) {
        let total = |plant: &Self| {
            let (stored, lost) = plant.stored_and_lost_j();
            stored + lost
        };
        let before = self.balances_energy.then(|| total(self));
        self.state.master_position_rad += correction.master_position_rad;
        self.state.master_velocity_rad_s += correction.master_velocity_rad_s;
        self.state.slave_position_rad += correction.slave_position_rad;
        self.state.slave_velocity_rad_s += correction.slave_velocity_rad_s;
        if let Some(before) = before {
            self.stored_at_start_j += total(self) - before;
        }
    }

    /// Takes over what the breakdowns of another machine are at; before [`Plant::set_state`].
    pub(crate) fn take_over_breakdowns(&mut self, other: &Self) {
        self.effects.take_over_breakdowns(&other.effects);
    }

    /// Ends the breakdown of that number; what it left behind stays.
    pub fn end_breakdown(&mut self, number: u64) {
        self.effects.end_breakdown(number);
    }

    /// Products of inertia that effects add to a shared handle, by axis, kg·m².
    pub(crate) fn handle_coupling_kg_m2(&self) -> [f64; AXES] {
        self.effects.handle_coupling_kg_m2
    }

    /// Inertia of the slave, effects included, kg·m².
    pub(crate) fn slave_inertia_kg_m2(&self) -> f64 {
        self.constants.inertia[1]
    }

    /// Moves the master over an internal step and returns what acts on the slave. For a handle
    /// that several transmissions share: the caller moves the slaves.
    pub(crate) fn begin(&mut self, input: Input, step_s: f64) -> PendingStep {
        by_effects!(self.begin_with(input, step_s))
    }

    /// Finishes the step of [`Plant::begin`] once it is known how the slave moved.
    pub(crate) fn complete(&mut self, pending: &PendingStep, slave: Advance) {
        by_effects!(self.complete_with(pending, slave));
    }

    /// Updates the reading after the last internal step of a control period.
    pub(crate) fn read(&mut self, motor_v: f64, hand_torque_nm: f64) {
        self.reading = self.effects.sense(&Motion::from(&self.state), motor_v, hand_torque_nm);
    }

    /// Lets the lines come to rest where the masses are, and restarts the energy balance.
    fn rest(&mut self) {
        for (line, end) in LINKS {
            let shift_m = -self.effects.offset_m(line, end);
            self.law.rest(line, end, self.deflection_m(line, end), shift_m);
        }
        self.energy = EnergyBalance::default();
        self.stored_at_start_j = self.stored_and_lost_j().0;
    }

    fn deflection_m(&self, line: usize, end: usize) -> f64 {
        let state = &self.state;
        let angle = [state.master_position_rad, state.slave_position_rad][end];
        state.line_position_m[line] - self.constants.displacement[end] * angle
    }

    /// Kinetic energy and that of the links, and what the links have dissipated, J.
    fn stored_and_lost_j(&self) -> (f64, f64) {
        let (state, constants) = (&self.state, &self.constants);
        let lines: f64 = state.line_velocity_m_s.iter().map(|speed| speed * speed).sum();
        let kinetic = 0.5
            * (constants.inertia[0] * state.master_velocity_rad_s.powi(2)
                + constants.inertia[1] * state.slave_velocity_rad_s.powi(2)
                + constants.middle_mass_kg * lines);
        LINKS.into_iter().fold((kinetic, 0.0), |(stored, lost), (line, end)| {
            let deflection = self.deflection_m(line, end);
            let stiffness = constants.half_line_n_per_m[end];
            let link = self.law.energy_j(line, end, deflection, stiffness);
            (stored + link.0, lost + link.1)
        })
    }
}

/// Every link, by line and end.
const LINKS: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

impl<L: LineLaw> Transmission for Plant<L> {
    fn step(&mut self, input: Input, dt_s: f64) {
        // Compiled for each reach: each hook that is not called makes a plant faster.
        match self.effects.reach {
            Reach::Nothing => self.step_with::<false, false>(input, dt_s),
            Reach::Sides => self.step_with::<true, false>(input, dt_s),
            Reach::Links => self.step_with::<true, true>(input, dt_s),
        }
    }

    fn step_imposed(&mut self, master: ImposedMotion, hand_torque_nm: f64, dt_s: f64) {
        by_effects!(self.step_imposed_with(master, hand_torque_nm, dt_s));
    }

    fn motion(&self) -> Motion {
        Motion::from(&self.state)
    }

    fn reading(&self) -> Reading {
        self.reading
    }

    fn energy(&self) -> EnergyBalance {
        let (stored, lost) = self.stored_and_lost_j();
        EnergyBalance {
            stored_j: stored - self.stored_at_start_j,
            dissipated_j: self.energy.dissipated_j + lost,
            ..self.energy
        }
    }
}
