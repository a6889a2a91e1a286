//! Interface of deviations from the declared machine.
//!
//! Deviations act on the equations in continuous time: every hook is a function of state and time,
//! and may have states of its own whose rates it returns. Hooks of the instruments are called once
//! per sample and may keep a memory.

use std::fmt;

use crate::machine_parameters::MachineParameters;
use crate::smoothing::Smoothing;

/// The state at a time.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Time since the start of the first record, s.
    pub time_s: f64,
    /// Time within the record, s.
    pub local_s: f64,
    /// Length of a sample, s.
    pub sample_s: f64,
    /// Commanded voltage of every sample of the record so far, V.
    pub volts: &'a [f64],
    /// Angle of master and slave, rad.
    pub position: [f64; 2],
    /// Their speed, rad/s.
    pub velocity: [f64; 2],
    /// Speed of the fluid in either line, m/s.
    pub fluid_velocity: [f64; 2],
}

impl View<'_> {
    /// At rest at the start.
    pub fn at_rest() -> Self {
        Self {
            time_s: 0.0,
            local_s: 0.0,
            sample_s: 1.0,
            volts: &[],
            position: [0.0; 2],
            velocity: [0.0; 2],
            fluid_velocity: [0.0; 2],
        }
    }
}

/// Spring and damper between the fluid of a line and the piston at one of its ends (eq. 3.1.9).
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// 0 at the master, 1 at the slave.
    pub side: usize,
    /// Line 0 or 1.
    pub line: usize,
    /// `2K`, N/m.
    pub stiffness_n_per_m: f64,
    /// `D`, N·s/m.
    pub damping_n_s_per_m: f64,
    /// `α r`, m/rad.
    pub displacement_m_per_rad: f64,
    /// Fluid less piston, m.
    pub deflection_m: f64,
    /// Its rate, m/s.
    pub rate_m_s: f64,
    /// Displacement of the fluid, m.
    pub fluid_position_m: f64,
    /// Force on the piston's coordinate, N.
    pub force_n: f64,
    /// Force against the fluid's coordinate, N.
    pub fluid_force_n: f64,
}

/// What acts on master or slave.
#[derive(Clone, Copy, Debug)]
pub struct Side {
    /// 0 master, 1 slave.
    pub side: usize,
    /// Angle, rad.
    pub position_rad: f64,
    /// Speed, rad/s.
    pub velocity_rad_s: f64,
    /// How dry friction passes through zero.
    pub smoothing: Smoothing,
    /// Torque of the lines, N·m.
    pub transmitted_nm: f64,
    /// Sum of the torques except for motor, hand and friction, N·m.
    pub torque_nm: f64,
    /// Magnitude of the dry friction against forward movement, N·m.
    pub dry_forward: f64,
    /// Against backward movement.
    pub dry_backward: f64,
    /// Declared dry friction at rest, N·m.
    pub dry_at_rest_nm: f64,
    /// Viscous coefficient of forward movement, N·m·s/rad.
    pub viscous_forward: f64,
    /// Of backward movement.
    pub viscous_backward: f64,
}

impl Side {
    /// Adds dry friction in both directions, N·m.
    pub fn add_dry(&mut self, level: f64) {
        self.dry_forward += level;
        self.dry_backward += level;
    }

    /// Adds viscous friction in both directions, N·m·s/rad.
    pub fn add_viscous(&mut self, coefficient: f64) {
        self.viscous_forward += coefficient;
        self.viscous_backward += coefficient;
    }

    /// Multiplies the dry friction, never to below zero.
    pub fn scale_dry(&mut self, factor: f64) {
        self.dry_forward *= factor.max(0.0);
        self.dry_backward *= factor.max(0.0);
    }
}

/// The quantities that the instruments measure at a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Instruments {
    /// Time on the run, s.
    pub time_s: f64,
    /// Voltage of the motor from this sample on, V.
    pub motor_v: f64,
    /// Angle of master and slave, rad.
    pub position: [f64; 2],
    /// Speed of the slave, rad/s.
    pub slave_velocity_rad_s: f64,
    /// Acceleration of the slave, rad/s².
    pub slave_acceleration_rad_s2: f64,
    /// Torque of the hand, N·m.
    pub torque_nm: f64,
}

/// A deviation. Hooks do nothing by default.
pub trait Deviation: fmt::Debug + Send {
    /// Number of states of its own; they start at zero.
    fn states(&self) -> usize {
        0
    }

    /// Changes the machine.
    fn alter(&self, _machine: &mut MachineParameters) {}

    /// Inertia that it adds to a side, kg·m².
    fn inertia(&self, _side: usize) -> f64 {
        0.0
    }

    /// Voltage after the amplifier from that before it.
    fn amplifier(&self, volts: f64, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) -> f64 {
        volts
    }

    /// The motor's torque (N·m) from the ideal one.
    fn motor(&self, torque_nm: f64, _view: &View<'_>) -> f64 {
        torque_nm
    }

    /// Changes a link's deflection before its force is computed.
    fn stretch(&self, _link: &mut Link, _view: &View<'_>, _own: &[f64]) {}

    /// Changes a link's force.
    fn link(&self, _link: &mut Link, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {}

    /// Loss of the fluid of a line over its speed, N·s/m.
    fn hose_loss(&self, _line: usize, loss: f64, _view: &View<'_>) -> f64 {
        loss
    }

    /// Changes what acts on a side.
    fn side(&self, _side: &mut Side, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {}

    /// Changes the angles that the encoders measure; called once per sample, in order, before the
    /// control law.
    fn sense_angles(&mut self, _seen: &mut Instruments) {}

    /// Changes the torque that the cell measures; called once per sample, in order, when the
    /// voltage of the sample is known.
    fn sense_torque(&mut self, _seen: &mut Instruments) {}
}
