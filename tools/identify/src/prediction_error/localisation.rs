//! Localisation: where an unmodelled torque enters the machine, whatever it depends on.
//!
//! A torque at one place moves master and slave with a frequency response of its own, which is
//! measured on the model by adding a known torque there ([`super::probe_torque`]); friction and
//! observer then respond as along the records. If the unmodelled torque acts at that place alone,
//! the cross-spectrum of the residuals has the same direction. The share of its power outside that
//! direction, which no torque at the place can explain, is computed for
//!
//! - a torque on the master (motor and amplifier act there as well and cannot be distinguished);
//! - a torque on the slave;
//! - a force on the moving mass in the lines;
//! - an error of the torque sensor: a torque on the slave, but only while a hand is at the handle.
//!
//! If none of them explains most of it, the effect acts between master and slave, as compliance,
//! leakage and backlash of the line do. Where master and slave show noise alone, and the torque
//! sensor reads more than that without a hand, the sensor is wrong: no torque at the machine does
//! that.

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::{Complex, Matrix2, Vector2};
use plant::effects::{Effect, Site};
use rayon::prelude::*;

use super::dataset::Dataset;
use super::location::{Localisation, Location};
use super::noise_floor::{OctaveRatios, octave_ratios, repeat_differences};
use super::probe_torque::{Action, ProbeTorque, random_signs};
use super::record::{repeats, rms};
use super::transmission_model::{Channel, Residual, Setting, TransmissionModel};
use crate::spectral::transform;

/// Rows of a spectral segment (about one second); segments overlap by half.
const SEGMENT: usize = 256;
/// Shortest record that takes part (rows).
const FEWEST_ROWS: usize = 2 * SEGMENT;
/// Rows for which the probe torque is held: its spectrum has its first zero at a third of the row
/// rate, above the highest bin.
const HELD: usize = 3;
/// Number of bins used: beyond a quarter of the row rate the machine hardly responds.
const HIGHEST: usize = SEGMENT / 4;
/// First probe torque relative to the motor's rms torque.
const FIRST_TRY: f64 = 0.01;
/// Least factor by which the probe is rescaled to the size of the residual.
const LEAST_FACTOR: f64 = 1e-3;
/// Largest such factor.
const MOST_FACTOR: f64 = 1e3;
/// Noise floor as a share of the residual's power, which regularises noise-free records.
const LEAST_NOISE: f64 = 1e-4;
/// Cross-spectral matrices of master and slave, averaged over segments, and their number.
struct Spectra {
    mean: Vec<Matrix2<Complex<f64>>>,
    segments: f64,
}

/// Spectra of the segments of a signal under a Hann window.
fn segment_spectra(rows: &[f64]) -> Vec<Vec<Complex<f64>>> {
    let window: Vec<f64> = (0..SEGMENT)
        .map(|row| 0.5 - 0.5 * (2.0 * PI * (row as f64 + 0.5) / SEGMENT as f64).cos())
        .collect();
    let begins = (0..rows.len()).step_by(SEGMENT / 2);
    let whole = begins.filter_map(|from| rows.get(from..from + SEGMENT));
    whole
        .filter_map(|rows| {
            transform(rows.iter().zip(&window).map(|(row, weight)| row * weight).collect())
        })
        .collect()
}

/// Averaged cross-spectral matrices of pairs of signals (Welch's method).
fn spectra<'a>(pairs: impl Iterator<Item = (&'a [f64], &'a [f64])>) -> Spectra {
    let mut mean = vec![Matrix2::zeros(); HIGHEST];
    let mut count = 0.0;
    for (master, slave) in pairs {
        for (master, slave) in segment_spectra(master).iter().zip(segment_spectra(slave)) {
            for (bin, sum) in mean.iter_mut().enumerate() {
                let both = Vector2::new(master[bin], slave[bin]);
                *sum += both * both.adjoint();
            }
            count += 1.0;
        }
    }
    let share = Complex::from(1.0 / f64::max(count, 1.0));
    Spectra { mean: mean.into_iter().map(|sum| sum * share).collect(), segments: count }
}

