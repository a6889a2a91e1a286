//! Nonparametric effects: piecewise-linear functions of one variable, inserted into the plant where
//! they would act.
//!
//! If one of them explains held-out records that no listed effect does, an unlisted effect is
//! missing, and the function shows its shape.

use plant::ParameterSet;
use plant::effects::{Effect, Identity, Link, Moment, Side, SideLoad, Site};

/// What a function depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Variable {
    /// Position of the side (rad).
    Position,
    /// Its speed (rad/s).
    Velocity,
    /// Its acceleration (rad/s²).
    Acceleration,
    /// Torque that the line transmits to it, or that the sensor shows (N·m).
    Torque,
    /// Time (s).
    Time,
    /// Amplifier voltage (V).
    Voltage,
    /// Amplifier voltage, with a sign that follows its direction of change through a play (V).
    VoltageTurning,
    /// Low-passed magnitude of the voltage (V).
    VoltageMean,
    /// Deflection of a line's spring: fluid against piston (m).
    Deflection,
    /// Force of a line, positive in compression (N).
    Force,
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
            Self::VoltageTurning => "voltage_turning",
            Self::VoltageMean => "voltage_mean",
            Self::Deflection => "deflection",
            Self::Force => "force",
        }
    }
}

/// Sites and variables of the functions tried. At the drive, functions of speed and position scale
/// the motor torque (an additive torque would belong to the master). At the line the function is a
/// force (N); of a line's force it is a creep speed (m/s), at both ends of the line or at master or
/// slave only. At the sensor it is an additive error of the torque (N·m).
pub const PLACES: [(Site, &[Variable]); 5] = {
    use Variable::{
        Acceleration, Deflection, Force, Position, Time, Torque, Velocity, Voltage, VoltageMean,
        VoltageTurning,
    };
    [
        (Site::Drive, &[Voltage, VoltageTurning, VoltageMean, Velocity, Position]),
        (Site::Master, &[Position, Velocity, Torque, Force, Time]),
        (Site::Line, &[Deflection, Velocity, Force]),
        (Site::Slave, &[Position, Velocity, Torque, Force, Time]),
        (Site::Sensor, &[Torque, Position, Velocity, Acceleration]),
    ]
};

/// Width of the play (V).
const TURN_V: f64 = 0.4;
/// Time constant of the low-pass of the magnitude (s).
const MEAN_S: f64 = 0.2;

/// Nodes of a function.
pub const NODES: usize = 21;

/// A piecewise linear function of one variable, evenly spaced, constant beyond its ends.
#[derive(Clone, Debug, PartialEq)]
pub struct PiecewiseLinear {
    /// Where it acts.
    pub site: Site,
    /// What it depends on.
    pub variable: Variable,
    /// The variable at the first node.
    pub low: f64,
    /// The variable at the last node.
    pub high: f64,
    /// Values at the nodes: N·m; N or m/s at the line; a dimensionless share at the drive for
    /// speed, position and voltage mean.
    pub values: [f64; NODES],
    /// Voltage of the current step (V).
    volts: f64,
    /// State of the play, -1 to 1.
    turned: f64,
    /// Low-passed magnitude (V).
    mean: f64,
    /// Creep, by line and end (m).
    crept_m: [[f64; 2]; 2],
}

impl PiecewiseLinear {
    /// Returns the zero function between `low` and `high`.
    pub fn new((site, variable): (Site, Variable), low: f64, high: f64) -> Self {
        Self {
            site,
            variable,
            low,
            high,
            values: [0.0; NODES],
            volts: 0.0,
            turned: 0.0,
            mean: 0.0,
            crept_m: [[0.0; 2]; 2],
        }
    }

    /// Returns the variable at a node.
    pub fn at(&self, node: usize) -> f64 {
        self.low + (self.high - self.low) * node as f64 / (NODES - 1) as f64
    }

    /// Evaluates the function.
    pub fn value(&self, x: f64) -> f64 {
        let place = ((x - self.low) / (self.high - self.low) * (NODES - 1) as f64)
            .clamp(0.0, (NODES - 1) as f64);
        if place.is_nan() {
            return 0.0;
        }
        let node = (place as usize).min(NODES - 2);
        let part = place - node as f64;
        self.values[node] * (1.0 - part) + self.values[node + 1] * part
    }
}

impl Identity for PiecewiseLinear {
    fn id(&self) -> &'static str {
        "nonparametric"
    }

    fn site(&self) -> Site {
        self.site
    }
}

impl Effect for PiecewiseLinear {
    fn amplifier(&mut self, volts: f64, moment: &Moment) -> f64 {
        self.turned = (self.turned + (volts - self.volts) / TURN_V).clamp(-1.0, 1.0);
        self.mean += (volts.abs() - self.mean) * (moment.step_s / MEAN_S).min(1.0);
        self.volts = volts;
        volts
    }

    fn motor(&mut self, torque_nm: f64, moment: &Moment) -> f64 {
        match self.variable {
            Variable::Voltage => torque_nm + self.value(self.volts),
            Variable::VoltageTurning => torque_nm + self.turned * self.value(self.volts),
            Variable::VoltageMean => torque_nm * (1.0 + self.value(self.mean)),
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
            _ => return,
        };
        load.load.force += self.value(x);
    }

