//! Validation on records that took no part in the fit.

use plant::effects::{Site, entry};

use super::dataset::Dataset;
use super::record::{Record, repeats, rms};
use super::transmission_model::{Channel, Residual, SMOOTHING_SHAPE, Setting, TransmissionModel};
use crate::equation_error::block_roles::Role;

/// Least gain of a second effect on the selecting records: decrease of the logarithm of the rms
/// error, summed over channels.
pub const LEAST_GAIN: f64 = 0.20;
/// Least gain of a first effect, for which there are fewer alternatives.
pub const LEAST_FIRST: f64 = 0.15;
/// Least gain of a third effect, for which there are more alternatives and harder fits.
const LEAST_THIRD: f64 = 0.30;

/// Least gain of a further effect beside `effects` others.
pub const fn least_beside(effects: usize) -> f64 {
    match effects {
        0 => LEAST_FIRST,
        1 => LEAST_GAIN,
        _ => LEAST_THIRD,
    }
}

/// Least gain of a further effect relative to its standard error over blocks.
pub const LEAST_T: f64 = 3.0;
/// The same for a first effect: one that acts in few blocks, as a limit does, has a large scatter.
/// Of 234 simulated machines in which nothing is missing, no candidate reached [`LEAST_FIRST`],
/// whatever its scatter.
pub const LEAST_T_FIRST: f64 = 2.5;

/// Least gain of an effect beside `effects` others relative to its standard error.
pub const fn least_t(effects: usize) -> f64 {
    if effects == 0 { LEAST_T_FIRST } else { LEAST_T }
}

/// Rows of a block: 0.5 s at 250 Hz.
pub const BLOCK: usize = 125;
/// Fewest blocks per record; short records get shorter blocks, since the standard error of a mean
/// needs several.
const FEWEST_BLOCKS: usize = 4;
/// Repeated records with an error within this factor of the repeatability are at the noise floor.
const AT_FLOOR: f64 = 1.2;
/// The same factor for records of other movements.
const OTHERS_AT_FLOOR: f64 = 1.6;
/// Repeated records within this factor of the floor need no further fit.
const WELL_AT_FLOOR: f64 = 1.08;
/// The same factor for records of other movements.
const OTHERS_WELL_AT_FLOOR: f64 = 1.25;
/// Repeated records beyond this factor of the floor refute every listed effect.
const INADEQUATE: f64 = 1.6;
/// The same factor for records of other movements.
const OTHERS_INADEQUATE: f64 = 5.0;
/// Change of the friction's smoothing shape that stands for what is not known of it.
const UNKNOWN_SHAPE: f64 = 0.5;
/// Differences below this share of the movement's rms are ignored.
const LEAST_SHARE: f64 = 5e-4;

/// The validation of a candidate on the selecting records.
#[derive(Clone, Debug)]
pub struct Validation {
    /// Its id, or the variable of a nonparametric function.
    pub id: &'static str,
    /// Where.
    pub site: Site,
    /// Decrease of the logarithm of the error, summed over channels: the lesser of the means over
    /// blocks and over records.
    pub gain: f64,
    /// Mean gain over blocks relative to its standard error.
    pub t: f64,
    /// Records that improve by more than 0.01 and by more than a tenth of the largest gain of a
    /// record (beside other effects: of the mean gain).
    pub better: usize,
    /// Records that deteriorate by as much.
    pub worse: usize,
    /// Whether it passes.
    pub accepted: bool,
}

impl Validation {
    /// The effect, or the function's variable, with its site.
    pub const fn effect(&self) -> (&'static str, Site) {
        (self.id, self.site)
    }

    /// Returns the gain in percent of the error.
    pub fn gain_percent(&self) -> f64 {
        -100.0 * (-self.gain).exp_m1()
    }
}

/// Decrease of the logarithm of the error, by record, channel and block.
fn falls(before: &[Residual], after: &[Residual]) -> Vec<Vec<Vec<f64>>> {
    let blocks = |before: &Vec<f64>, after: &Vec<f64>| -> Vec<f64> {
        let rows = BLOCK.min(before.len() / FEWEST_BLOCKS).max(1);
        let pairs = before.chunks_exact(rows).zip(after.chunks_exact(rows));
        let size = |rows: &[f64]| rms(rows.iter().copied()).max(1e-9);
        pairs.map(|(before, after)| (size(before) / size(after)).ln()).collect()
    };
    before
        .iter()
        .zip(after)
        .map(|(before, after)| {
            before.channels.iter().zip(&after.channels).map(|(b, a)| blocks(b, a)).collect()
        })
        .collect()
}

/// A record that gains or loses less than this share of the largest gain (beside other effects: of
/// the mean gain) counts as unchanged.
const UNCHANGED: f64 = 0.1;
/// Largest deterioration of a channel (log error).
const MAY_LOSE: f64 = 0.03;
/// Largest deterioration of a channel by a first effect, as a share of the total gain: the fit may
/// still trade between channels.
const MAY_LOSE_SHARE: f64 = 0.2;

/// Whether a model with the effect is bistable: where friction falls with speed, a perturbation
/// below the noise decides between stick and slip. One block on the wrong branch may outweigh a
/// whole record, so that a first effect of this kind is validated by blocks.
pub fn is_bistable(id: &str) -> bool {
    entry(id).is_some_and(|entry| entry.search.bistable)
}