/// Estimates the frequency responses of master and slave to a known signal, by bins.
fn responses<'a>(
    known: impl Iterator<Item = (&'a [f64], [Vec<f64>; 2])>,
) -> Vec<Vector2<Complex<f64>>> {
    let mut sums = vec![(Vector2::zeros(), 0.0); HIGHEST];
    for (cause, [master, slave]) in known {
        for ((cause, master), slave) in
            segment_spectra(cause).iter().zip(segment_spectra(&master)).zip(segment_spectra(&slave))
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

/// Residuals of the records and the probe torque that is added.
struct ProbeExperiment<'a> {
    model: &'a TransmissionModel,
    setting: &'a Setting,
    records: Vec<usize>,
    /// Residuals of those records.
    here: Vec<Residual>,
    /// Time from row to row (s).
    pace_s: f64,
    random_signs: Arc<[f64]>,
}

impl ProbeExperiment<'_> {
    /// Returns the residuals with the probe.
    fn with(&self, action: Action, size: f64) -> Option<Vec<Residual>> {
        let values: Arc<[f64]> = self.random_signs.iter().map(|sign| size * sign).collect();
        let one = |record: &usize| {
            let start_s = self.model.records[*record].start_s;
            let probe_torque =
                ProbeTorque::new(action, start_s, HELD as f64 * self.pace_s, Arc::clone(&values));
            self.model.residual_beside(
                self.setting,
                *record,
                vec![Box::new(probe_torque) as Box<dyn Effect>],
            )
        };
        self.records.par_iter().map(one).collect()
    }

    /// Returns the change of the residuals of master and slave by the probe, for every record.
    fn changes(&self, action: Action, size: f64) -> Option<Vec<[Vec<f64>; 2]>> {
        let of = |with: &Residual, here: &Residual, channel: usize| -> Vec<f64> {
            with.channels[channel]
                .iter()
                .zip(&here.channels[channel])
                .map(|(with, here)| with - here)
                .collect()
        };
        let with = self.with(action, size)?;
        Some(
            with.iter()
                .zip(&self.here)
                .map(|(with, here)| [of(with, here, 0), of(with, here, 1)])
                .collect(),
        )
    }

    /// As [`Self::changes`], with the probe scaled to the size of the residual.
    fn scaled_response(&self, action: Action) -> Option<Vec<[Vec<f64>; 2]>> {
        let declared = &self.model.declared;
        let volts = self.records.iter().flat_map(|record| &self.model.records[*record].volts);
        let torque_nm =
            FIRST_TRY * declared.motor_torque_per_volt_nm() * rms(volts.copied()).max(FIRST_TRY);
        let size = action.size_of(torque_nm, declared);
        let shown = rms(self.changes(action, size)?.iter().flatten().flatten().copied());
        let left = rms(self
            .here
            .iter()
            .flat_map(|residual| residual.channels.iter().take(2))
            .flatten()
            .copied());
        self.changes(
            action,
            size * (left / shown.max(f64::MIN_POSITIVE)).clamp(LEAST_FACTOR, MOST_FACTOR),
        )
    }

    /// The probe's sign, by residual row.
    fn cause(&self, record: usize) -> Vec<f64> {
        let record = &self.model.records[record];
        let settled = record.settling_rows();
        (0..record.residual_rows()).map(|row| self.random_signs[(row + settled) / HELD]).collect()
    }
}

/// White noise of the power that the residuals of master and slave have in the upper half of the
/// spectrum, where a machine hardly moves.
fn white_spectra(residuals: &[Residual]) -> Spectra {
    let upper = |channel: usize| {
        let of = residuals.iter().filter_map(|residual| residual.channels.get(channel));
        let of = of.flat_map(|rows| segment_spectra(rows));
        let bins = of.flat_map(|bins| bins.into_iter().skip(HIGHEST));
        let (sum, count) =
            bins.fold((0.0, 0.0), |(sum, count), bin| (sum + bin.norm_sqr(), count + 1.0));
        (sum / f64::max(count, 1.0), count / (SEGMENT / 2 + 1 - HIGHEST) as f64)
    };
    let ((master, segments), (slave, _)) = (upper(0), upper(1));
    let both = Vector2::new(Complex::from(master), Complex::from(slave));
    Spectra { mean: vec![Matrix2::from_diagonal(&both); HIGHEST], segments }
}

