//! How a model does on records that its fit has not seen.

use plant::effects::Site;

use super::fit::View;
use super::machine::{Channel, Machine, Residual, Setting};
use super::record::{Record, repeats, rms};
use crate::inverse::split::Role;

/// Least gain on the selecting records: fall of the logarithm of the error, summed over channels.
pub const LEAST_GAIN: f64 = 0.20;
/// The same of a first effect: beside none there are fewer ways to be wrong.
pub const LEAST_FIRST: f64 = 0.15;
/// The same of a third effect: beside two there are the more, and a fit of so much more to be bad.
const LEAST_THIRD: f64 = 0.30;

/// Least gain of a further effect beside so many.
pub const fn least_beside(effects: usize) -> f64 {
    match effects {
        0 => LEAST_FIRST,
        1 => LEAST_GAIN,
        _ => LEAST_THIRD,
    }
}

/// Least gain over its standard error, by blocks.
pub const LEAST_T: f64 = 3.0;
/// Rows of a block (half a second where rows are 4 ms apart).
pub const BLOCK: usize = 125;
/// Fewest blocks of a record, whose blocks are the shorter for it: from one no error of a mean can
/// be told.
const FEWEST_BLOCKS: usize = 4;
/// An error within this factor of what repeats differ by leaves nothing to be explained.
const AT_FLOOR: f64 = 1.2;
/// The same for records of other movements.
const OTHERS_AT_FLOOR: f64 = 1.6;
/// Within this a model is not fitted any closer.
const WELL_AT_FLOOR: f64 = 1.08;
/// The same for records of other movements.
const OTHERS_WELL_AT_FLOOR: f64 = 1.25;
/// Beyond this factor no name is right.
const INADEQUATE: f64 = 1.6;
/// The same for records of other movements.
const OTHERS_INADEQUATE: f64 = 5.0;
/// Share of a movement below which no difference counts.
const LEAST_SHARE: f64 = 5e-4;

/// How a candidate did on the selecting records.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Its id, or the variable of a function without a name.
    pub id: &'static str,
    /// Where.
    pub site: Site,
    /// Fall of the logarithm of the error, summed over channels, mean of all blocks.
    pub gain: f64,
    /// The same over its standard error.
    pub t: f64,
    /// Records that get better and worse by more than a hundredth, and by more than a tenth of what
    /// the one gains that gains most (beside other effects: of what all gain by mean).
    pub better: usize,
    /// See `better`.
    pub worse: usize,
    /// Whether it passes.
    pub accepted: bool,
}

impl Judged {
    /// The gain in percent of the error.
    pub fn gain_percent(&self) -> f64 {
        -100.0 * (-self.gain).exp_m1()
    }
}

/// Logarithm of the fall of the error, by record, channel and block.
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

/// A record that gains or loses less than this share of what the one gains that gains most (beside
/// other effects: of what all gain by mean) stays as it was.
const UNCHANGED: f64 = 0.1;
/// A channel may lose this much.
const MAY_LOSE: f64 = 0.03;
/// For a first effect it may lose this share of what all channels gain: a fit that has just begun
/// to make room for it trades between them.
const MAY_LOSE_SHARE: f64 = 0.2;

/// Whether a model with an effect has two ways to go from the same place: where friction falls with
/// speed, it slips or sticks by less than what the records tell. Half a second in which it went the
/// other way then outweighs a whole record, though nothing is wrong with the model: as a first
/// effect it is judged by the blocks of each record.
pub fn has_two_ways(id: &str) -> bool {
    id == "stribeck_friction"
}

