//! How often chance gives as much: machines that are as the model says, each with disturbances of
//! its own, searched whole.
//!
//! A threshold on what an effect gains holds for the records on which it was found good. What
//! chance gains depends on the movement, on how much repeats differ by, and on how many candidates
//! there are; so it is asked of records like these (a parametric bootstrap over the whole search).
//! Each such machine is driven along the same movement in closed loop, pushed by torques whose
//! course is that of what repeats differ by and whose size makes its innovations as large as
//! theirs, and read by the same encoders.

use nalgebra::{Matrix2, Vector2};
use plant::transmission::{Input, Transmission as _};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::fit::View;
use super::judge::{Judged, repeat_differences};
use super::machine::{Channel, Machine, OBSERVER_RAD_S, Parts, Placed, Setting};
use super::prune::twin;
use super::record::{Record, repeats, rms};
use super::search::{Found, search};
use super::sensor::{advanced, hand_torque, shown};

/// How the motor is driven along a measured movement.
#[derive(Clone, Copy, Debug)]
pub struct Drive {
    /// Volts for each radian that the model's master stays behind (V/rad).
    pub position_gain: f64,
    /// The same of its speed (V·s/rad).
    pub velocity_gain: f64,
    /// Most volts (V).
    pub volts_max: f64,
}

/// What machines without an effect gave.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chance {
    /// In how many something was found that is not there, with a name or without.
    pub alarms: usize,
    /// Of each that was searched, the largest gain of a name that it should not have got; 0 where
    /// there was none. Those that could not be simulated along their records are not among them.
    pub gains: Vec<f64>,
}

impl Chance {
    /// How many were searched.
    pub const fn machines(&self) -> usize {
        self.gains.len()
    }

    /// Probability of so large a gain without the effect: the machines that gave as much and the
    /// one at hand, of all.
    pub fn probability(&self, gain: f64) -> f64 {
        (1 + self.as_much(gain)) as f64 / (1 + self.machines()) as f64
    }

    /// How many gave as much.
    pub fn as_much(&self, gain: f64) -> usize {
        self.gains.iter().filter(|own| **own >= gain).count()
    }
}

/// How hard a machine is pushed for each radian of what repeats differ by: at the motor (V/rad) and
/// at the slave (N·m/rad).
type Sizes = [f64; 2];
/// What repeats differ by, course by course, of each channel.
type Courses = Vec<(Channel, Vec<Vec<f64>>)>;

/// A machine that is as a setting says.
struct Null<'a> {
    machine: &'a Machine,
    setting: Setting,
    drive: Drive,
    courses: Courses,
    /// Whether positions are rounded to counts: where that alone makes more than what repeats
    /// differ by, rows were averaged.
    rounded: [bool; 2],
}

/// Corner of the filter on the speed that the drive takes, as the rig's control has one (Hz):
/// counts are not to shake the motor.
const SPEED_FILTER_HZ: f64 = 40.0;
/// Largest correction of a push's size once it was tried, either way (1).
const CORRECTION: f64 = 3.0;
/// Hardest push, in units of the first try (1).
const HARDEST: f64 = 10.0;

/// Searches so many machines that have all effects found but the last; all records of each are new.
/// `None` where not even the pushes can be found.
pub fn chance(
    machine: &Machine,
    found: &Found,
    drive: Drive,
    machines: usize,
    seed: u64,
) -> Option<Chance> {
    let mut null = Null::new(machine, found, drive)?;
    let sizes = null.sizes()?;
    let there = |added: &Judged| {
        let is = |placed: &Placed| {
            placed.id == added.id
                && (placed.site == added.site || twin((placed.id, placed.site)) == Some(added.site))
        };
        null.setting.placed.iter().any(is)
    };
    let mut chance = Chance::default();
    for turn in 0..machines {
        let other = null.played(sizes, seed.wrapping_add(turn as u64 + 1));
        let Some(found) = other.and_then(|mut other| search(&mut other)) else { continue };
        let wrong = found.steps.iter().map(|step| &step.added).filter(|added| !there(added));
        let gain = wrong.map(|added| added.gain).fold(0.0, f64::max);
        chance.alarms += usize::from(gain > 0.0 || found.nameless.is_some() || found.inadequate);
        chance.gains.push(gain);
    }
    Some(chance)
}

/// One such machine, and the setting that made it. `None` where it cannot be simulated.
pub fn redrawn(
    machine: &Machine,
    found: &Found,
    drive: Drive,
    seed: u64,
) -> Option<(Machine, Setting)> {
    let mut null = Null::new(machine, found, drive)?;
    let sizes = null.sizes()?;
    let played = null.played(sizes, seed)?;
    Some((played, null.setting))
}

