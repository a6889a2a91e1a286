//! The noise floor of transmissions: what no model can explain, and how far above it the error of a
//! model lies.
//!
//! Records of the same movement differ by what no model can explain. Most of that is fast, as
//! encoder counts and sensor noise are, while a machine moves slowly: an effect may be many times
//! the floor at the frequencies at which it acts, and yet hardly show in the sum over all. So the
//! two are compared octave by octave as well.

use super::dataset::Dataset;
use super::record::{Record, repeats, rms};
use super::transmission_model::{Channel, Residual, SMOOTHING_SHAPE, Setting, TransmissionModel};
use crate::equation_error::block_roles::Role;
use crate::spectral::{OCTAVES, octave_logarithms, white_shares};

/// Repeated records with an error within this factor of the repeatability are at the noise floor.
pub(super) const AT_FLOOR: f64 = 1.2;
/// The same factor for records of other movements.
const OTHERS_AT_FLOOR: f64 = 1.6;
/// Repeated records within this factor of the floor need no further fit.
const WELL_AT_FLOOR: f64 = 1.08;
/// The same factor for records of other movements.
const OTHERS_WELL_AT_FLOOR: f64 = 1.25;
/// Repeated records beyond this factor of the floor refute every listed effect.
pub(super) const INADEQUATE: f64 = 1.6;
/// The same factor for records of other movements.
const OTHERS_INADEQUATE: f64 = 5.0;
/// Change of the friction's smoothing shape that stands for what is not known of it.
const UNKNOWN_SHAPE: f64 = 0.5;
/// Geometric mean over the octaves of the error over the repeatability, beyond which what a model
/// leaves is no noise. Right models of 130 simulated machines ended at 1.02 at most, and at 1.48
/// once.
const MOST_COLOUR: f64 = 1.5;
/// The same for the slave, whose friction decides how it sticks and creeps: 1.4 at most, and 1.7
/// once.
const MOST_COLOUR_SLAVE: f64 = 2.0;
/// Twice as much where nothing is repeated, and the floor is that of white noise.
const UNREPEATED: f64 = 2.0;
/// Differences below this share of the movement's rms are ignored.
const LEAST_SHARE: f64 = 5e-4;

/// Returns, per channel, the rms residual over some records and the noise floor: the rms difference
/// of repeated records over √2 (median over pairs), if any are repeated.
pub fn errors(
    model: &TransmissionModel,
    records: &[usize],
    setting: &Setting,
) -> Option<Vec<(Channel, f64, Option<f64>)>> {
    Some(errors_of(model, records, &Dataset::whole(model).residuals(setting)?))
}

/// As [`errors`], from the residuals of all records.
fn errors_of(
    model: &TransmissionModel,
    records: &[usize],
    residuals: &[Residual],
) -> Vec<(Channel, f64, Option<f64>)> {
    let pairs = repeats(&model.records);
    let mut out = Vec::new();
    for channel in Channel::ALL {
        let of = |record: usize| model.channel_of(record, &residuals[record], channel);
        let rows: Vec<f64> =
            records.iter().filter_map(|record| of(*record)).flatten().copied().collect();
        if rows.is_empty() {
            continue;
        }
        let floor = floor_of(model, &pairs, residuals, channel);
        out.push((channel, rms(rows.into_iter()), floor));
    }
    out
}

/// The noise floor of a channel: rms difference of repeated records over √2, median over pairs.
pub(super) fn floor_of(
    model: &TransmissionModel,
    pairs: &[(usize, usize)],
    residuals: &[Residual],
    channel: Channel,
) -> Option<f64> {
    let differences = repeat_differences(model, pairs, residuals, channel);
    let mut floors: Vec<f64> =
        differences.into_iter().map(|difference| rms(difference.into_iter())).collect();
    floors.sort_by(f64::total_cmp);
    floors.get(floors.len() / 2).copied()
}

/// Returns the differences of repeated records ([`repeats`]) in a channel over √2, row by row, for
/// each pair: what no model can explain. `residuals` are those of all records.
pub fn repeat_differences(
    model: &TransmissionModel,
    pairs: &[(usize, usize)],
    residuals: &[Residual],
    channel: Channel,
) -> Vec<Vec<f64>> {
    let of = |record: usize| model.channel_of(record, &residuals[record], channel);
    let difference = |(a, b): &(usize, usize)| {
        let (a, b) = (of(*a)?, of(*b)?);
        Some(a.iter().zip(b).map(|(a, b)| (a - b) / std::f64::consts::SQRT_2).collect())
    };
    pairs.iter().filter_map(difference).collect()
}

