//! Validation of a candidate on the selection rows.

/// Least relative decrease of the rms residual on the selection rows for which an effect is
/// accepted. On filtered rows at 200 Hz a significance test alone would reject clean data; the size
/// of the decrease protects against that.
pub const LEAST_GAIN: f64 = 0.10;

/// Fewer selecting blocks than this say little about chance: the least gain is doubled.
const FEW_BLOCKS: usize = 6;

/// Least t: mean decrease of the blocks' squared residual over its standard error.
pub const LEAST_T: f64 = 2.5;

/// An error below this share of the channel (%) is negligible: only what takes
/// [`LEAST_OF_NEGLIGIBLE_PERCENT`] of it is worth a name.
pub(super) const NEGLIGIBLE_PERCENT: f64 = 3.0;
/// Least relative decrease of a negligible error (%).
pub(super) const LEAST_OF_NEGLIGIBLE_PERCENT: f64 = 30.0;

/// The least decrease (%) that is accepted of an error of so many percent of the channel.
pub(super) fn least_percent(error_percent: f64) -> f64 {
    match error_percent < NEGLIGIBLE_PERCENT {
        true => LEAST_OF_NEGLIGIBLE_PERCENT,
        false => 100.0 * LEAST_GAIN,
    }
}

/// Decrease of the rms residual from which the size alone decides, if nearly all blocks improve: on
/// few blocks no test of significance can pass, however large the decrease.
const CLEAR_GAIN: f64 = 0.50;

/// Fewest blocks that improve for each that deteriorates, and in all, for a clear decrease.
const CLEAR_BLOCKS: usize = 3;

/// Largest one-sided p of the signed-rank test of the blocks' log error ratios. Six blocks that all
/// improve reach it (1/64).
pub const MOST_P: f64 = 0.016;

/// Validation of a candidate.
#[derive(Clone, Debug)]
pub struct Validation {
    /// Id of the effect, or name of the spline's variable.
    pub id: &'static str,
    /// Decrease of the rms residual on the selection rows, in percent.
    pub gain_percent: f64,
    /// Block t of the decrease.
    pub t: f64,
    /// One-sided p of Wilcoxon's signed-rank test of the blocks' log error ratios.
    pub p: f64,
    /// Number of blocks on which the residual fell by more than 1 %.
    pub better: usize,
    /// Number of blocks on which it rose by more than 1 %.
    pub worse: usize,
    /// Number of blocks.
    pub blocks: usize,
    /// Whether it cannot pass, whatever it gains: sampling explains it, the movement does, or its
    /// law ended at the end of its range.
    pub excluded: bool,
    /// Whether it passes.
    pub accepted: bool,
}

impl Validation {
    /// Excludes it where `excluded` holds.
    pub(super) fn exclude_if(&mut self, excluded: bool) {
        self.excluded |= excluded;
        self.accepted &= !excluded;
    }

    /// Whether it takes so much of the error (%), on most blocks, and may pass.
    pub fn takes_part_of_most(&self, least_percent: f64) -> bool {
        !self.excluded && self.gain_percent >= least_percent && self.better > self.blocks / 2
    }
}

/// Validates a candidate from the mean squared residuals of the selection blocks before and after.
///
/// The decrease must be large enough and be significant by one of two tests. The t test of the mean
/// decrease fails where a single block has most of the decrease; the signed-rank test, which is
/// robust to such heavy tails, then decides. Where the error falls by half on nearly all blocks, no
/// test is asked.
pub fn validate(id: &'static str, before: &[f64], after: &[f64]) -> Validation {
    let n = before.len() as f64;
    let (sum_before, sum_after) = (before.iter().sum::<f64>(), after.iter().sum::<f64>());
    let gain = 1.0 - (sum_after / sum_before.max(f64::MIN_POSITIVE)).sqrt();
    let fall: Vec<f64> = before.iter().zip(after).map(|(b, a)| b - a).collect();
    let mean = fall.iter().sum::<f64>() / n;
    let variance = fall.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    let t = mean / (variance / n).sqrt().max(f64::MIN_POSITIVE);
    let positive = |square: f64| square.max(f64::MIN_POSITIVE);
    let logs = before.iter().zip(after).map(|(b, a)| (positive(*b) / positive(*a)).ln());
    let p = signed_rank_p(logs.collect());
    let better = before.iter().zip(after).filter(|(b, a)| a.sqrt() < 0.99 * b.sqrt()).count();
    let worse = before.iter().zip(after).filter(|(b, a)| a.sqrt() > 1.01 * b.sqrt()).count();
    let least = if before.len() < FEW_BLOCKS { 2.0 * LEAST_GAIN } else { LEAST_GAIN };
    let clear = gain >= CLEAR_GAIN && better >= CLEAR_BLOCKS * worse.max(1);
    let significant = t >= LEAST_T || p <= MOST_P || clear;
    let accepted = gain >= least && significant && better > worse;
    let blocks = before.len();
    Validation {
        id,
        gain_percent: 100.0 * gain,
        t,
        p,
        better,
        worse,
        blocks,
        excluded: false,
        accepted,
    }
}