/// Judges what a fit does on records that it has not seen, beside what was there before: as a first
/// effect is judged.
pub fn judge(named: (&'static str, Site), before: &[Residual], after: &[Residual]) -> Judged {
    judge_beside(0, named, before, after)
}

/// The same of an effect that comes beside so many.
pub fn judge_beside(
    effects: usize,
    (id, site): (&'static str, Site),
    before: &[Residual],
    after: &[Residual],
) -> Judged {
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
    // By whole records and channels.
    let whole = |before: &Vec<f64>, after: &Vec<f64>| {
        rms(before.iter().copied()).max(1e-9).ln() - rms(after.iter().copied()).max(1e-9).ln()
    };
    let mean = |blocks: &Vec<f64>| blocks.iter().sum::<f64>() / blocks.len().max(1) as f64;
    let by_record: Vec<Vec<f64>> = if effects == 0 && has_two_ways(id) {
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
    // What is in few records (a hand's torque) leaves the others as they were, a little better or
    // worse as parameters move with it.
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
    let accepted =
        gain.min(total) >= least_beside(effects) && t >= LEAST_T && better > worse && !harmed;
    Judged { id, site, gain: gain.min(total), t, better, worse, accepted }
}

/// Root mean square of a setting's residual over records, by channel; and that of the difference of
/// records that repeat one another, over √2: what no model can explain.
pub fn errors(
    machine: &Machine,
    records: &[usize],
    setting: &Setting,
) -> Option<Vec<(Channel, f64, Option<f64>)>> {
    Some(errors_of(machine, records, &all_residuals(machine, setting)?))
}

fn all_residuals(machine: &Machine, setting: &Setting) -> Option<Vec<Residual>> {
    View::whole(machine).residuals(setting)
}

/// The same of residuals of all records.
fn errors_of(
    machine: &Machine,
    records: &[usize],
    residuals: &[Residual],
) -> Vec<(Channel, f64, Option<f64>)> {
    let pairs = repeats(&machine.records);
    let mut out = Vec::new();
    for channel in [Channel::Master, Channel::Slave, Channel::Torque] {
        let of = |record: usize| machine.channel_of(record, &residuals[record], channel);
        let rows: Vec<f64> =
            records.iter().filter_map(|record| of(*record)).flatten().copied().collect();
        if rows.is_empty() {
            continue;
        }
        let mut floors: Vec<f64> = repeat_differences(machine, &pairs, residuals, channel)
            .into_iter()
            .map(|difference| rms(difference.into_iter()))
            .collect();
        floors.sort_by(f64::total_cmp);
        let floor = floors.get(floors.len() / 2).copied();
        out.push((channel, rms(rows.into_iter()), floor));
    }
    out
}

/// By what records that repeat one another ([`repeats`]) differ in a channel, over √2, row by row,
/// for each two of them: what no model can explain. The residuals are those of all records.
pub fn repeat_differences(
    machine: &Machine,
    pairs: &[(usize, usize)],
    residuals: &[Residual],
    channel: Channel,
) -> Vec<Vec<f64>> {
    let of = |record: usize| machine.channel_of(record, &residuals[record], channel);
    let difference = |(a, b): &(usize, usize)| {
        let (a, b) = (of(*a)?, of(*b)?);
        Some(a.iter().zip(b).map(|(a, b)| (a - b) / std::f64::consts::SQRT_2).collect())
    };
    pairs.iter().filter_map(difference).collect()
}

/// Repeats that differ by less do not say that a model should leave as little: half of what the
/// rounding to counts leaves, a share of the movement, a thousandth of a newton metre.
fn least(machine: &Machine, channel: Channel) -> f64 {
    let largest = |of: &dyn Fn(&Record) -> f64| machine.records.iter().map(of).fold(0.0, f64::max);
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

/// How far a setting stands above what repeats of a movement differ by (1 is at the floor), in its
/// worst channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Above {
    /// The repeated records themselves.
    pub repeated: f64,
    /// The records that were asked for, whose movements differ: their own floor is not known, and
    /// something may have happened in them.
    pub others: f64,
}

impl Above {
    /// No closer fit of the same model is worth while.
    pub fn well_at_floor(&self) -> bool {
        self.repeated <= WELL_AT_FLOOR && self.others <= OTHERS_WELL_AT_FLOOR
    }

    /// Nothing is left to be explained.
    pub fn at_floor(&self) -> bool {
        self.repeated <= AT_FLOOR && self.others <= OTHERS_AT_FLOOR
    }

    /// The model is not one of this machine, whatever it gained: right names end nearer.
    pub fn inadequate(&self) -> bool {
        self.repeated > INADEQUATE || self.others > OTHERS_INADEQUATE
    }
}

/// How far a setting stands above what repeats differ by: of several records it is the geometric
/// mean. `None` where nothing is repeated, or a record cannot be simulated. Of a record that
/// reports only by how much it differs from its repeat is looked at, never how well the setting
/// does on it.
pub fn above_floor(machine: &Machine, records: &[usize], setting: &Setting) -> Option<Above> {
    let mut repeated: Vec<usize> =
        repeats(&machine.records).into_iter().flat_map(|(a, b)| [a, b]).collect();
    repeated.sort_unstable();
    repeated.dedup();
    repeated.retain(|record| machine.records[*record].role != Role::Report);
    if repeated.is_empty() {
        return None;
    }
    let residuals = all_residuals(machine, setting)?;
    let floors = errors_of(machine, records, &residuals);
    let typical = |records: &[usize]| -> Vec<(Channel, f64)> {
        let of = |channel: Channel| {
            let rows = records
                .iter()
                .filter_map(|record| machine.channel_of(*record, &residuals[*record], channel));
            let logs =
                rows.filter(|rows| !rows.is_empty()).map(|rows| rms(rows.iter().copied()).ln());
            let (sum, count) = logs.fold((0.0, 0usize), |(sum, count), log| (sum + log, count + 1));
            (channel, (sum / count.max(1) as f64).exp())
        };
        floors.iter().map(|(channel, ..)| of(*channel)).collect()
    };
    let worst = |records: &[usize]| -> f64 {
        let typical = typical(records);
        let ratios = typical.iter().zip(&floors).filter_map(|((channel, error), (_, _, floor))| {
            Some(error / floor.as_ref()?.max(least(machine, *channel)))
        });
        ratios.fold(0.0, f64::max)
    };
    Some(Above { repeated: worst(&repeated), others: worst(records) })
}

/// Whether records are explained as closely as repeats of a movement repeat; false where none is
/// repeated.
pub fn at_floor(machine: &Machine, records: &[usize], setting: &Setting) -> bool {
    above_floor(machine, records, setting).is_some_and(|above| above.at_floor())
}
