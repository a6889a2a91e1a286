//! The equations of motion (3.1.8 to 3.1.13) and their integrator: classical Runge-Kutta on the
//! full state.
//!
//! State: angle and speed of master and slave, displacement and speed of the fluid in both lines,
//! and the states of the deviations. Dry friction is `F(|v|) g(v/v_e)` ([`crate::smoothing`]).
//! Steps are 50 µs or shorter, a tenth of a sample or less, so that the friction's slope at rest,
//! `F/(I v_e)`, stays well within the method's stability.

use crate::deviation::{Deviation, Link, Side, View};
use crate::hose_loss::HoseLoss;
use crate::machine_parameters::MachineParameters;
use crate::smoothing::Smoothing;

/// Largest number of states of a model: those of the declared model, 32 for a dead time of the
/// line, and up to eight of another effect.
pub const MOST: usize = 48;
/// States of the declared model.
const OWN: usize = 8;
/// Largest product of the rate of friction and the step; Runge-Kutta of fourth order is stable up
/// to 2.78.
const RATE_TIMES_STEP: f64 = 1.3;
/// Least and largest number of steps per sample.
const STEPS: (usize, usize) = (10, 40);

/// The state vector.
#[derive(Clone, Copy, Debug)]
pub struct State(pub [f64; MOST]);

impl Default for State {
    fn default() -> Self {
        Self([0.0; MOST])
    }
}

/// Inputs during a sample. Torques are interpolated linearly, voltages are held.
#[derive(Clone, Copy, Debug, Default)]
pub struct Input<'a> {
    /// Voltage at the amplifier for every sample of the record up to this one, V.
    pub volts: &'a [f64],
    /// Torque of the hand at the start and the end of the sample, N·m.
    pub hand_nm: [f64; 2],
    /// Torque disturbance on master and slave, N·m.
    pub disturbance_nm: [f64; 2],
    /// Correction by an observer: additions to the rates of master angle and speed, slave angle and
    /// speed.
    pub pull: [f64; 4],
}

/// Deviations with too many states.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the model and its effects have {0} states, more than the {MOST} that a model has room for"
)]
pub struct TooManyStates(pub usize);

/// The machine with its deviations.
#[derive(Debug)]
pub struct Simulator {
    machine: MachineParameters,
    smoothing: Smoothing,
    deviations: Vec<Box<dyn Deviation>>,
    inertia: [f64; 2],
    displacement: [f64; 2],
    half_line_n_per_m: f64,
    fluid_mass_kg: f64,
    hose_loss: HoseLoss,
    states: usize,
    steps: usize,
    sample_s: f64,
}

impl Simulator {
    /// Puts the deviations into the machine.
    ///
    /// # Errors
    /// [`TooManyStates`].
    pub fn new(
        mut machine: MachineParameters,
        smoothing: Smoothing,
        deviations: Vec<Box<dyn Deviation>>,
        sample_s: f64,
    ) -> Result<Self, TooManyStates> {
        let states = OWN + deviations.iter().map(|deviation| deviation.states()).sum::<usize>();
        if states > MOST {
            return Err(TooManyStates(states));
        }
        for deviation in &deviations {
            deviation.alter(&mut machine);
        }
        let extra = [0, 1]
            .map(|side| deviations.iter().map(|deviation| deviation.inertia(side)).sum::<f64>());
        let own = machine.inertia_kg_m2();
        let mut model = Self {
            inertia: [own[0] + extra[0], own[1] + extra[1]],
            displacement: machine.displacement_m_per_rad(),
            half_line_n_per_m: 2.0 * machine.line_stiffness_n_per_m(),
            fluid_mass_kg: machine.fluid_mass_kg(),
            hose_loss: HoseLoss::of(&machine),
            states,
            steps: STEPS.0,
            machine,
            smoothing,
            deviations,
            sample_s,
        };
        model.steps = ((model.stiffest_rate() * sample_s / RATE_TIMES_STEP).ceil() as usize)
            .clamp(STEPS.0, STEPS.1);
        Ok(model)
    }

    /// States of the declared model and of all deviations.
    pub fn states(&self) -> usize {
        self.states
    }