/// What repeats of a movement differ by, over √2; where none is repeated, what the model leaves.
fn courses(machine: &Machine, setting: &Setting) -> Option<Courses> {
    let residuals = View::whole(machine).residuals(setting)?;
    let pairs = repeats(&machine.records);
    let courses = [Channel::Master, Channel::Slave, Channel::Torque].map(|channel| {
        let mut of = repeat_differences(machine, &pairs, &residuals, channel);
        if of.is_empty() {
            let own = |(index, residual)| machine.channel_of(index, residual, channel).cloned();
            of = residuals.iter().enumerate().filter_map(own).collect();
        }
        of.retain(|course| course.len() > 1);
        (channel, of)
    });
    Some(courses.into_iter().filter(|(_, of)| !of.is_empty()).collect())
}

impl<'a> Null<'a> {
    fn new(machine: &'a Machine, found: &Found, drive: Drive) -> Option<Self> {
        let mut setting = found.last().setting.clone();
        setting.tables.clear();
        setting.placed.pop();
        let courses = courses(machine, &found.last().setting)?;
        Some(Self { machine, setting, drive, courses, rounded: [true; 2] })
    }
}

impl Null<'_> {
    /// Root mean square of what repeats differ by.
    fn target(&self, channel: Channel) -> Option<f64> {
        let (_, courses) = self.courses.iter().find(|(own, _)| *own == channel)?;
        Some(rms(courses.iter().flatten().copied()))
    }

    /// How large the pushes are for the machine's innovations to be as large as what repeats differ
    /// by. Each side's push shows in both channels, so that three machines are asked: one left
    /// alone, and one pushed at each side.
    fn sizes(&mut self) -> Option<Sizes> {
        // What the observer pulls with: a torque of that size shows about as large as what it is
        // made of.
        let pull_nm = self.machine.declared.slave_inertia_kg_m2() * OBSERVER_RAD_S * OBSERVER_RAD_S;
        let probe: Sizes = [pull_nm / self.machine.declared.motor_torque_per_volt_nm(), pull_nm];
        let mut alone = self.left([0.0; 2])?;
        let targets = [Channel::Master, Channel::Slave]
            .map(|channel| self.target(channel).unwrap_or(0.0).powi(2));
        for side in 0..2 {
            self.rounded[side] = alone[side] < targets[side];
        }
        if self.rounded.contains(&false) {
            alone = self.left([0.0; 2])?;
        }
        let pushed = [self.left([probe[0], 0.0])?, self.left([0.0, probe[1]])?];
        let shown =
            Matrix2::from_fn(|channel, side| (pushed[side][channel] - alone[channel]).max(0.0));
        let lacking = Vector2::from_fn(|channel, _| (targets[channel] - alone[channel]).max(0.0));
        let squares = not_negative(shown, lacking);
        let first = [0, 1].map(|side| probe[side] * squares[side].sqrt().min(HARDEST));
        // What sticks does not answer in proportion: once more, each side by its own channel.
        let now = self.left(first)?;
        Some([0, 1].map(|side| {
            let answered = now[side] - alone[side];
            let factor = if answered > 0.0 { (lacking[side] / answered).sqrt() } else { 1.0 };
            first[side] * factor.clamp(1.0 / CORRECTION, CORRECTION)
        }))
    }

    /// Mean square of what the model leaves of such a machine's records, master and slave.
    fn left(&self, sizes: Sizes) -> Option<[f64; 2]> {
        let played = self.played(sizes, 0)?;
        let residuals = View::whole(&played).residuals(&self.setting)?;
        let of = |channel: Channel| {
            let own = |(index, residual)| played.channel_of(index, residual, channel);
            let rows = residuals.iter().enumerate().filter_map(own);
            rms(rows.flatten().copied()).powi(2)
        };
        Some([of(Channel::Master), of(Channel::Slave)])
    }

    /// New records of such a machine, in place of those that were measured.
    fn played(&self, sizes: Sizes, seed: u64) -> Option<Machine> {
        let mut generator = Pcg64Mcg::seed_from_u64(seed ^ 0x6368_616e_6365);
        let mut played = self.machine.clone();
        for record in &mut played.records {
            let noises = [Channel::Master, Channel::Slave, Channel::Torque]
                .map(|channel| self.course(channel, record, &mut generator));
            *record = self.record(record, sizes, &noises)?;
        }
        Some(played)
    }

    /// A course for all rows of a record: one of those that there are, from any place on, either
    /// way up; nothing where there is none. Pushes come and go between its values; the cell's noise
    /// keeps each as long as it is the mean of, or the means would be smaller.
    fn course(&self, channel: Channel, record: &Record, generator: &mut Pcg64Mcg) -> Vec<f64> {
        let rows = record.volts.len();
        let Some((_, courses)) = self.courses.iter().find(|(own, _)| *own == channel) else {
            return vec![0.0; rows];
        };
        let course = &courses[generator.random_range(0..courses.len())];
        let from = generator.random_range(0..course.len());
        let sign = if generator.random::<bool>() { 1.0 } else { -1.0 };
        let width = record.decimation();
        let at = |block: usize| sign * course[(from + block) % course.len()];
        (0..rows)
            .map(|row| {
                let (block, part) = (row / width, (row % width) as f64 / width as f64);
                if channel == Channel::Torque {
                    at(block)
                } else {
                    at(block) * (1.0 - part) + at(block + 1) * part
                }
            })
            .collect()
    }

    fn record(&self, measured: &Record, sizes: Sizes, noises: &[Vec<f64>; 3]) -> Option<Record> {
        let Parts { mut in_plant, mut on_torque, late, late_s } = self.setting.parts()?;
        in_plant.extend(late);
        let mut plant = self
            .machine
            .constants(&self.setting)?
            .plant(in_plant)
            .ok()?
            .with_longest_step(measured.step_s);
        let zero = self.machine.slave_zero_rad(&self.setting);
        let dt = measured.step_s;
        plant.rest_at(measured.master[0], measured.slave.as_ref().map(|slave| slave[0] - zero));
        plant.set_time(measured.start_s);
        let (late_hand, _) = hand_torque(measured, &mut on_torque, &[]);
        let late = late_s / dt;
        let hand = advanced(&late_hand, late);
        let counted = |position: f64, side: usize| {
            let count = measured.count_rad[side];
            if self.rounded[side] && count > 0.0 {
                (position / count).round() * count
            } else {
                position
            }
        };
        let mut new = Record { turned: Vec::new(), ..measured.clone() };
        let (mut behind, mut speed) = (0.0, 0.0);
        let share = dt / (dt + 1.0 / (std::f64::consts::TAU * SPEED_FILTER_HZ));
        for row in 0..measured.volts.len() {
            let reading = plant.reading();
            let mut off = 0.0;
            // Before that the instruments have nothing to show yet, and what was measured stays.
            if row as f64 >= late {
                new.master[row] = counted(reading.master_rad, 0);
                if let Some(slave) = &mut new.slave {
                    slave[row] = counted(reading.slave_rad + zero, 1);
                }
                off = measured.master[row] - reading.master_rad;
            }
            speed += share * ((off - behind) / dt - speed);
            behind = off;
            let volts = measured.volts[row]
                + self.drive.position_gain * off
                + self.drive.velocity_gain * speed;
            new.volts[row] = volts.clamp(-self.drive.volts_max, self.drive.volts_max);
            plant.step(
                Input {
                    motor_v: new.volts[row] + sizes[0] * noises[0][row],
                    hand_torque_nm: hand[row] + sizes[1] * noises[1][row],
                },
                dt,
            );
            if !plant.reading().master_rad.is_finite() {
                return None;
            }
            if measured.torque.is_some() {
                // The cell shows the hand; the push is nobody's.
                let cell_nm = shown(&new, &mut on_torque, row, late_hand[row]) + noises[2][row];
                if let Some(torque) = &mut new.torque {
                    torque[row] = cell_nm;
                }
            }
        }
        Some(new)
    }
}

