//! Where a torque without a name enters the machine, whatever it depends on.
//!
//! A torque at one place moves master and slave in a proportion and with a delay of its own,
//! frequency by frequency. What they are is seen by adding a known torque there
//! ([`super::stimulus`]): friction, observer and all then answer as they do in the records. If what
//! is missing acts at that place alone, the residuals of master and slave hold that proportion too,
//! however it comes about; what they have beyond it, no torque at that place can explain. The share
//! of that is told for
//!
//! - a torque on the master: motor and amplifier act there as well, and cannot be told from it;
//! - a torque on the slave;
//! - a force on what moves in the lines;
//! - an error of the torque cell: a torque on the slave, but none while nobody is at the handle.
//!
//! Where none of them explains most of it, something acts on master and slave together, against one
//! another or one after the other: that is what the line does, and everything that gives way or
//! lets go between the two.

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::{Complex, Matrix2, Vector2};
use plant::effects::{Effect, Site};
use rayon::prelude::*;

use super::fit::View;
use super::generic::Variable;
use super::judge::repeat_differences;
use super::machine::{Channel, Machine, Residual, Setting};
use super::record::{repeats, rms};
use super::stimulus::{Stimulus, signs};
use crate::spectral::transform;

/// Rows of a stretch of which a spectrum is taken (about a second); half of it is another's too.
const STRETCH: usize = 256;
/// Fewest rows of a record that takes part: two stretches and a half of it would tell nothing.
const FEWEST_ROWS: usize = 2 * STRETCH;
/// Rows for which the known torque is held. Nothing of it is left at a third of the row rate, where
/// spectra end well before.
const HELD: usize = 3;
/// Highest bin that is looked at: the machine hardly answers beyond a quarter of the row rate.
const HIGHEST: usize = STRETCH / 4;
/// Size of the known torque in a first try, over the motor's.
const FIRST_TRY: f64 = 0.01;
/// Between which it is then changed, so that it shows as much as what is missing.
const LEAST_FACTOR: f64 = 1e-3;
/// See there.
const MOST_FACTOR: f64 = 1e3;
/// Share of what is left that no repeat needs to reach: records without any noise would be told by
/// their last digit.
const LEAST_NOISE: f64 = 1e-4;
/// A place explains what is missing where it leaves less than this share. Among effects of many
/// kinds torques at master and slave left 0.01 to 0.23 where they acted, and the nearest of the
/// other places 0.3 and more; what gives way between the two left 0.3 and more with each.
const CLEAR: f64 = 0.3;
/// An error of the cell explains less than a torque on the slave can, since it is not there while
/// nobody is at the handle: where it leaves no more than this beyond, it is one.
const AS_LITTLE: f64 = 0.05;

/// A place at which a torque can enter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The master, with the motor.
    Master,
    /// The slave.
    Slave,
    /// What moves in the lines.
    Line,
    /// The torque cell.
    Cell,
}

impl Place {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Master => "master",
            Self::Slave => "slave",
            Self::Line => "line",
            Self::Cell => "torque cell",
        }
    }
}

/// What a torque at each place leaves.
#[derive(Clone, Debug, PartialEq)]
pub struct Origin {
    /// Share of what is missing that no torque at the place explains, 0 to 1. The cell is left out
    /// where there are no records with a hand beside ones without: it cannot be told from the slave
    /// then.
    pub left: Vec<(Place, f64)>,
}

impl Origin {
    fn of(&self, place: Place) -> Option<f64> {
        self.left.iter().find(|(own, _)| *own == place).map(|(_, left)| *left)
    }

    /// Where it acts: of master and drive, the master.
    pub fn site(&self) -> Site {
        let best =
            [(Site::Master, Place::Master), (Site::Slave, Place::Slave), (Site::Line, Place::Line)]
                .into_iter()
                .filter_map(|(site, place)| Some((site, self.of(place)?)))
                .min_by(|a, b| a.1.total_cmp(&b.1));
        let cell = self.of(Place::Cell).unwrap_or(1.0);
        match best {
            Some((site, left)) if left.min(cell) >= CLEAR || site == Site::Line => Site::Line,
            Some((_, left)) if cell <= left + AS_LITTLE => Site::Sensor,
            Some((site, _)) => site,
            None => Site::Line,
        }
    }