/// Localises the unmodelled torque from the fitting and selecting records. `None` without a slave
/// encoder, with too short records, or if only noise is left.
///
/// The noise is taken from repeated records, and as white. The former contains what moves the
/// machine at random, but also an effect that does not repeat, and its spectra have few segments:
/// the noise with which the place is clearer counts.
pub fn localise(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    setting: &Setting,
) -> Option<Localisation> {
    let model = fit.model;
    let pace =
        |record: usize| model.records[record].step_s * model.records[record].decimation() as f64;
    let pace_s = pace(*fit.records.first()?);
    let takes_part = |record: &usize| {
        let own = &model.records[*record];
        own.slave.is_some()
            && own.residual_rows() >= FEWEST_ROWS
            && (pace(*record) - pace_s).abs() < 1e-6 * pace_s
    };
    let records: Vec<usize> =
        fit.records.iter().chain(&select.records).copied().filter(takes_part).collect();
    let all = Dataset::whole(model).residuals(setting)?;
    let here: Vec<Residual> = records.iter().map(|record| all[*record].clone()).collect();
    let pairs: Vec<(usize, usize)> = repeats(&model.records)
        .into_iter()
        .filter(|(a, b)| takes_part(a) && takes_part(b))
        .collect();
    let [masters, slaves] = [Channel::Master, Channel::Slave]
        .map(|channel| repeat_differences(model, &pairs, &all, channel));
    let of_repeats =
        spectra(masters.iter().map(Vec::as_slice).zip(slaves.iter().map(Vec::as_slice)));
    let noises: Vec<Spectra> = [of_repeats, white_spectra(&here)]
        .into_iter()
        .filter(|noise| noise.segments >= 2.0)
        .collect();
    let longest = records.iter().map(|record| model.records[*record].volts.len()).max()?;
    let listener = ProbeExperiment {
        model,
        setting,
        records,
        here,
        pace_s,
        random_signs: random_signs(longest + HELD),
    };
    let in_reading_alone = in_reading_alone(model, &listener.records, &all);
    match listener.localise(&noises) {
        Some(found) => Some(Localisation { in_reading_alone, ..found }),
        None if in_reading_alone => Some(Localisation { in_reading_alone, ..Default::default() }),
        None => None,
    }
}

/// Whether the reading of the torque sensor without a hand is the only channel that shows more than
/// noise. `residuals` are those of all records.
fn in_reading_alone(model: &TransmissionModel, records: &[usize], residuals: &[Residual]) -> bool {
    let ratios = octave_ratios(model, records, residuals);
    let coloured = |reading: bool| {
        let of = |own: &&OctaveRatios| (own.channel == Channel::Torque) == reading;
        ratios.iter().filter(of).any(|own| own.colour() > 1.0)
    };
    coloured(true) && !coloured(false)
}

/// Power left by a torque at each place and total power, both relative to noise and summed over
/// segments.
#[derive(Default)]
struct Sums {
    missing: f64,
    left: [f64; 4],
}

impl ProbeExperiment<'_> {
    fn localise(&self, noises: &[Spectra]) -> Option<Localisation> {
        let changes =
            [Action::Torque(Site::Master), Action::Torque(Site::Slave), Action::MovingMass]
                .map(|action| self.scaled_response(action))
                .into_iter()
                .collect::<Option<Vec<_>>>()?;
        let causes: Vec<Vec<f64>> = self.records.iter().map(|record| self.cause(*record)).collect();
        let known: Vec<KnownResponses> = [true, false]
            .into_iter()
            .filter_map(|idle| self.known_responses(idle, &changes, &causes))
            .collect();
        let found = noises.iter().filter_map(|noise| left_by_place(&known, noise));
        found.min_by(|a, b| a.least_at_a_side().total_cmp(&b.least_at_a_side()))
    }

    /// Spectra of the residuals and responses to the probe, of the records without a hand or with
    /// one; `None` where there are none.
    fn known_responses(
        &self,
        idle: bool,
        changes: &[Vec<[Vec<f64>; 2]>],
        causes: &[Vec<f64>],
    ) -> Option<KnownResponses> {
        let of: Vec<usize> = (0..self.records.len())
            .filter(|at| self.model.records[self.records[*at]].idle == idle)
            .collect();
        let left = spectra(of.iter().map(|at| {
            let channels = &self.here[*at].channels;
            (channels[0].as_slice(), channels[1].as_slice())
        }));
        let known = |changes: &Vec<[Vec<f64>; 2]>| {
            responses(of.iter().map(|at| (causes[*at].as_slice(), changes[*at].clone())))
        };
        let responses = changes.iter().map(known).collect();
        (!of.is_empty()).then_some(KnownResponses { idle, left, responses })
    }
}

