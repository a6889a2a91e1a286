//! Transmissions: what goes in, what comes out, and the one integrator that moves them all.
//!
//! A transmission is a master and a slave joined by two lines. [`Plant`] integrates it;
//! [`LineLaw`] is what distinguishes an oil line from a cable.

mod line_law;
mod modes;
mod parameters;
mod plant;

pub use line_law::{Coupling, DeclaredForce, LineLaw, Middle};
pub use parameters::TransmissionParameters;
pub(crate) use parameters::least_damping;
pub(crate) use plant::PendingStep;
pub use plant::Plant;

/// What acts on the plant during a step; held over it. Values must be finite.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Volts at the amplifier, V.
    pub motor_v: f64,
    /// Torque that the hand applies to the slave, N·m; positive drives the slave positive.
    pub hand_torque_nm: f64,
}

/// Where the master is to be at the end of a step, whatever torque that takes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImposedMotion {
    /// Master position at the end of the step, rad.
    pub position_rad: f64,
    /// Master velocity at the end of the step, rad/s.
    pub velocity_rad_s: f64,
}

impl ImposedMotion {
    /// Position and speed `part` of the way (0 to 1) along the cubic that leads here from another
    /// position and speed.
    pub fn approach(self, from: f64, speed_from: f64, duration: f64, part: f64) -> (f64, f64) {
        let (one, two) = (duration * speed_from, duration * self.velocity_rad_s);
        let change = self.position_rad - from;
        let (square, cube) = (3.0 * change - 2.0 * one - two, one + two - 2.0 * change);
        let position = from + part * (one + part * (square + part * cube));
        let speed = (one + part * (2.0 * square + part * 3.0 * cube)) / duration;
        (position, speed)
    }
}

/// What an observer adds to the state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Correction {
    /// To the master angle, rad.
    pub master_position_rad: f64,
    /// To the master speed, rad/s.
    pub master_velocity_rad_s: f64,
    /// To the slave angle, rad.
    pub slave_position_rad: f64,
    /// To the slave speed, rad/s.
    pub slave_velocity_rad_s: f64,
}

/// What the instruments would read before they are turned into counts and volts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Volts that the DAC put out, V.
    pub motor_v: f64,
    /// Master angle, rad.
    pub master_rad: f64,
    /// Slave angle, rad.
    pub slave_rad: f64,
    /// Torque that the hand applies to the slave, N·m.
    pub slave_torque_nm: f64,
}

/// Where the energy went since the plant was made: `input = stored + dissipated + effects`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EnergyBalance {
    /// Work of motor and hand, J.
    pub input_j: f64,
    /// Kinetic energy and that of the lines' springs, less what was there at the start, J.
    pub stored_j: f64,
    /// Lost to friction and damping, J.
    pub dissipated_j: f64,
    /// Taken by effects that are not friction (a nonlinear spring's share, a hand, gravity, a
    /// disturbance), J.
    pub effects_j: f64,
    /// Magnitude of all work of motor and hand, J: the scale against which the balance is read.
    pub throughput_j: f64,
}

impl EnergyBalance {
    /// Adds work of motor or hand, J.
    #[inline]
    pub(crate) fn count_input(&mut self, work_j: f64) {
        self.input_j += work_j;
        self.throughput_j += work_j.abs();
    }

    /// What the balance leaves open, J; the integrator's error.
    pub fn defect_j(&self) -> f64 {
        self.input_j - self.stored_j - self.dissipated_j - self.effects_j
    }
}

/// What every transmission shows of itself at the end of the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Time since the plant was made, s.
    pub time_s: f64,
    /// Master angle `q_m`, rad.
    pub master_position_rad: f64,
    /// Master speed, rad/s.
    pub master_velocity_rad_s: f64,
    /// Slave angle `q_s`, rad.
    pub slave_position_rad: f64,
    /// Slave speed, rad/s.
    pub slave_velocity_rad_s: f64,
    /// Torque that the motor applied, N·m; under imposed motion the torque that it took.
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
    /// Moves the plant on by `dt_s` with the input held; `dt_s` not positive does nothing.
    fn step(&mut self, input: Input, dt_s: f64);

    /// Moves the master to where it is to be, whatever that takes; the slave moves as it must.
    fn step_imposed(&mut self, master: ImposedMotion, hand_torque_nm: f64, dt_s: f64);

    /// Where it is.
    fn motion(&self) -> Motion;

    /// What the instruments would read, sensor effects included.
    fn reading(&self) -> Reading;

    /// Where the energy went.
    fn energy(&self) -> EnergyBalance;
}

/// How many internal steps of at most `longest_s` an output step takes, and how long each is; none
/// for a step that is not positive.
pub(crate) fn sub_steps(dt_s: f64, longest_s: f64) -> (usize, f64) {
    if dt_s.is_nan() || dt_s <= 0.0 {
        return (0, 0.0);
    }
    let count = (dt_s / longest_s - 1e-9).ceil().max(1.0);
    (count as usize, dt_s / count)
}