    /// Whether an effect at a site may be what enters where this does. What acts on both sides may
    /// be anything.
    pub fn may_be_at(&self, site: Site) -> bool {
        match (self.site(), site) {
            (Site::Line, _) | (_, Site::Line) => true,
            (Site::Master, _) => matches!(site, Site::Master | Site::Drive),
            (Site::Slave, Site::Sensor) => self.of(Place::Cell).is_none(),
            (own, _) => own == site,
        }
    }

    /// Whether a function of such a variable, there, is a torque that enters where this one does.
    pub fn allows(&self, (site, variable): (Site, Variable)) -> bool {
        // What gives way by a line's force acts on both of its ends.
        let between = site == Site::Line || variable == Variable::Force;
        if self.site() == Site::Line { between } else { !between && self.may_be_at(site) }
    }
}

/// Spectra of master and slave together at the bins that are looked at: mean over stretches, and
/// how many they were.
struct Spectra {
    mean: Vec<Matrix2<Complex<f64>>>,
    stretches: f64,
}

/// Spectra of the stretches of a course, under a Hann window.
fn stretches(rows: &[f64]) -> Vec<Vec<Complex<f64>>> {
    let window: Vec<f64> = (0..STRETCH)
        .map(|row| 0.5 - 0.5 * (2.0 * PI * (row as f64 + 0.5) / STRETCH as f64).cos())
        .collect();
    let begins = (0..rows.len()).step_by(STRETCH / 2);
    let whole = begins.filter_map(|from| rows.get(from..from + STRETCH));
    whole
        .filter_map(|rows| {
            transform(rows.iter().zip(&window).map(|(row, weight)| row * weight).collect())
        })
        .collect()
}

/// Spectra of pairs of courses.
fn spectra<'a>(pairs: impl Iterator<Item = (&'a [f64], &'a [f64])>) -> Spectra {
    let mut mean = vec![Matrix2::zeros(); HIGHEST];
    let mut count = 0.0;
    for (master, slave) in pairs {
        for (master, slave) in stretches(master).iter().zip(stretches(slave)) {
            for (bin, sum) in mean.iter_mut().enumerate() {
                let both = Vector2::new(master[bin], slave[bin]);
                *sum += both * both.adjoint();
            }
            count += 1.0;
        }
    }
    let share = Complex::from(1.0 / f64::max(count, 1.0));
    Spectra { mean: mean.into_iter().map(|sum| sum * share).collect(), stretches: count }
}

/// How master and slave answer a known course, by bins.
fn answers<'a>(
    known: impl Iterator<Item = (&'a [f64], [Vec<f64>; 2])>,
) -> Vec<Vector2<Complex<f64>>> {
    let mut sums = vec![(Vector2::zeros(), 0.0); HIGHEST];
    for (cause, [master, slave]) in known {
        for ((cause, master), slave) in
            stretches(cause).iter().zip(stretches(&master)).zip(stretches(&slave))
        {
            for (bin, (sum, power)) in sums.iter_mut().enumerate() {
                *sum += Vector2::new(master[bin], slave[bin]) * cause[bin].conj();
                *power += cause[bin].norm_sqr();
            }
        }
    }
    let mean = |(sum, power): (Vector2<Complex<f64>>, f64)| {
        sum / Complex::from(power.max(f64::MIN_POSITIVE))
    };
    sums.into_iter().map(mean).collect()
}

/// What a machine's records leave, and the known torque that is added to them.
struct Listener<'a> {
    machine: &'a Machine,
    setting: &'a Setting,
    records: Vec<usize>,
    /// Residuals of those records.
    here: Vec<Residual>,
    /// Time from row to row (s).
    pace_s: f64,
    signs: Arc<[f64]>,
}

