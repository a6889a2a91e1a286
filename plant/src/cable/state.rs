//! The state of the cable transmission.

use crate::transmission::Motion;

/// True state of the plant, but for the history of the cables.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
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
    /// Displacement of the middle of the forward and the backward cable, m; both positive with a
    /// positive master.
    pub line_position_m: [f64; 2],
    /// Its speed, m/s.
    pub line_velocity_m_s: [f64; 2],
    /// Tension of all parallel cables of the forward and the backward line at the master's end, N,
    /// at the middle of the last internal step; never negative.
    pub line_tension_master_n: [f64; 2],
    /// The same at the slave's end, N.
    pub line_tension_slave_n: [f64; 2],
    /// Torque that the motor applied, N·m; under imposed motion the torque that it took.
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