/// Validates a first effect from the residuals before and after it was added.
pub fn validate(
    named: (&'static str, Site),
    before: &[Residual],
    after: &[Residual],
) -> Validation {
    validate_beside(0, named, before, after)
}

/// Validates an effect that is added beside `effects` others.
pub fn validate_beside(
    effects: usize,
    (id, site): (&'static str, Site),
    before: &[Residual],
    after: &[Residual],
) -> Validation {
    let falls = falls(before, after);
    let mut blocks = Vec::new();
    for record in &falls {
        let count = record.iter().map(Vec::len).min().unwrap_or(0);
        blocks.extend(
            (0..count).map(|block| record.iter().map(|channel| channel[block]).sum::<f64>()),
        );
    }
    let count = blocks.len().max(1) as f64;
    let gain = blocks.iter().sum::<f64>() / count;
    let variance =
        blocks.iter().map(|block| (block - gain).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    let t = gain / (variance / count).sqrt().max(1e-12);
    // Over whole records and channels.
    let whole = |before: &Vec<f64>, after: &Vec<f64>| {
        rms(before.iter().copied()).max(1e-9).ln() - rms(after.iter().copied()).max(1e-9).ln()
    };
    let mean = |blocks: &Vec<f64>| blocks.iter().sum::<f64>() / blocks.len().max(1) as f64;
    let by_record: Vec<Vec<f64>> = if effects == 0 && is_bistable(id) {
        falls.iter().map(|channels| channels.iter().map(mean).collect()).collect()
    } else {
        let pairs = before.iter().zip(after);
        pairs
            .map(|(b, a)| b.channels.iter().zip(&a.channels).map(|(b, a)| whole(b, a)).collect())
            .collect()
    };
    let sums: Vec<f64> =
        by_record.iter().map(|channels: &Vec<f64>| channels.iter().sum()).collect();
    let total = sums.iter().sum::<f64>() / sums.len().max(1) as f64;
    // An effect that acts in few records leaves the others nearly unchanged.
    let first = effects == 0;
    let typical = if first { sums.iter().copied().fold(0.0, f64::max) } else { total };
    let unchanged = f64::max(0.01, UNCHANGED * typical);
    let better = sums.iter().filter(|sum| **sum > unchanged).count();
    let worse = sums.iter().filter(|sum| **sum < -unchanged).count();
    let may_lose = f64::max(MAY_LOSE, if first { MAY_LOSE_SHARE * total } else { 0.0 });
    let channels = by_record.iter().map(Vec::len).max().unwrap_or(0);
    let harmed = (0..channels).any(|channel| {
        let of: Vec<f64> =
            by_record.iter().filter_map(|channels| channels.get(channel).copied()).collect();
        of.iter().sum::<f64>() / (of.len().max(1) as f64) < -may_lose
    });
    let accepted = gain.min(total) >= least_beside(effects)
        && t >= least_t(effects)
        && better > worse
        && !harmed;
    Validation { id, site, gain: gain.min(total), t, better, worse, accepted }
}

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
    for channel in [Channel::Master, Channel::Slave, Channel::Torque] {
        let of = |record: usize| model.channel_of(record, &residuals[record], channel);
        let rows: Vec<f64> =
            records.iter().filter_map(|record| of(*record)).flatten().copied().collect();
        if rows.is_empty() {
            continue;
        }
        let mut floors: Vec<f64> = repeat_differences(model, &pairs, residuals, channel)
            .into_iter()
            .map(|difference| rms(difference.into_iter()))
            .collect();
        floors.sort_by(f64::total_cmp);
        let floor = floors.get(floors.len() / 2).copied();
        out.push((channel, rms(rows.into_iter()), floor));
    }
    out
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

/// Lower limit of the noise floor: half the quantisation noise, a share of the movement, or 1 mN·m.
fn least(model: &TransmissionModel, channel: Channel) -> f64 {
    let largest = |of: &dyn Fn(&Record) -> f64| model.records.iter().map(of).fold(0.0, f64::max);
    let moved = |column: &[f64]| {
        let mean = column.iter().sum::<f64>() / column.len().max(1) as f64;
        LEAST_SHARE * rms(column.iter().map(|position| position - mean))
    };
    let rounding = 0.5 / 12f64.sqrt();
    match channel {
        Channel::Master => {
            largest(&|record| moved(&record.master).max(rounding * record.count_rad[0]))
        }
        Channel::Slave => largest(&|record| {
            record.slave.as_deref().map_or(0.0, moved).max(rounding * record.count_rad[1])
        }),
        Channel::Torque => 1e-3,
    }
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
    beside_friction: [f64; 2],
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
        let [repeated, others] = self.beside_friction;
        repeated > INADEQUATE || others > OTHERS_INADEQUATE
    }

    /// Whether the model would be refuted if the friction's passage through zero speed were known.
    pub fn hidden_by_friction(&self) -> bool {
        !self.inadequate() && (self.repeated > INADEQUATE || self.others > OTHERS_INADEQUATE)
    }
}

/// Returns the error relative to the noise floor, geometric mean over records; `None` if nothing is
/// repeated or a record cannot be simulated. Of reporting records only the difference from their
/// repeats is used, never their error.
pub fn above_floor(
    model: &TransmissionModel,
    records: &[usize],
    setting: &Setting,
) -> Option<AboveFloor> {
    let mut repeated: Vec<usize> =
        repeats(&model.records).into_iter().flat_map(|(a, b)| [a, b]).collect();
    repeated.sort_unstable();
    repeated.dedup();
    repeated.retain(|record| model.records[*record].role != Role::Report);
    if repeated.is_empty() {
        return None;
    }
    let residuals = Dataset::whole(model).residuals(setting)?;
    let floors = errors_of(model, records, &residuals);
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
    let both = |unknown: &[(Channel, f64)]| [worst(&repeated, unknown), worst(records, unknown)];
    let [on_repeated, on_others] = both(&[]);
    let beside_friction = match model.slave_unobserved() && on_repeated > INADEQUATE {
        true => both(&changed_by_shape(model, &repeated, (setting, &residuals))),
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