impl Listener<'_> {
    /// Residuals with a known torque at a site.
    fn with(&self, site: Site, size: f64) -> Option<Vec<Residual>> {
        let values: Arc<[f64]> = self.signs.iter().map(|sign| size * sign).collect();
        let one = |record: &usize| {
            let start_s = self.machine.records[*record].start_s;
            let stimulus =
                Stimulus::new(site, start_s, HELD as f64 * self.pace_s, Arc::clone(&values));
            self.machine.residual_beside(
                self.setting,
                *record,
                vec![Box::new(stimulus) as Box<dyn Effect>],
            )
        };
        self.records.par_iter().map(one).collect()
    }

    /// By how much a known torque changes the residuals: master and slave of every record.
    fn changes(&self, site: Site, size: f64) -> Option<Vec<[Vec<f64>; 2]>> {
        let of = |with: &Residual, here: &Residual, channel: usize| -> Vec<f64> {
            with.channels[channel]
                .iter()
                .zip(&here.channels[channel])
                .map(|(with, here)| with - here)
                .collect()
        };
        let with = self.with(site, size)?;
        Some(
            with.iter()
                .zip(&self.here)
                .map(|(with, here)| [of(with, here, 0), of(with, here, 1)])
                .collect(),
        )
    }

    /// The same of a torque that shows about as much as what is missing.
    fn answered(&self, site: Site) -> Option<Vec<[Vec<f64>; 2]>> {
        let declared = &self.machine.declared;
        let volts = self.records.iter().flat_map(|record| &self.machine.records[*record].volts);
        let torque_nm =
            FIRST_TRY * declared.motor_torque_per_volt_nm() * rms(volts.copied()).max(FIRST_TRY);
        let size = if site == Site::Line {
            torque_nm / declared.master_displacement_m_per_rad()
        } else {
            torque_nm
        };
        let shown = rms(self.changes(site, size)?.iter().flatten().flatten().copied());
        let left = rms(self
            .here
            .iter()
            .flat_map(|residual| residual.channels.iter().take(2))
            .flatten()
            .copied());
        self.changes(
            site,
            size * (left / shown.max(f64::MIN_POSITIVE)).clamp(LEAST_FACTOR, MOST_FACTOR),
        )
    }

    /// The known torque's signs, row by row of a record's residual.
    fn cause(&self, record: usize) -> Vec<f64> {
        let record = &self.machine.records[record];
        let settled = record.settling_rows();
        (0..record.residual_rows()).map(|row| self.signs[(row + settled) / HELD]).collect()
    }
}

/// What of a machine's residuals enters where, from the records that fit and select. `None` where
/// it cannot be told: without a slave's encoder, without repeats that say what is noise, with
/// records that are too short, or where nothing is left but noise.
pub fn origin((fit, select): (&View<'_>, &View<'_>), setting: &Setting) -> Option<Origin> {
    let machine = fit.machine;
    let pace = |record: usize| {
        machine.records[record].step_s * machine.records[record].decimation() as f64
    };
    let pace_s = pace(*fit.records.first()?);
    let takes_part = |record: &usize| {
        let own = &machine.records[*record];
        own.slave.is_some()
            && own.residual_rows() >= FEWEST_ROWS
            && (pace(*record) - pace_s).abs() < 1e-6 * pace_s
    };
    let records: Vec<usize> =
        fit.records.iter().chain(&select.records).copied().filter(takes_part).collect();
    let all = View::whole(machine).residuals(setting)?;
    let here: Vec<Residual> = records.iter().map(|record| all[*record].clone()).collect();
    let pairs: Vec<(usize, usize)> = repeats(&machine.records)
        .into_iter()
        .filter(|(a, b)| takes_part(a) && takes_part(b))
        .collect();
    let [masters, slaves] = [Channel::Master, Channel::Slave]
        .map(|channel| repeat_differences(machine, &pairs, &all, channel));
    let noise = spectra(masters.iter().map(Vec::as_slice).zip(slaves.iter().map(Vec::as_slice)));
    if noise.stretches < 2.0 {
        return None;
    }
    let longest = records.iter().map(|record| machine.records[*record].volts.len()).max()?;
    let listener =
        Listener { machine, setting, records, here, pace_s, signs: signs(longest + HELD) };
    listener.hear(&noise)
}