    /// Slope of the friction at rest over the inertia, 1/s: the fastest decay in the model. Effects
    /// are evaluated at the start, where drifting friction is largest.
    fn stiffest_rate(&self) -> f64 {
        let view = View::at_rest();
        [0, 1]
            .map(|side| {
                let mut acting = self.side(side, 0.0, &view, &State::default().0, &mut [0.0; MOST]);
                acting.dry_forward = acting.dry_forward.max(acting.dry_backward);
                acting.dry_forward / (self.inertia[side] * self.smoothing.speed_rad_s)
            })
            .into_iter()
            .fold(0.0, f64::max)
    }

    /// With two thirds of the steps, as few as the integrator bears: for comparisons.
    #[must_use]
    pub fn coarse(self) -> Self {
        Self { steps: (2 * self.steps).div_ceil(3).max(7), ..self }
    }

    /// Steps of the integrator a sample.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Length of a sample, s.
    pub fn sample_s(&self) -> f64 {
        self.sample_s
    }

    /// The machine, altered.
    pub fn machine(&self) -> &MachineParameters {
        &self.machine
    }

    /// The deviations.
    pub fn deviations_mut(&mut self) -> &mut [Box<dyn Deviation>] {
        &mut self.deviations
    }

    /// What the state is called, at a time on the run and within the record (s).
    pub fn view<'a>(
        &self,
        state: &[f64; MOST],
        time_s: f64,
        local_s: f64,
        volts: &'a [f64],
    ) -> View<'a> {
        View {
            time_s,
            local_s,
            sample_s: self.sample_s,
            volts,
            position: [state[0], state[2]],
            velocity: [state[1], state[3]],
            fluid_velocity: [state[5], state[7]],
        }
    }

    /// At rest at two angles, the fluid midway.
    pub fn settled(&self, master_rad: f64, slave_rad: f64) -> State {
        let mut state = State::default();
        let fluid = 0.5 * (self.displacement[0] * master_rad + self.displacement[1] * slave_rad);
        (state.0[0], state.0[2], state.0[4], state.0[6]) = (master_rad, slave_rad, fluid, fluid);
        state
    }

    /// Moves the state on by one sample that begins at `time_s` on the run and `local_s` within the
    /// record. Returns the rates of change at its begin.
    pub fn advance(
        &self,
        state: &mut State,
        time_s: f64,
        local_s: f64,
        input: &Input<'_>,
    ) -> [f64; MOST] {
        let step = self.sample_s / self.steps as f64;
        let mut first = [0.0; MOST];
        for index in 0..self.steps {
            let part = index as f64 / self.steps as f64;
            let at = |fraction: f64| (part + fraction / self.steps as f64) * self.sample_s;
            let rate = |state: &[f64; MOST], fraction: f64| {
                let offset = at(fraction);
                let hand = input.hand_nm[0]
                    + (input.hand_nm[1] - input.hand_nm[0]) * offset / self.sample_s;
                self.rates(state, time_s + offset, local_s + offset, hand, input)
            };
            let x = &state.0;
            let k1 = rate(x, 0.0);
            if index == 0 {
                first = k1;
            }
            let k2 = rate(&self.along(x, &k1, 0.5 * step), 0.5);
            let k3 = rate(&self.along(x, &k2, 0.5 * step), 0.5);
            let k4 = rate(&self.along(x, &k3, step), 1.0);
            for i in 0..self.states {
                state.0[i] += step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
            }
        }
        first
    }

    #[inline]
    fn along(&self, x: &[f64; MOST], rate: &[f64; MOST], step: f64) -> [f64; MOST] {
        let mut moved = *x;
        for i in 0..self.states {
            moved[i] += step * rate[i];
        }
        moved
    }

    /// Rates of change of the state.
    pub fn rates(
        &self,
        x: &[f64; MOST],
        time_s: f64,
        local_s: f64,
        hand_nm: f64,
        input: &Input<'_>,
    ) -> [f64; MOST] {
        let view = self.view(x, time_s, local_s, input.volts);
        let mut rates = [0.0; MOST];
        // The motor.
        let mut volts = input.volts.last().copied().unwrap_or(0.0);
        self.each(|deviation, own| {
            volts = deviation.amplifier(volts, &view, &x[own.clone()], &mut rates[own])
        });
        let mut torque = self.machine.motor_torque_per_volt_nm * volts;
        self.each(|deviation, _| torque = deviation.motor(torque, &view));
        // The lines: eq. 3.1.9 at both ends, then 3.1.8.
        let mut transmitted = [0.0; 2];
        for line in 0..2 {
            let (place, speed) = (4 + 2 * line, 5 + 2 * line);
            let mut on_fluid = 0.0;
            for (side, transmitted) in transmitted.iter_mut().enumerate() {
                let ratio = self.displacement[side];
                let mut link = Link {
                    side,
                    line,
                    stiffness_n_per_m: self.half_line_n_per_m,
                    damping_n_s_per_m: self.machine.port_damping_n_s_per_m,
                    displacement_m_per_rad: ratio,
                    deflection_m: x[place] - ratio * view.position[side],
                    rate_m_s: x[speed] - ratio * view.velocity[side],
                    fluid_position_m: x[place],
                    force_n: 0.0,
                    fluid_force_n: 0.0,
                };
                self.each(|deviation, own| deviation.stretch(&mut link, &view, &x[own]));
                link.force_n = link.stiffness_n_per_m * link.deflection_m
                    + link.damping_n_s_per_m * link.rate_m_s;
                link.fluid_force_n = link.force_n;
                self.each(|deviation, own| {
                    deviation.link(&mut link, &view, &x[own.clone()], &mut rates[own])
                });
                *transmitted += ratio * link.force_n;
                on_fluid += link.fluid_force_n;
            }
            let mut loss = self.hose_loss.n_s_per_m(x[speed]);
            self.each(|deviation, _| loss = deviation.hose_loss(line, loss, &view));
            rates[place] = x[speed];
            rates[speed] = (-on_fluid - loss * x[speed]) / self.fluid_mass_kg;
        }
        // Master and slave: eq. 3.1.12.
        let driven = [torque, hand_nm];
        for side in 0..2 {
            let acting = self.side(side, transmitted[side], &view, x, &mut rates);
            let velocity = view.velocity[side];
            let (dry, viscous) = if velocity >= 0.0 {
                (acting.dry_forward, acting.viscous_forward)
            } else {
                (acting.dry_backward, acting.viscous_backward)
            };
            let friction = dry.max(0.0) * self.smoothing.share(velocity) + viscous * velocity;
            let sum = acting.torque_nm + driven[side] + input.disturbance_nm[side] - friction;
            rates[2 * side] = velocity + input.pull[2 * side];
            rates[2 * side + 1] = sum / self.inertia[side] + input.pull[2 * side + 1];
        }
        rates
    }

    fn side(
        &self,
        side: usize,
        transmitted_nm: f64,
        view: &View<'_>,
        x: &[f64; MOST],
        rates: &mut [f64; MOST],
    ) -> Side {
        let velocity = view.velocity[side];
        let speed = velocity.abs();
        let (dry, viscous) = if side == 0 {
            (self.machine.master_friction_nm(speed), self.machine.motor_viscous_nm_s)
        } else {
            (self.machine.slave_friction_nm(speed), 0.0)
        };
        let mut acting = Side {
            side,
            position_rad: view.position[side],
            velocity_rad_s: velocity,
            smoothing: self.smoothing,
            transmitted_nm,
            torque_nm: transmitted_nm,
            dry_forward: dry,
            dry_backward: dry,
            dry_at_rest_nm: if side == 0 {
                self.machine.master_friction_nm(0.0)
            } else {
                self.machine.slave_friction_nm(0.0)
            },
            viscous_forward: viscous,
            viscous_backward: viscous,
        };
        self.each(|deviation, own| {
            deviation.side(&mut acting, view, &x[own.clone()], &mut rates[own])
        });
        acting
    }

    #[inline]
    fn each(&self, mut act: impl FnMut(&dyn Deviation, std::ops::Range<usize>)) {
        let mut from = OWN;
        for deviation in &self.deviations {
            let count = deviation.states();
            act(deviation.as_ref(), from..from + count);
            from += count;
        }
    }

    /// Kinetic energy and energy in the springs of the declared model, J.
    pub fn energy_j(&self, state: &State) -> f64 {
        let x = &state.0;
        let mut energy = 0.5 * (self.inertia[0] * x[1] * x[1] + self.inertia[1] * x[3] * x[3]);
        for line in 0..2 {
            let (place, speed) = (x[4 + 2 * line], x[5 + 2 * line]);
            energy += 0.5 * self.fluid_mass_kg * speed * speed;
            for side in 0..2 {
                energy += 0.5
                    * self.half_line_n_per_m
                    * (place - self.displacement[side] * x[2 * side]).powi(2);
            }
        }
        energy
    }
}

#[cfg(test)]
mod tests;
