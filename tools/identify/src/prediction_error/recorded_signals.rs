//! Signals of a record on which an unmodelled torque may depend, row by row.

use plant::effects::Site;

use super::motion::Motion;
use super::record::{Record, rms};

/// Speed within which the direction of motion passes through zero (rad/s).
const SLOW_RAD_S: f64 = 0.2;
/// The same for the direction in which another signal changes, relative to its rms rate.
const SLOW_SHARE: f64 = 0.2;
/// Speed below which a side counts as at rest (rad/s).
const REST_RAD_S: f64 = 0.1;

/// A quantity of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// Position of the side (rad); in the line, the mean of both sides.
    Position,
    /// Its speed (rad/s).
    Velocity,
    /// Its acceleration (rad/s²).
    Acceleration,
    /// Position of the master less that of the slave (rad), which is proportional to the force of
    /// the lines.
    Twist,
    /// Reading of the torque sensor (N·m); 0 without a hand.
    Torque,
    /// Time for which the side has been at rest (s); 0 while it moves.
    Rest,
    /// Time (s).
    Time,
}

/// The sign of a value, with a smooth passage through zero.
fn direction(value: f64, range: f64) -> f64 {
    (value / range.max(f64::MIN_POSITIVE)).tanh()
}

/// The signals of one record.
pub struct RecordedSignals {
    start_s: f64,
    step_s: f64,
    master: Motion,
    slave: Motion,
    middle: Motion,
    torque: Vec<f64>,
}

impl RecordedSignals {
    /// The signals of a record; `slave_zero_rad` is the slave's position at encoder count 0. `None`
    /// without the slave's position.
    pub fn of(record: &Record, slave_zero_rad: f64) -> Option<Self> {
        let slave: Vec<f64> =
            record.slave.as_ref()?.iter().map(|position| position - slave_zero_rad).collect();
        let master = Motion::of(&record.master, record.step_s);
        let slave = Motion::of(&slave, record.step_s);
        let torque = record.torque.clone().filter(|_| !record.idle);
        Some(Self {
            start_s: record.start_s,
            step_s: record.step_s,
            middle: master.mean(&slave),
            torque: torque.unwrap_or_else(|| vec![0.0; record.volts.len()]),
            master,
            slave,
        })
    }

    const fn motion(&self, site: Site) -> &Motion {
        match site {
            Site::Master | Site::Drive => &self.master,
            Site::Line => &self.middle,
            Site::Slave | Site::Sensor => &self.slave,
        }
    }

    /// A signal at a site.
    pub fn column(&self, signal: Signal, site: Site) -> Vec<f64> {
        let motion = self.motion(site);
        match signal {
            Signal::Position => motion.position.clone(),
            Signal::Velocity => motion.velocity.clone(),
            Signal::Acceleration => motion.acceleration.clone(),
            Signal::Twist => {
                let both = self.master.position.iter().zip(&self.slave.position);
                both.map(|(master, slave)| master - slave).collect()
            }
            Signal::Torque => self.torque.clone(),
            Signal::Rest => {
                let mut rested_s = 0.0;
                let rested = motion.velocity.iter().map(|velocity| {
                    let rests = velocity.abs() < REST_RAD_S;
                    rested_s = if rests { rested_s + self.step_s } else { 0.0 };
                    rested_s
                });
                rested.collect()
            }
            Signal::Time => {
                let rows = 0..self.torque.len();
                rows.map(|row| self.start_s + row as f64 * self.step_s).collect()
            }
        }
    }

    /// Direction of motion at a site, -1 to 1.
    pub fn direction(&self, site: Site) -> Vec<f64> {
        let velocity = &self.motion(site).velocity;
        velocity.iter().map(|velocity| direction(*velocity, SLOW_RAD_S)).collect()
    }

    /// Direction in which a column changes, -1 to 1.
    pub fn change(&self, column: &[f64]) -> Vec<f64> {
        let rates = Motion::of(column, self.step_s).velocity;
        let range = SLOW_SHARE * rms(rates.iter().copied());
        rates.iter().map(|rate| direction(*rate, range)).collect()
    }

    /// The response `y` of a first-order lag to a column `x`, from rest: `T ẏ = x - y`.
    pub fn lagged(&self, column: &[f64], time_constant_s: f64) -> Vec<f64> {
        let part = -(-self.step_s / time_constant_s).exp_m1();
        let mut lagged = 0.0;
        let of = column.iter().map(|value| {
            lagged += part * (value - lagged);
            lagged
        });
        of.collect()
    }