/// What is left by a torque at each place, and all that is missing; both over what noise is, times
/// the number of stretches.
#[derive(Default)]
struct Sums {
    missing: f64,
    left: [f64; 4],
}

impl Listener<'_> {
    fn hear(&self, noise: &Spectra) -> Option<Origin> {
        let sites = [Site::Master, Site::Slave, Site::Line];
        let changes =
            sites.into_iter().map(|site| self.answered(site)).collect::<Option<Vec<_>>>()?;
        let causes: Vec<Vec<f64>> = self.records.iter().map(|record| self.cause(*record)).collect();
        let (mut sums, mut kinds) = (Sums::default(), 0);
        for idle in [true, false] {
            let of: Vec<usize> = (0..self.records.len())
                .filter(|at| self.machine.records[self.records[*at]].idle == idle)
                .collect();
            if of.is_empty() {
                continue;
            }
            kinds += 1;
            let left = spectra(of.iter().map(|at| {
                let channels = &self.here[*at].channels;
                (channels[0].as_slice(), channels[1].as_slice())
            }));
            let known = |changes: &Vec<[Vec<f64>; 2]>| {
                answers(of.iter().map(|at| (causes[*at].as_slice(), changes[*at].clone())))
            };
            sums.add(&left, noise, &changes.iter().map(known).collect::<Vec<_>>(), idle);
        }
        if sums.missing <= 0.0 {
            return None;
        }
        let places = [Place::Master, Place::Slave, Place::Line, Place::Cell];
        let left =
            places.into_iter().zip(sums.left.map(|left| (left / sums.missing).clamp(0.0, 1.0)));
        Some(Origin {
            left: left.filter(|(place, _)| *place != Place::Cell || kinds == 2).collect(),
        })
    }
}