/// Error over the noise floor in octaves of frequency, in one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OctaveRatios {
    /// The channel.
    pub channel: Channel,
    /// Ratio in each octave, the highest first ([`octave_logarithms`]).
    pub ratios: [f64; OCTAVES],
    /// Whether the floor is that of repeated records; else it is white noise of the power in the
    /// highest octave, where a machine hardly moves.
    pub repeated: bool,
}

impl OctaveRatios {
    /// Geometric mean over the octaves, relative to the limit: above 1 the error is no noise.
    pub fn colour(&self) -> f64 {
        let mean = self.ratios.iter().map(|ratio| ratio.ln()).sum::<f64>() / OCTAVES as f64;
        let most = match self.channel {
            Channel::Slave => MOST_COLOUR_SLAVE,
            Channel::Master | Channel::Torque => MOST_COLOUR,
        };
        mean.exp() / if self.repeated { most } else { UNREPEATED * most }
    }
}

/// Geometric mean over some signals of their power in each octave; `None` if all are short.
fn typical_powers<'a>(signals: impl Iterator<Item = &'a Vec<f64>>) -> Option<[f64; OCTAVES]> {
    let (mut logs, mut count) = ([0.0; OCTAVES], 0.0);
    for own in signals.filter_map(|signal| octave_logarithms(signal)) {
        logs.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        count += 1.0;
    }
    (count > 0.0).then(|| logs.map(|log| (log / count).exp()))
}

/// Ratios of an error to a floor from their powers in each octave. Without a floor it is white
/// noise of the error's power in the highest octave. It is at least white noise of the rms `least`.
fn ratios(error: [f64; OCTAVES], floor: Option<[f64; OCTAVES]>, least: f64) -> [f64; OCTAVES] {
    let shares = white_shares();
    let white = |square: f64| shares.map(|share| square * share);
    let unrepeated = || white(error[0] / shares[0]);
    let (floor, least) = (floor.unwrap_or_else(unrepeated), white(least * least));
    std::array::from_fn(|octave| (error[octave] / floor[octave].max(least[octave])).sqrt())
}

/// Compares the errors of some records with the noise floor, octave by octave, in each channel that
/// has records of 512 rows; `residuals` are those of all records.
pub fn octave_ratios(
    model: &TransmissionModel,
    records: &[usize],
    residuals: &[Residual],
) -> Vec<OctaveRatios> {
    let pairs = repeats(&model.records);
    let of = |channel: Channel| {
        let rows = |record: &usize| model.channel_of(*record, &residuals[*record], channel);
        let error = typical_powers(records.iter().filter_map(rows))?;
        let differences = repeat_differences(model, &pairs, residuals, channel);
        let floor = typical_powers(differences.iter());
        let ratios = ratios(error, floor, rounding(model, channel));
        Some(OctaveRatios { channel, ratios, repeated: floor.is_some() })
    };
    Channel::ALL.into_iter().filter_map(of).collect()
}

/// The largest [`OctaveRatios::colour`] of the channels; `None` where it is not known, and where no
/// record has the slave's position: its creep, which no model predicts then, is slow.
pub(super) fn colour(
    model: &TransmissionModel,
    records: &[usize],
    residuals: &[Residual],
) -> Option<f64> {
    if model.slave_unobserved() {
        return None;
    }
    let ratios = octave_ratios(model, records, residuals);
    ratios.iter().map(OctaveRatios::colour).max_by(f64::total_cmp)
}

/// Half of what rounding to encoder counts leaves (rad rms), or 1 mN·m.
fn rounding(model: &TransmissionModel, channel: Channel) -> f64 {
    let largest = |side: usize| {
        let counts = model.records.iter().map(|record| record.count_rad[side]);
        0.5 / 12f64.sqrt() * counts.fold(0.0, f64::max)
    };
    match channel {
        Channel::Master => largest(0),
        Channel::Slave => largest(1),
        Channel::Torque => 1e-3,
    }
}

/// Lower limit of the noise floor: half of what rounding leaves, or a share of the movement.
pub(super) fn least(model: &TransmissionModel, channel: Channel) -> f64 {
    let moved = |column: &[f64]| {
        let mean = column.iter().sum::<f64>() / column.len().max(1) as f64;
        LEAST_SHARE * rms(column.iter().map(|position| position - mean))
    };
    let of = |record: &Record| match channel {
        Channel::Master => moved(&record.master),
        Channel::Slave => record.slave.as_deref().map_or(0.0, moved),
        Channel::Torque => 0.0,
    };
    model.records.iter().map(of).fold(rounding(model, channel), f64::max)
}