/// Solves two equations for numbers of which none is negative: where one would be, it is 0, and the
/// other is what serves both best.
fn not_negative(matrix: Matrix2<f64>, right: Vector2<f64>) -> Vector2<f64> {
    if let Some(whole) =
        matrix.lu().solve(&right).filter(|whole| whole.iter().all(|value| *value >= 0.0))
    {
        return whole;
    }
    let single = |side: usize| {
        let column = matrix.column(side);
        let mut only = Vector2::zeros();
        only[side] = (column.dot(&right) / column.norm_squared().max(f64::MIN_POSITIVE)).max(0.0);
        only
    };
    let misses = |solution: &Vector2<f64>| (matrix * solution - right).norm();
    let (first, second) = (single(0), single(1));
    if misses(&first) <= misses(&second) { first } else { second }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_probability_counts_the_machine_at_hand() {
        let chance = Chance { alarms: 2, gains: [vec![0.0; 17], vec![0.3, 0.5]].concat() };
        assert!((chance.probability(0.6) - 0.05).abs() < 1e-12);
        assert!((chance.probability(0.4) - 0.1).abs() < 1e-12);
        assert_eq!(chance.as_much(0.3), 2);
    }

    #[test]
    fn two_equations_are_solved_where_nothing_would_be_negative() {
        let matrix = Matrix2::new(2.0, 1.0, 1.0, 3.0);
        let solution = not_negative(matrix, Vector2::new(5.0, 10.0));
        assert!((solution - Vector2::new(1.0, 3.0)).norm() < 1e-9);
        // A side that does not show at all is not pushed.
        let blind = Matrix2::new(0.0, 1.0, 0.0, 2.0);
        assert!(
            (not_negative(blind, Vector2::new(2.0, 4.0)) - Vector2::new(0.0, 2.0)).norm() < 1e-9
        );
        // The first alone would have to be negative.
        let solution = not_negative(matrix, Vector2::new(0.0, 10.0));
        assert_eq!(solution[0], 0.0);
        assert!((solution[1] - 3.0).abs() < 1e-9, "{solution}");
    }
}
