//! Transmissions: what goes in, what comes out, and the one integrator that moves them all.
//!
//! A transmission is a master and a slave joined by two lines. [`Plant`] integrates it;
//! [`LineLaw`] is what distinguishes an oil line from a cable.

mod eigenmodes;
mod line_law;
mod parameters;
mod plant;

pub use line_law::{Coupling, DeclaredForce, LineLaw, Middle};
pub use parameters::TransmissionParameters;
pub(crate) use parameters::least_damping;
pub(crate) use plant::PendingStep;
pub use plant::Plant;

/// Inputs of the plant, held over a step. Values must be finite.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Volts at the amplifier, V.
    pub motor_v: f64,
    /// Torque that the hand applies to the slave, N·m; positive drives the slave positive.
    pub hand_torque_nm: f64,
}

/// Imposed position and velocity of the master at the end of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImposedMotion {
    /// Master position at the end of the step, rad.
    pub position_rad: f64,
    /// Master velocity at the end of the step, rad/s.
    pub velocity_rad_s: f64,
}

impl ImposedMotion {
    /// Position and velocity after `part` of the duration (0 to 1) along the cubic that leads here
    /// from another position and velocity.
    pub fn approach(self, from: f64, speed_from: f64, duration: f64, part: f64) -> (f64, f64) {
        let (one, two) = (duration * speed_from, duration * self.velocity_rad_s);
        let change = self.position_rad - from;
        let (square, cube) = (3.0 * change - 2.0 * one - two, one + two - 2.0 * change);
        let position = from + part * (one + part * (square + part * cube));
        let speed = (one + part * (2.0 * square + part * 3.0 * cube)) / duration;
        (position, speed)
    }
}

/// Correction of the state by an observer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Correction {
    /// Added to the master angle, rad.
    pub master_position_rad: f64,
    /// Added to the master velocity, rad/s.
    pub master_velocity_rad_s: f64,
    /// Added to the slave angle, rad.
    pub slave_position_rad: f64,
    /// Added to the slave velocity, rad/s.
    pub slave_velocity_rad_s: f64,
}

/// Measured quantities before their conversion to counts and volts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Output of the DAC, V.
    pub motor_v: f64,
    /// Master angle, rad.
    pub master_rad: f64,
    /// Slave angle, rad.
    pub slave_rad: f64,
    /// Torque that the hand applies to the slave, N·m.
    pub slave_torque_nm: f64,
}

/// Energy balance since the start: `input = stored + dissipated + effects`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EnergyBalance {
    /// Work of motor and hand, J.
    pub input_j: f64,
    /// Change of the kinetic energy and of that stored in the lines, J.
    pub stored_j: f64,
    /// Lost to friction and damping, J.
    pub dissipated_j: f64,
    /// Absorbed by effects other than friction (a nonlinear spring, a hand, gravity, a
    /// disturbance), J.
    pub effects_j: f64,
    /// Sum of the magnitudes of the work of motor and hand, J: the scale of the balance.
    pub throughput_j: f64,
}

impl EnergyBalance {
    /// Adds work of motor or hand, J.
    #[inline]
    pub(crate) fn count_input(&mut self, work_j: f64) {
        self.input_j += work_j;
        self.throughput_j += work_j.abs();
    }

    /// Residual of the balance, J: the error of the integrator.
    pub fn defect_j(&self) -> f64 {
        self.input_j - self.stored_j - self.dissipated_j - self.effects_j
    }
}

/// Outputs common to all transmissions, at the end of the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Time since the start, s.
    pub time_s: f64,
    /// Master angle `q_m`, rad.
    pub master_position_rad: f64,
    /// Master velocity, rad/s.
    pub master_velocity_rad_s: f64,
    /// Slave angle `q_s`, rad.
    pub slave_position_rad: f64,
    /// Slave velocity, rad/s.
    pub slave_velocity_rad_s: f64,
    /// Torque that the motor applied, N·m; under imposed motion the torque required.
    pub motor_torque_nm: f64,
    /// Torque of the transmission on the slave, N·m.
    pub transmitted_torque_nm: f64,
}

/// True state of a transmission, except for the history of its lines.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Time since the start, s.
    pub time_s: f64,
    /// Master angle `q_m`, rad.
    pub master_position_rad: f64,
    /// Master velocity, rad/s.
    pub master_velocity_rad_s: f64,
    /// Slave angle `q_s`, rad.
    pub slave_position_rad: f64,
    /// Slave velocity, rad/s.
    pub slave_velocity_rad_s: f64,
    /// Displacement of the middle of each line, m; both positive with a positive master.
    pub line_position_m: [f64; 2],
    /// Its velocity, m/s.
    pub line_velocity_m_s: [f64; 2],
    /// Force of each line at its end at the master and at the slave, N, at the midpoint of the last
    /// internal step: for oil the force on the piston's coordinate, eq. 3.1.9; for cables the
    /// tension of all parallel cables, never negative.
    pub line_force_n: [[f64; 2]; 2],
    /// Torque that the motor applied, N·m; under imposed motion the torque required.
    pub motor_torque_nm: f64,
    /// Torque of both lines on the slave, N·m.
    pub transmitted_torque_nm: f64,
}

impl From<&State> for Motion {
    fn from(state: &State) -> Self {
        Self {
            time_s: state.time_s,
            master_position_rad: state.master_position_rad,
            master_velocity_rad_s: state.master_velocity_rad_s,
            slave_position_rad: state.slave_position_rad,
            slave_velocity_rad_s: state.slave_velocity_rad_s,
            motor_torque_nm: state.motor_torque_nm,
            transmitted_torque_nm: state.transmitted_torque_nm,
        }
    }
}

/// A plant of one axis between a motor and a handle.
pub trait Transmission: Clone + Send {
    /// Advances by `dt_s` (s) with the input held; does nothing unless `dt_s` is positive.
    fn step(&mut self, input: Input, dt_s: f64);

    /// Advances by `dt_s` with the motion of the master imposed, along a cubic from its present
    /// position and velocity; [`Motion::motor_torque_nm`] is then the torque required.
    fn step_imposed(&mut self, master: ImposedMotion, hand_torque_nm: f64, dt_s: f64);

    /// Positions, velocities and torques at the end of the last step.
    fn motion(&self) -> Motion;

    /// What the instruments read, sensor effects included.
    fn reading(&self) -> Reading;

    /// The energy balance.
    fn energy(&self) -> EnergyBalance;
}

/// Number and length of the internal steps, at most `longest_s`, of an output step; none unless
/// `dt_s` is positive.
pub(crate) fn sub_steps(dt_s: f64, longest_s: f64) -> (usize, f64) {
    if dt_s.is_nan() || dt_s <= 0.0 {
        return (0, 0.0);
    }
    let count = (dt_s / longest_s - 1e-9).ceil().max(1.0);
    (count as usize, dt_s / count)
}