/// Error relative to the noise floor (1 is at the floor), in the worst channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AboveFloor {
    /// On the repeated records.
    pub repeated: f64,
    /// On the given records, whose own floor is not known.
    pub others: f64,
    /// Both with a floor that includes what the friction's unknown passage through zero speed
    /// changes, where no record has the slave's position; otherwise as above.
    pub(super) beside_friction: [f64; 2],
}

impl AboveFloor {
    /// Whether a further fit of the same model is not worthwhile.
    pub fn well_at_floor(&self) -> bool {
        self.repeated <= WELL_AT_FLOOR && self.others <= OTHERS_WELL_AT_FLOOR
    }

    /// Whether nothing is left to explain.
    pub fn at_floor(&self) -> bool {
        self.repeated <= AT_FLOOR && self.others <= OTHERS_AT_FLOOR
    }

    /// Whether the model is refuted whatever it gained: right ones end nearer to the floor.
    pub fn inadequate(&self) -> bool {
        self.exceeds(INADEQUATE)
    }

    pub(super) fn exceeds(&self, most: f64) -> bool {
        let [repeated, others] = self.beside_friction;
        repeated > most || others > OTHERS_INADEQUATE
    }

    /// Whether the model would be refuted if the friction's passage through zero speed were known.
    pub fn hidden_by_friction(&self) -> bool {
        !self.inadequate() && (self.repeated > INADEQUATE || self.others > OTHERS_INADEQUATE)
    }
}

/// The repeated records that do not report.
pub(super) fn repeated(model: &TransmissionModel) -> Vec<usize> {
    let pairs = repeats(&model.records);
    let mut repeated: Vec<usize> = pairs.into_iter().flat_map(|(a, b)| [a, b]).collect();
    repeated.sort_unstable();
    repeated.dedup();
    repeated.retain(|record| model.records[*record].role != Role::Report);
    repeated
}

/// Returns the error relative to the noise floor, geometric mean over records; `None` if nothing is
/// repeated or a record cannot be simulated. Of reporting records only the difference from their
/// repeats is used, never their error.
pub fn above_floor(
    model: &TransmissionModel,
    records: &[usize],
    setting: &Setting,
) -> Option<AboveFloor> {
    let repeated = repeated(model);
    if repeated.is_empty() {
        return None;
    }
    let residuals = Dataset::whole(model).residuals(setting)?;
    above_floor_of(model, records, &repeated, (setting, &residuals))
}

/// As [`above_floor`], from the residuals of all records.
pub(super) fn above_floor_of(
    model: &TransmissionModel,
    records: &[usize],
    repeated: &[usize],
    (setting, residuals): (&Setting, &[Residual]),
) -> Option<AboveFloor> {
    if repeated.is_empty() {
        return None;
    }
    let floors = errors_of(model, records, residuals);
    let typical = |records: &[usize]| -> Vec<(Channel, f64)> {
        let of = |channel: Channel| {
            let rows = records
                .iter()
                .filter_map(|record| model.channel_of(*record, &residuals[*record], channel));
            let logs =
                rows.filter(|rows| !rows.is_empty()).map(|rows| rms(rows.iter().copied()).ln());
            let (sum, count) = logs.fold((0.0, 0usize), |(sum, count), log| (sum + log, count + 1));
            (channel, (sum / count.max(1) as f64).exp())
        };
        floors.iter().map(|(channel, ..)| of(*channel)).collect()
    };
    let worst = |records: &[usize], unknown: &[(Channel, f64)]| -> f64 {
        let typical = typical(records);
        let ratios = typical.iter().zip(&floors).filter_map(|((channel, error), (_, _, floor))| {
            let of_friction =
                unknown.iter().find(|(own, _)| own == channel).map_or(0.0, |own| own.1);
            Some(error / floor.as_ref()?.max(least(model, *channel)).hypot(of_friction))
        });
        ratios.fold(0.0, f64::max)
    };
    let both = |unknown: &[(Channel, f64)]| [worst(repeated, unknown), worst(records, unknown)];
    let [on_repeated, on_others] = both(&[]);
    let beside_friction = match model.slave_unobserved() && on_repeated > INADEQUATE {
        true => both(&changed_by_shape(model, repeated, (setting, residuals))),
        false => [on_repeated, on_others],
    };
    Some(AboveFloor { repeated: on_repeated, others: on_others, beside_friction })
}

