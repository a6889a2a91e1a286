//! What goes into the plant and what comes out.

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
    /// Position and speed `part` of the way (0 to 1) along the cubic that leads here from another position and speed.
    pub(crate) fn approach(self, from: f64, speed_from: f64, duration: f64, part: f64) -> (f64, f64) {
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
    /// Force of each line on the master piston's coordinate, `F_m` of eq. 3.1.9, N (in the hose's cross section), at the
    /// middle of the last internal step.
    pub line_force_master_n: [f64; 2],
    /// Force of each line on the slave, `F_s`, N.
    pub line_force_slave_n: [f64; 2],
    /// Torque that the motor applied, N·m; under imposed motion the torque that it took.
    pub motor_torque_nm: f64,
    /// Torque of both lines on the slave, N·m.
    pub transmitted_torque_nm: f64,
}

impl State {
    /// Pressure change against the pressure at rest, Pa: of each line, at the master's and at the slave's end.
    ///
    /// `dP = F/A` (eq. 3.1.5). Line 2 returns, so its sign is the opposite of line 1's.
    pub fn line_pressure_pa(&self, hose_area_m2: f64) -> [[f64; 2]; 2] {
        let [first, second] = [0, 1]
            .map(|line| [-self.line_force_master_n[line] / hose_area_m2, self.line_force_slave_n[line] / hose_area_m2]);
        [first, second.map(|pressure| -pressure)]
    }
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
    /// Taken by effects that are not friction (a nonlinear spring's share, a hand, gravity, a disturbance), J.
    pub effects_j: f64,
    /// Magnitude of all work of motor and hand, J: the scale against which the balance is read.
    pub throughput_j: f64,
}

impl EnergyBalance {
    /// What the balance leaves open, J; the integrator's error.
    pub fn defect_j(&self) -> f64 {
        self.input_j - self.stored_j - self.dissipated_j - self.effects_j
    }
}