    /// The torque per inertia of a mass on a spring at a site, `ω² (y - q)`, and its rate over `ω`:
    /// with both, a small error of `ω` and of the damping ratio `ζ` is linear.
    /// `ÿ = ω² (q - y) + 2 ζ ω (q̇ - ẏ)`, from rest.
    pub fn resonance(&self, site: Site, omega_rad_s: f64, damping_ratio: f64) -> [Vec<f64>; 2] {
        let motion = self.motion(site);
        let (mut position, mut speed) = (motion.position.first().copied().unwrap_or(0.0), 0.0);
        let mut columns = [Vec::new(), Vec::new()];
        for (own, own_speed) in motion.position.iter().zip(&motion.velocity) {
            let spring = omega_rad_s * omega_rad_s * (own - position);
            let damper = 2.0 * damping_ratio * omega_rad_s * (own_speed - speed);
            columns[0].push(-spring);
            columns[1].push(omega_rad_s * (speed - own_speed));
            speed += self.step_s * (spring + damper);
            position += self.step_s * speed;
        }
        columns
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equation_error::block_roles::Role;

    const STEP_S: f64 = 2e-3;

    /// A master at rest for 0.5 s and then turning at 2 rad/s, a slave with 3 rad/s².
    fn record() -> Record {
        let rows = 500;
        let time = |row: usize| row as f64 * STEP_S;
        Record {
            name: "record".to_owned(),
            start_s: 10.0,
            step_s: STEP_S,
            volts: vec![0.0; rows],
            master: (0..rows).map(|row| 2.0 * (time(row) - 0.5).max(0.0)).collect(),
            slave: Some((0..rows).map(|row| 0.1 + 1.5 * time(row).powi(2)).collect()),
            torque: Some(vec![0.7; rows]),
            sign_flipped: Vec::new(),
            role: Role::Fit,
            count_rad: [1e-3; 2],
            idle: false,
            others: Vec::new(),
            steps: 1,
            jumps: Default::default(),
        }
    }

    #[test]
    fn a_parabola_gives_its_derivatives() {
        let signals = RecordedSignals::of(&record(), 0.1).unwrap();
        let slave = |signal| signals.column(signal, Site::Slave)[300];
        assert!((slave(Signal::Position) - 1.5 * 0.36).abs() < 1e-9);
        assert!((slave(Signal::Velocity) - 3.0 * 0.6).abs() < 1e-9);
        assert!((slave(Signal::Acceleration) - 3.0).abs() < 1e-6);
        let twist = signals.column(Signal::Twist, Site::Line)[300];
        assert!((twist - (0.2 - 1.5 * 0.36)).abs() < 1e-9);
        assert_eq!(slave(Signal::Torque), 0.7);
        assert!((slave(Signal::Time) - 10.6).abs() < 1e-9);
    }

    #[test]
    fn time_at_rest_grows_until_the_side_moves() {
        let signals = RecordedSignals::of(&record(), 0.0).unwrap();
        let rest = signals.column(Signal::Rest, Site::Master);
        assert!((rest[200] - 201.0 * STEP_S).abs() < 1e-9);
        assert_eq!(rest[300], 0.0);
        assert_eq!(signals.direction(Site::Master)[100], 0.0);
        assert!(signals.direction(Site::Master)[400] > 0.99);
    }

    #[test]
    fn nothing_without_the_slave_and_no_torque_without_a_hand() {
        assert!(RecordedSignals::of(&Record { slave: None, ..record() }, 0.0).is_none());
        let idle = RecordedSignals::of(&Record { idle: true, ..record() }, 0.0).unwrap();
        assert_eq!(idle.column(Signal::Torque, Site::Sensor)[10], 0.0);
    }

    #[test]
    fn a_lag_approaches_and_a_mass_on_a_spring_follows() {
        let signals = RecordedSignals::of(&record(), 0.1).unwrap();
        let lagged = signals.lagged(&[1.0; 200], 0.1);
        let expected = 1.0 - (-100.0 * STEP_S / 0.1f64).exp();
        assert!((lagged[99] - expected).abs() < 1e-9, "{} {expected}", lagged[99]);
        // Once it has settled, the mass is accelerated with the slave.
        let [torque, _] = signals.resonance(Site::Slave, 20.0, 0.5);
        assert!((torque[450] + 3.0).abs() < 0.1, "{}", torque[450]);
    }

    #[test]
    fn the_direction_of_change_is_relative_to_the_typical_rate() {
        let signals = RecordedSignals::of(&record(), 0.0).unwrap();
        for size in [1e-6, 1.0, 1e6] {
            let column: Vec<f64> =
                (0..500).map(|row| size * (f64::from(row) / 40.0).sin()).collect();
            let change = signals.change(&column);
            assert!(change[5] > 0.9 && change[126] < -0.9, "{size}");
        }
    }
}