/// Returns, per channel, the rms change of the residuals when the shape of the friction's passage
/// through zero speed changes by [`UNKNOWN_SHAPE`]: friction decides how an unobserved slave
/// creeps, and creep is not in the model.
fn changed_by_shape(
    model: &TransmissionModel,
    records: &[usize],
    (setting, residuals): (&Setting, &[Residual]),
) -> Vec<(Channel, f64)> {
    let Some(at) = model.base.iter().position(|own| own.name == SMOOTHING_SHAPE) else {
        return Vec::new();
    };
    let mut moved = setting.clone();
    let (low, high) = (model.base[at].low, model.base[at].high);
    let up = high - setting.base[at] >= setting.base[at] - low;
    moved.base[at] += if up { UNKNOWN_SHAPE } else { -UNKNOWN_SHAPE };
    let Some(changed) = Dataset::whole(model).residuals(&moved) else { return Vec::new() };
    let rows = |channel: Channel| {
        let of = |record: &usize| {
            let of = |residuals: &[Residual]| {
                model.channel_of(*record, &residuals[*record], channel).cloned()
            };
            Some(of(residuals)?.into_iter().zip(of(&changed)?).map(|(a, b)| a - b))
        };
        rms(records.iter().filter_map(of).flatten())
    };
    [Channel::Master, Channel::Torque].map(|channel| (channel, rows(channel))).to_vec()
}

/// Whether records are explained down to the noise floor; false if nothing is repeated.
pub fn at_floor(model: &TransmissionModel, records: &[usize], setting: &Setting) -> bool {
    above_floor(model, records, setting).is_some_and(|above| above.at_floor())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise as encoder counts leave it: white, of unit variance.
    fn noise(seed: u64) -> Vec<f64> {
        let uniform = crate::test_noise::noise(seed, 8192);
        uniform.into_iter().map(|value| 12f64.sqrt() * value).collect()
    }

    #[test]
    fn a_slow_error_below_the_noise_is_coloured_and_noise_is_not() {
        let slow = |row: usize| 0.35 * (std::f64::consts::TAU * 1.5 * row as f64 / 250.0).sin();
        let error: Vec<f64> =
            noise(1).iter().enumerate().map(|(row, own)| own + slow(row)).collect();
        let rms_ratio = rms(error.iter().copied()) / rms(noise(1).into_iter());
        assert!(rms_ratio < 1.05, "{rms_ratio}");
        let powers = |of: &Vec<f64>| typical_powers([of].into_iter()).unwrap();
        let floor = powers(&noise(2));
        let with = |error: &Vec<f64>, floor: Option<[f64; OCTAVES]>| OctaveRatios {
            channel: Channel::Master,
            ratios: ratios(powers(error), floor, 0.0),
            repeated: floor.is_some(),
        };
        // From 0.98 to 1.95 Hz.
        assert!(with(&error, Some(floor)).ratios[6] > 2.5);
        assert!(with(&error, None).ratios[6] > 2.5);
        assert!(with(&noise(3), Some(floor)).ratios.iter().all(|own| (0.7..1.4).contains(own)));
        assert!(
            with(&noise(3), None).colour() < 0.5 && with(&noise(3), Some(floor)).colour() < 0.8
        );
        // Three times the noise in every octave.
        let thrice: Vec<f64> = noise(3).iter().map(|own| 3.0 * own).collect();
        assert!(with(&thrice, Some(floor)).colour() > 1.7);
        let slave = OctaveRatios { channel: Channel::Slave, ..with(&thrice, Some(floor)) };
        assert!((1.2..1.7).contains(&slave.colour()), "{}", slave.colour());
    }

    #[test]
    fn records_without_noise_are_compared_with_the_rounding() {
        let powers = [0.0, 0.0, 0.0, 0.0, 0.0, 1e-8, 1e-8, 1e-8];
        let ratios = ratios(powers, Some([0.0; OCTAVES]), 1e-4);
        let of = |bins: f64| (1e-8 / (1e-8 * bins / 256.0)).sqrt();
        assert!(ratios[0] == 0.0 && (ratios[5] - of(4.0)).abs() < 1e-9, "{ratios:?}");
        // A ratio of zero is the least of colours, not an undefined one.
        let colour = OctaveRatios { channel: Channel::Torque, ratios, repeated: true }.colour();
        assert!(colour.is_finite() && colour < 1.0, "{colour}");
    }

    #[test]
    fn friction_of_an_unobserved_slave_refutes_no_model() {
        let above = |repeated: f64, beside_friction: f64| AboveFloor {
            repeated,
            others: repeated,
            beside_friction: [beside_friction; 2],
        };
        let judged =
            |above: AboveFloor| (above.at_floor(), above.hidden_by_friction(), above.inadequate());
        assert_eq!(judged(above(1.1, 1.1)), (true, false, false));
        assert_eq!(judged(above(1.5, 1.2)), (false, false, false));
        assert_eq!(judged(above(2.5, 1.1)), (false, true, false));
        assert_eq!(judged(above(2.5, 1.7)), (false, false, true));
    }
}