    fn deflect(&mut self, link: &mut Link, _moment: &Moment) {
        link.deflection_m -= self.crept_m[link.line][link.end as usize];
    }

    fn link(&mut self, link: &mut Link, moment: &Moment) {
        if self.variable == Variable::Force {
            let here = match self.site {
                Site::Master => link.end == Side::Master,
                Site::Slave => link.end == Side::Slave,
                _ => true,
            };
            if !here {
                return;
            }
            let pressed = pressed(link);
            let rate = pressed * self.value(pressed * link.force_n);
            self.crept_m[link.line][link.end as usize] += moment.step_s * rate;
            return;
        }
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

/// Sign of a link's force in compression: the first line is compressed while the slave is driven
/// forward, the second while it is driven backward.
fn pressed(link: &Link) -> f64 {
    let of_end = if link.end == Side::Slave { 1.0 } else { -1.0 };
    if link.line == 0 { of_end } else { -of_end }
}

/// Its values are not plant parameters: the fit varies them as nodes.
impl ParameterSet for PiecewiseLinear {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_linear_between_nodes_and_constant_beyond() {
        let mut table = PiecewiseLinear::new((Site::Slave, Variable::Position), -1.0, 1.0);
        table.values[0] = 2.0;
        table.values[1] = 1.0;
        assert_eq!(table.at(0), -1.0);
        assert_eq!(table.value(-5.0), 2.0);
        assert!((table.value(-0.95) - 1.5).abs() < 1e-12);
        assert_eq!(table.value(f64::NAN), 0.0);
        assert_eq!(table.value(3.0), 0.0);
    }

    fn level(place: (Site, Variable), value: f64) -> PiecewiseLinear {
        let mut table = PiecewiseLinear::new(place, 0.0, 10.0);
        table.values = [value; NODES];
        table
    }

    fn moment(step_s: f64) -> Moment {
        Moment { step_s, ..Moment::default() }
    }

    #[test]
    fn a_function_of_voltage_with_play_follows_reversals() {
        let mut table = level((Site::Drive, Variable::VoltageTurning), 0.3);
        let mut after = |volts: &[f64]| {
            for volts in volts {
                table.amplifier(*volts, &moment(1e-3));
            }
            table.motor(1.0, &moment(1e-3))
        };
        assert!((after(&[0.5, 2.0]) - 1.3).abs() < 1e-12);
        // Halfway through the play, and past it.
        assert!((after(&[2.0 - TURN_V]) - 1.0).abs() < 1e-12);
        assert!((after(&[1.0]) - 0.7).abs() < 1e-12);
    }

    #[test]
    fn the_mean_voltage_decays() {
        let mut table = level((Site::Drive, Variable::VoltageMean), 0.0);
        for (node, value) in table.values.iter_mut().enumerate() {
            *value = -0.5 * node as f64 / (NODES - 1) as f64;
        }
        for _ in 0..5000 {
            table.amplifier(-4.0, &moment(1e-3));
        }
        assert!((table.motor(2.0, &moment(1e-3)) - 2.0 * (1.0 - 0.2)).abs() < 1e-6);
        for _ in 0..5000 {
            table.amplifier(0.0, &moment(1e-3));
        }
        assert!((table.motor(2.0, &moment(1e-3)) - 2.0).abs() < 1e-6);
    }

    fn link(line: usize, end: Side, force_n: f64) -> Link {
        Link {
            end,
            line,
            stiffness_n_per_m: 1e4,
            damping_n_s_per_m: 0.0,
            displacement_m_per_rad: 0.05,
            deflection_m: 0.0,
            rate_m_s: 0.0,
            fluid_position_m: 0.0,
            fluid_velocity_m_s: 0.0,
            force_n,
            fluid_force_n: force_n,
            fluid_damping_n_s_per_m: 0.0,
        }
    }

    #[test]
    fn a_line_creeps_in_compression_at_the_ends_of_its_site() {
        for (site, master_gives) in [(Site::Line, true), (Site::Slave, false)] {
            // Creeps in compression by 0.01 m/s, and not in tension.
            let mut table = PiecewiseLinear::new((site, Variable::Force), -10.0, 10.0);
            for node in NODES / 2 + 1..NODES {
                table.values[node] = 0.01;
            }
            let crept = |table: &mut PiecewiseLinear, line: usize, end: Side, force_n: f64| {
                let mut now = link(line, end, force_n);
                table.deflect(&mut now, &moment(1e-3));
                let before = now.deflection_m;
                table.link(&mut now, &moment(1e-3));
                assert_eq!(now.force_n, force_n);
                let mut after = link(line, end, force_n);
                table.deflect(&mut after, &moment(1e-3));
                after.deflection_m - before
            };
            // Driving the slave forward compresses the first line.
            assert!((crept(&mut table, 0, Side::Slave, 5.0) + 1e-5).abs() < 1e-12);
            assert_eq!(crept(&mut table, 0, Side::Slave, -5.0), 0.0);
            assert!((crept(&mut table, 1, Side::Slave, -5.0) - 1e-5).abs() < 1e-12);
            let master = crept(&mut table, 0, Side::Master, -5.0);
            assert!(
                (master - if master_gives { 1e-5 } else { 0.0 }).abs() < 1e-12,
                "{site:?}: {master}"
            );
        }
    }
}
