//! The state of the hydrostatic transmission.

use crate::transmission::Motion;

/// True state of the plant.
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
    /// Fluid displacement `s_1`, `s_2`, m; both positive with a positive master.
    pub line_position_m: [f64; 2],
    /// Fluid speed, m/s.
    pub line_velocity_m_s: [f64; 2],
    /// Force of each line on the master piston's coordinate, `F_m` of eq. 3.1.9, N (in the hose's
    /// cross section), at the middle of the last internal step.
    pub line_force_master_n: [f64; 2],
    /// Force of each line on the slave, `F_s`, N.
    pub line_force_slave_n: [f64; 2],
    /// Torque that the motor applied, N·m; under imposed motion the torque that it took.
    pub motor_torque_nm: f64,
    /// Torque of both lines on the slave, N·m.
    pub transmitted_torque_nm: f64,
}

impl State {
    /// Pressure change against the pressure at rest, Pa: of each line, at the master's and at the
    /// slave's end.
    ///
    /// `dP = F/A` (eq. 3.1.5). Line 2 returns, so its sign is the opposite of line 1's.
    pub fn line_pressure_pa(&self, hose_area_m2: f64) -> [[f64; 2]; 2] {
        let [first, second] = [0, 1].map(|line| {
            [
                -self.line_force_master_n[line] / hose_area_m2,
                self.line_force_slave_n[line] / hose_area_m2,
            ]
        });
        [first, second.map(|pressure| -pressure)]
    }
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
