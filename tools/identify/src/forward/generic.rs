//! Torques that have no name: functions of one variable, put into the plant where they would act.
//!
//! Where one of them explains on held-out records what no listed effect does, something unlisted is missing, and the function is what it
//! looks like.

use plant::effects::{Effect, Link, Moment, SideLoad, Site};
use plant::{ParameterError, ParameterInfo, ParameterSet};

/// What a function depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Variable {
    /// Position of the side (rad).
    Position,
    /// Its speed (rad/s).
    Velocity,
    /// Its acceleration (rad/s²).
    Acceleration,
    /// Torque that the line transmits to it, or that a cell shows (N·m).
    Torque,
    /// Time (s).
    Time,
    /// Volts at the amplifier (V).
    Voltage,
    /// How far a line's fluid stands off the piston (m).
    Deflection,
}

impl Variable {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Torque => "torque",
            Self::Time => "time",
            Self::Voltage => "voltage",
            Self::Deflection => "deflection",
        }
    }

    /// Its unit.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Position => "rad",
            Self::Velocity => "rad/s",
            Self::Acceleration => "rad/s²",
            Self::Torque => "N·m",
            Self::Time => "s",
            Self::Voltage => "V",
            Self::Deflection => "m",
        }
    }
}

/// Where functions are tried, and of what. At the drive, those of speed and position are a share of the motor's torque: beside it, a torque
/// that depends on them is the master's. At the line it is a force (N), at the sensor what the torque cell shows too much (N·m).
pub const PLACES: [(Site, Variable); 17] = [
    (Site::Drive, Variable::Voltage),
    (Site::Drive, Variable::Velocity),
    (Site::Drive, Variable::Position),
    (Site::Master, Variable::Position),
    (Site::Master, Variable::Velocity),
    (Site::Master, Variable::Torque),
    (Site::Master, Variable::Time),
    (Site::Line, Variable::Deflection),
    (Site::Line, Variable::Velocity),
    (Site::Slave, Variable::Position),
    (Site::Slave, Variable::Velocity),
    (Site::Slave, Variable::Torque),
    (Site::Slave, Variable::Time),
    (Site::Sensor, Variable::Torque),
    (Site::Sensor, Variable::Position),
    (Site::Sensor, Variable::Velocity),
    (Site::Sensor, Variable::Acceleration),
];

/// Nodes of a function.
pub const NODES: usize = 21;

/// A piecewise linear function of one variable, evenly spaced, constant beyond its ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Where it acts.
    pub site: Site,
    /// What it depends on.
    pub variable: Variable,
    /// The variable at the first node.
    pub low: f64,
    /// The variable at the last node.
    pub high: f64,
    /// Values at the nodes: N·m; N at the line, a share at the drive where it goes by speed or position.
    pub values: [f64; NODES],
    /// Volts of the present step.
    volts: f64,
}

impl Table {
    /// A function that is 0 everywhere between `low` and `high`.
    pub fn new((site, variable): (Site, Variable), low: f64, high: f64) -> Self {
        Self { site, variable, low, high, values: [0.0; NODES], volts: 0.0 }
    }

    /// The variable at a node.
    pub fn at(&self, node: usize) -> f64 {
        self.low + (self.high - self.low) * node as f64 / (NODES - 1) as f64
    }

    /// The function.
    pub fn value(&self, x: f64) -> f64 {
        let place = ((x - self.low) / (self.high - self.low) * (NODES - 1) as f64).clamp(0.0, (NODES - 1) as f64);
        if place.is_nan() {
            return 0.0;
        }
        let node = (place as usize).min(NODES - 2);
        let part = place - node as f64;
        self.values[node] * (1.0 - part) + self.values[node + 1] * part
    }
}

impl Effect for Table {
    fn id(&self) -> &'static str {
        "generic"
    }

    fn site(&self) -> Site {
        self.site
    }

    fn amplifier(&mut self, volts: f64, _moment: &Moment) -> f64 {
        self.volts = volts;
        volts
    }

    fn motor(&mut self, torque_nm: f64, moment: &Moment) -> f64 {
        match self.variable {
            Variable::Voltage => torque_nm + self.value(self.volts),
            Variable::Velocity => torque_nm * (1.0 + self.value(moment.master_velocity_rad_s)),
            Variable::Position => torque_nm * (1.0 + self.value(moment.master_position_rad)),
            _ => torque_nm,
        }
    }

    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let x = match self.variable {
            Variable::Position => load.position_rad,
            Variable::Velocity => load.velocity_rad_s,
            Variable::Torque => load.transmitted_nm,
            Variable::Time => moment.time_s,
            Variable::Voltage | Variable::Deflection | Variable::Acceleration => return,
        };
        load.load.force += self.value(x);
    }

    fn link(&mut self, link: &mut Link, _moment: &Moment) {
        let x = match (self.site, self.variable) {
            (Site::Line, Variable::Deflection) => link.deflection_m,
            (Site::Line, Variable::Velocity) => link.fluid_velocity_m_s,
            _ => return,
        };
        let force = self.value(x);
        if self.variable == Variable::Deflection {
            link.force_n += force;
        }
        link.fluid_force_n += force;
    }
}

/// Its values are moved one by one by whoever fits it.
impl ParameterSet for Table {
    fn infos(&self) -> &'static [ParameterInfo] {
        &[]
    }

    fn get(&self, _name: &str) -> Option<f64> {
        None
    }

    fn set(&mut self, name: &str, _value: f64) -> Result<(), ParameterError> {
        Err(ParameterError::Unknown { name: name.to_owned(), known: String::new() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_straight_between_nodes_and_level_beyond() {
        let mut table = Table::new((Site::Slave, Variable::Position), -1.0, 1.0);
        table.values[0] = 2.0;
        table.values[1] = 1.0;
        assert_eq!(table.at(0), -1.0);
        assert_eq!(table.value(-5.0), 2.0);
        assert!((table.value(-0.95) - 1.5).abs() < 1e-12);
        assert_eq!(table.value(f64::NAN), 0.0);
        assert_eq!(table.value(3.0), 0.0);
    }
}
