//! Validation on records that took no part in the fit.

use plant::effects::{Site, entry};

use super::record::rms;
use super::transmission_model::Residual;

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