/// One-sided p of Wilcoxon's signed-rank test for a positive median, from the exact distribution
/// without ties. Values that are exactly 0 are left out; 1 without others.
fn signed_rank_p(mut values: Vec<f64>) -> f64 {
    values.retain(|value| *value != 0.0);
    values.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
    let n = values.len();
    let ranks = values.iter().zip(1..).filter(|(value, _)| **value > 0.0).map(|(_, rank)| rank);
    let statistic: usize = ranks.sum();
    // Number of subsets of the ranks with each sum, as a share of all subsets.
    let mut share = vec![0.0; n * (n + 1) / 2 + 1];
    share[0] = 1.0;
    for rank in 1..=n {
        for sum in (0..share.len()).rev() {
            share[sum] = 0.5 * (share[sum] + if sum >= rank { share[sum - rank] } else { 0.0 });
        }
    }
    share[statistic..].iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signed_rank_probabilities_are_those_of_the_tables() {
        let p = |values: &[f64]| signed_rank_p(values.to_vec());
        assert_eq!(p(&[]), 1.0);
        assert!((p(&[0.3, 0.1, 0.2, 0.5, 0.4, 9.0]) - 1.0 / 64.0).abs() < 1e-12);
        // Critical value of n = 8 at 5 % one-sided: a negative rank sum of 5 has p = 0.0391.
        assert!((p(&[1.0, 2.0, 3.0, 4.0, -5.0, 6.0, 7.0, 8.0]) - 10.0 / 256.0).abs() < 1e-12);
        assert!((p(&[0.0, 1.0]) - 0.5).abs() < 1e-12);
        assert!(p(&[-1.0, -2.0, -3.0]) == 1.0);
    }

    #[test]
    fn a_gain_on_one_block_alone_is_not_accepted() {
        let before = [1.0; 10];
        let mut after = [1.0; 10];
        after[3] = 0.0;
        assert!(!validate("x", &before, &after).accepted, "5 % only");
        let before = [1.0, 1.0, 1.0, 1.0, 9.0];
        let after = [1.0, 1.0, 1.0, 1.0, 1.0];
        let validation = validate("x", &before, &after);
        assert!(validation.gain_percent > 30.0 && !validation.accepted, "{validation:?}");
    }

    #[test]
    fn a_uniform_gain_is_accepted_and_a_loss_is_not() {
        let before: Vec<f64> = (0..10).map(|i| 1.0 + 0.1 * f64::from(i % 3)).collect();
        let after: Vec<f64> = before.iter().map(|b| 0.7 * b).collect();
        assert!(validate("x", &before, &after).accepted);
        assert!(!validate("x", &after, &before).accepted);
    }

    #[test]
    fn a_gain_on_all_blocks_is_accepted_though_one_block_has_most_of_it() {
        let before = [1.0, 1.2, 0.9, 1.1, 40.0, 1.0, 1.3, 0.8, 1.0];
        let after = before.map(|before| 0.2 * before);
        let validation = validate("x", &before, &after);
        assert!(validation.t < LEAST_T && validation.accepted, "{validation:?}");
        assert!(!validate("x", &after, &before).accepted);
    }

    #[test]
    fn on_few_blocks_a_clear_decrease_on_nearly_all_of_them_is_accepted() {
        // The second block has nearly all of the decrease: neither test passes.
        let before = [1.0, 30.0, 1.2];
        let after = before.map(|before| 0.2 * before);
        let validation = validate("x", &before, &after);
        assert!(validation.t < LEAST_T && validation.p > MOST_P && validation.accepted);
        // A third of the decrease is no such clear one, nor is one that every third block misses.
        let after = before.map(|before| 0.45 * before);
        assert!(!validate("x", &before, &after).accepted);
        assert!(!validate("x", &before, &[0.2, 6.0, 1.5]).accepted);
    }

    #[test]
    fn what_is_excluded_neither_passes_nor_stays_open() {
        let before: Vec<f64> = (0..10).map(|i| 1.0 + 0.1 * f64::from(i % 3)).collect();
        let after: Vec<f64> = before.iter().map(|b| 0.7 * b).collect();
        let mut validation = validate("x", &before, &after);
        validation.exclude_if(false);
        assert!(validation.accepted && validation.takes_part_of_most(10.0));
        validation.exclude_if(true);
        assert!(!validation.accepted && !validation.takes_part_of_most(10.0));
    }

    #[test]
    fn few_blocks_must_show_twice_the_gain() {
        let before: Vec<f64> = (0..8).map(|i| 1.0 + 0.01 * f64::from(i)).collect();
        let after: Vec<f64> = before.iter().map(|before| 0.72 * before).collect();
        assert!(validate("x", &before, &after).accepted);
        assert!(!validate("x", &before[..5], &after[..5]).accepted);
    }
}