impl Sums {
    /// Takes in the records of one kind. All is measured by what repeats differ by, so that noise
    /// alone has a power of 1 a channel.
    fn add(
        &mut self,
        left: &Spectra,
        noise: &Spectra,
        answers: &[Vec<Vector2<Complex<f64>>>],
        idle: bool,
    ) {
        // The mean itself, which an offset of a sensor moves, is left out.
        for bin in 1..HIGHEST {
            let of_left =
                Matrix2::from_diagonal(&left.mean[bin].diagonal()) * Complex::from(LEAST_NOISE);
            let Some(factor) = (noise.mean[bin] + of_left).cholesky() else { continue };
            let Some(whiten) = factor.l().try_inverse() else { continue };
            let power = whiten * left.mean[bin] * whiten.adjoint();
            let all = power.trace().re;
            self.missing += left.stretches * (all - 2.0).max(0.0);
            let beyond = |answers: &Vec<Vector2<Complex<f64>>>| {
                let way = whiten * answers[bin];
                let explained =
                    (way.adjoint() * power * way)[0].re / way.norm_squared().max(f64::MIN_POSITIVE);
                left.stretches * (all - explained - 1.0).max(0.0)
            };
            let of_sides: Vec<f64> = answers.iter().map(beyond).collect();
            let of_cell = if idle { left.stretches * (all - 2.0).max(0.0) } else { of_sides[1] };
            for (sum, left) in self.left.iter_mut().zip(of_sides.into_iter().chain([of_cell])) {
                *sum += left;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(master: f64, slave: f64, line: f64, cell: Option<f64>) -> Origin {
        let sides = [(Place::Master, master), (Place::Slave, slave), (Place::Line, line)];
        Origin { left: sides.into_iter().chain(cell.map(|left| (Place::Cell, left))).collect() }
    }

    #[test]
    fn it_acts_where_little_is_left_and_between_master_and_slave_where_much_is_left_everywhere() {
        assert_eq!(origin(0.03, 0.9, 0.4, Some(0.95)).site(), Site::Master);
        assert_eq!(origin(0.8, 0.05, 0.6, Some(0.9)).site(), Site::Slave);
        assert_eq!(origin(0.8, 0.05, 0.6, None).site(), Site::Slave);
        assert_eq!(origin(0.4, 0.5, 0.12, Some(0.9)).site(), Site::Line);
        assert_eq!(origin(0.4, 0.5, 0.45, Some(0.9)).site(), Site::Line);
        // The cell has less to explain with than the slave, and nearly always explains a little
        // less.
        assert_eq!(origin(0.8, 0.05, 0.6, Some(0.08)).site(), Site::Sensor);
        assert_eq!(origin(0.8, 0.19, 0.6, Some(0.13)).site(), Site::Sensor);
    }

    #[test]
    fn functions_are_asked_where_it_acts() {
        let master = origin(0.03, 0.9, 0.4, Some(0.95));
        assert!(
            master.allows((Site::Drive, Variable::Voltage))
                && master.allows((Site::Master, Variable::Velocity))
        );
        assert!(
            !master.allows((Site::Master, Variable::Force))
                && !master.allows((Site::Slave, Variable::Velocity))
        );
        let between = origin(0.4, 0.5, 0.45, Some(0.9));
        assert!(
            between.allows((Site::Line, Variable::Deflection))
                && between.allows((Site::Slave, Variable::Force))
        );
        assert!(!between.allows((Site::Slave, Variable::Position)));
        let cell = origin(0.8, 0.05, 0.6, Some(0.05));
        assert!(
            cell.allows((Site::Sensor, Variable::Torque))
                && !cell.allows((Site::Slave, Variable::Torque))
        );
    }

    #[test]
    fn answers_are_those_of_the_cause() {
        let cause: Vec<f64> = signs(4000).iter().copied().collect();
        // The slave answers half as much, and two rows later.
        let later: Vec<f64> =
            (0..4000_usize).map(|row| 0.5 * cause[row.saturating_sub(2)]).collect();
        let answers = answers([(&cause[..], [cause.clone(), later])].into_iter());
        for (bin, answer) in answers.iter().enumerate().skip(1).take(40) {
            let turn = Complex::from_polar(0.5, -2.0 * PI * bin as f64 * 2.0 / STRETCH as f64);
            assert!((answer[0] - Complex::from(1.0)).norm() < 1e-9);
            assert!((answer[1] - turn).norm() < 0.1, "{bin}: {} {turn}", answer[1]);
        }
    }

    #[test]
    fn what_is_in_a_known_proportion_is_explained_and_no_more() {
        let course = |seed: usize| -> Vec<f64> { signs(20_000)[seed..seed + 8000].to_vec() };
        let scaled =
            |course: &[f64], size: f64| course.iter().map(|row| size * row).collect::<Vec<f64>>();
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<f64>>();
        let (noise_m, noise_s, torque) = (course(0), course(8001), course(11_500));
        let noise = spectra([(&noise_m[..], &noise_s[..])].into_iter());
        // Missing is three on the master and one on the slave; the noise is another stretch of the
        // same kind.
        let (master, slave) =
            (sum(&course(3000), &scaled(&torque, 3.0)), sum(&course(5003), &torque));
        let left = spectra([(&master[..], &slave[..])].into_iter());
        let way = |master: f64, slave: f64| {
            vec![Vector2::new(Complex::from(master), Complex::from(slave)); HIGHEST]
        };
        let mut sums = Sums::default();
        sums.add(&left, &noise, &[way(3.0, 1.0), way(1.0, -3.0), way(1.0, 0.0)], true);
        let share = sums.left.map(|left| left / sums.missing);
        assert!(share[0] < 0.1, "{share:?}");
        assert!(share[1] > 0.8 && share[3] == 1.0, "{share:?}");
        assert!((share[2] - 0.1).abs() < 0.1, "{share:?}");
    }
}