/// Spectra of the residuals, and responses to the probe at each place, of records of one kind.
struct KnownResponses {
    /// Whether nobody is at the handle.
    idle: bool,
    left: Spectra,
    responses: Vec<Vec<Vector2<Complex<f64>>>>,
}

/// What torques at each place leave; `None` if only noise is left.
fn left_by_place(known: &[KnownResponses], noise: &Spectra) -> Option<Localisation> {
    let mut sums = Sums::default();
    for KnownResponses { idle, left, responses } in known {
        sums.add(left, noise, responses, *idle);
    }
    if sums.missing <= 0.0 {
        return None;
    }
    let places = [Location::Master, Location::Slave, Location::Line, Location::Cell];
    let left = places.into_iter().zip(sums.left.map(|left| (left / sums.missing).clamp(0.0, 1.0)));
    // The torque cell needs records of both kinds.
    let left = left.filter(|(place, _)| *place != Location::Cell || known.len() == 2).collect();
    Some(Localisation { left, ..Localisation::default() })
}

impl Sums {
    /// Adds the records of one kind. Spectra are whitened by the noise spectrum, so that noise has
    /// unit power per channel.
    fn add(
        &mut self,
        left: &Spectra,
        noise: &Spectra,
        responses: &[Vec<Vector2<Complex<f64>>>],
        idle: bool,
    ) {
        // Without bin 0, which a sensor offset affects.
        for bin in 1..HIGHEST {
            let of_left =
                Matrix2::from_diagonal(&left.mean[bin].diagonal()) * Complex::from(LEAST_NOISE);
            let Some(factor) = (noise.mean[bin] + of_left).cholesky() else { continue };
            let Some(whiten) = factor.l().try_inverse() else { continue };
            let power = whiten * left.mean[bin] * whiten.adjoint();
            let all = power.trace().re;
            self.missing += left.segments * (all - 2.0).max(0.0);
            let beyond = |responses: &Vec<Vector2<Complex<f64>>>| {
                let way = whiten * responses[bin];
                let explained =
                    (way.adjoint() * power * way)[0].re / way.norm_squared().max(f64::MIN_POSITIVE);
                left.segments * (all - explained - 1.0).max(0.0)
            };
            let of_sides: Vec<f64> = responses.iter().map(beyond).collect();
            let of_cell = if idle { left.segments * (all - 2.0).max(0.0) } else { of_sides[1] };
            for (sum, left) in self.left.iter_mut().zip(of_sides.into_iter().chain([of_cell])) {
                *sum += left;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responses_are_those_to_the_cause() {
        let cause: Vec<f64> = random_signs(4000).iter().copied().collect();
        // The slave answers half as much, and two rows later.
        let later: Vec<f64> =
            (0..4000_usize).map(|row| 0.5 * cause[row.saturating_sub(2)]).collect();
        let responses = responses([(&cause[..], [cause.clone(), later])].into_iter());
        for (bin, answer) in responses.iter().enumerate().skip(1).take(40) {
            let turn = Complex::from_polar(0.5, -2.0 * PI * bin as f64 * 2.0 / SEGMENT as f64);
            assert!((answer[0] - Complex::from(1.0)).norm() < 1e-9);
            assert!((answer[1] - turn).norm() < 0.1, "{bin}: {} {turn}", answer[1]);
        }
    }

    #[test]
    fn residuals_in_the_proportion_of_a_place_are_explained_by_it() {
        let course = |seed: usize| -> Vec<f64> { random_signs(20_000)[seed..seed + 8000].to_vec() };
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
