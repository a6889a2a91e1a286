//! How much of the error a model leaves, and whether what it leaves looks like noise.

use super::candidates::FittedModel;
use super::predictor::Predictor;
use super::validation::{LEAST_OF_NEGLIGIBLE_PERCENT, NEGLIGIBLE_PERCENT};
use crate::equation_error::block_roles::Block;

/// An error below this share of the channel (%) is adequate for any use of the model.
const SMALL_PERCENT: f64 = 10.0;
/// Largest share of the squared error of the selection rows that named effects may leave: with more
/// than half of it left, what is named is not what the model lacks most.
const MOST_LEFT_SELECTED: f64 = 0.5;
/// The same on the reporting rows, which may differ from the others in their movement.
const MOST_LEFT_REPORTED: f64 = 0.9;
/// An error above this share of the channel (%) is large: the same share of its square may then be
/// left on the reporting rows as on the selection rows.
const LARGE_PERCENT: f64 = 30.0;
/// Largest correlation of residuals one period of the cut-off apart, beyond what the low-pass
/// leaves between them.
const MOST_CORRELATION: f64 = 0.3;
/// Longest lag at which residuals are compared, in periods of the cut-off: what a machine leaves
/// may be uncorrelated at one lag, as a wave is a quarter of its period apart.
const LAGS: f64 = 4.0;

/// Least share of a squared error that counts as beyond the noise.
const LEAST_BEYOND: f64 = 1e-6;
/// Largest share of the squared error that may be noise of the position where the rest is judged:
/// noise of the acceleration is coloured.
pub(super) const MOST_NOISE: f64 = 0.5;

/// Least such share that is told.
const LEAST_NOTED: f64 = 0.1;

/// How adequate a model is. Moving rows are those in which the machine moves, if dry friction is in
/// the model, and all rows otherwise: at rest dry friction takes any value below its limit.
#[derive(Clone, Copy, Debug, Default)]
pub struct Adequacy {
    /// Error of the declared model in percent of the channel's root mean square, on the selection
    /// or the reporting rows, whichever is larger.
    pub declared_percent: f64,
    /// Error in percent of the channel's root mean square, on the selection rows.
    pub selected_percent: f64,
    /// The same on the reporting rows.
    pub reported_percent: f64,
    /// The same on the moving ones of the selection rows.
    pub selected_moving_percent: f64,
    /// The same on the moving ones of the reporting rows.
    pub reported_moving_percent: f64,
    /// Squared error as a share of the declared model's, on moving selection rows; of both, what
    /// noise of the position leaves is taken away.
    pub left_selected: f64,
    /// The same on moving reporting rows.
    pub left_reported: f64,
    /// Share of the squared error of the moving reporting rows that noise of the position leaves.
    pub noise_share: f64,
    /// Largest correlation, as a median over the reporting blocks, of residuals that lie one to
    /// four periods of the cut-off apart, in moving rows; near 0 for white ones.
    pub correlation: f64,
}

impl Adequacy {
    /// Compares a model with the declared one.
    pub(super) fn of(
        predictor: &Predictor<'_>,
        (declared, last): (&FittedModel<'_>, &FittedModel<'_>),
        select: &[Block],
        report: &[Block],
    ) -> Self {
        let moving = |model: &FittedModel<'_>, blocks: &[Block]| -> Vec<Moving> {
            let of = |block| Moving::of(predictor, (model, last), block);
            blocks.iter().map(of).collect()
        };
        let share = |blocks: &[Block]| {
            let [before, after] = [declared, last].map(|model| {
                let square = mean_square(&moving(model, blocks));
                let noise = predictor.noise_square(&model.structure, &model.fitted, blocks);
                (square, (square - noise).max(LEAST_BEYOND * square).max(f64::MIN_POSITIVE))
            });
            let (error, size) = predictor.error(&last.fitted, blocks);
            let percent = |error: f64| 100.0 * error / size.max(f64::MIN_POSITIVE);
            let noise_share = 1.0 - after.1 / after.0.max(f64::MIN_POSITIVE);
            (percent(error), percent(after.0.sqrt()), after.1 / before.1, noise_share)
        };
        let (selected_percent, selected_moving_percent, left_selected, _) = share(select);
        let (reported_percent, reported_moving_percent, left_reported, noise_share) = share(report);
        let correlation = largest_correlation(&moving(last, report));
        let percent = |blocks: &[Block]| {
            let (error, size) = predictor.error(&declared.fitted, blocks);
            100.0 * error / size.max(f64::MIN_POSITIVE)
        };
        Self {
            declared_percent: percent(select).max(percent(report)),
            selected_percent,
            reported_percent,
            selected_moving_percent,
            reported_moving_percent,
            left_selected,
            left_reported,
            noise_share,
            correlation,
        }
    }

    /// Whether the declared model leaves so little that it is adequate for any use.
    pub(super) fn is_negligible(&self) -> bool {
        self.declared_percent < NEGLIGIBLE_PERCENT
    }

    /// Whether so little was left, and what was added takes less of it on the reporting rows than
    /// it had to on the selection rows.
    pub(super) fn takes_little_of_negligible(&self) -> bool {
        let most_left = (1.0 - 0.01 * LEAST_OF_NEGLIGIBLE_PERCENT).powi(2);
        self.is_negligible() && self.left_reported > most_left
    }

    /// Whether the effects leave most of a large error.
    pub(super) fn leaves_most(&self) -> bool {
        let most_left_reported = match self.reported_moving_percent > LARGE_PERCENT {
            true => MOST_LEFT_SELECTED,
            false => MOST_LEFT_REPORTED,
        };
        self.selected_moving_percent.max(self.reported_moving_percent) > SMALL_PERCENT
            && (self.left_selected > MOST_LEFT_SELECTED || self.left_reported > most_left_reported)
    }

    /// What is known of a large error that is left: noise of the position, or dry friction at rest.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.reported_percent <= SMALL_PERCENT {
            return notes;
        }
        if self.noise_share >= LEAST_NOTED {
            notes.push(format!(
                "noise of the measured position leaves {:.0} % of the squared error on the \
                 reporting rows: it passes through the mass and the damping",
                100.0 * self.noise_share
            ));
        }
        if self.reported_moving_percent <= SMALL_PERCENT {
            notes.push(format!(
                "in the reporting rows in which the machine moves the error is {:.1} %; at rest \
                 dry friction takes any value below its limit, and no model tells which",
                self.reported_moving_percent
            ));
        }
        notes
    }

    /// Whether a large error is left that is not noise: large without what noise of the position
    /// leaves, which is the instrument's and coloured by the mass.
    pub(super) fn is_coloured(&self) -> bool {
        self.reported_moving_percent * (1.0 - self.noise_share).max(0.0).sqrt() > SMALL_PERCENT
            && self.correlation > MOST_CORRELATION
            && self.noise_share < MOST_NOISE
    }
}

/// The residual of a block in its moving rows.
struct Moving {
    /// Number of the rows.
    rows: usize,
    /// Sum of squares.
    square: f64,
    /// Correlations of residuals at lags from one to [`LAGS`] periods of the cut-off.
    correlations: Vec<f64>,
}

impl Moving {
    /// Of a model; whether dry friction is in the model, the last one tells.
    fn of(
        predictor: &Predictor<'_>,
        (model, last): (&FittedModel<'_>, &FittedModel<'_>),
        block: &Block,
    ) -> Self {
        let (residual, rows) = predictor.moving_residual(&last.structure, &model.fitted, block);
        let balance = &predictor.regression().balances[block.record];
        let period = 1.0 / balance.cut_off / balance.row_step();
        let lags = period.ceil() as usize..=(LAGS * period).ceil() as usize;
        // Without the block's own mean: an error that is constant over a block is no noise.
        let product = |lag: usize| -> f64 {
            residual.iter().zip(residual.iter().skip(lag)).map(|(a, b)| a * b).sum()
        };
        let square = product(0);
        let correlations = lags.map(|lag| product(lag) / square.max(f64::MIN_POSITIVE)).collect();
        Self { rows, square, correlations }
    }
}

/// The largest, by magnitude, of the medians over the blocks of the correlations at each lag.
fn largest_correlation(blocks: &[Moving]) -> f64 {
    let lags = blocks.iter().map(|own| own.correlations.len()).min().unwrap_or(0);
    let median = |lag: usize| {
        let mut values: Vec<f64> = blocks.iter().map(|own| own.correlations[lag]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    (0..lags).map(|lag| median(lag).abs()).fold(0.0, f64::max)
}

/// Mean square over the moving rows of some blocks; 0 where none moves.
fn mean_square(blocks: &[Moving]) -> f64 {
    let rows: usize = blocks.iter().map(|own| own.rows).sum();
    blocks.iter().map(|own| own.square).sum::<f64>() / rows.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_of_the_instruments_or_at_rest_refutes_nothing() {
        let coloured = Adequacy {
            reported_percent: 17.0,
            reported_moving_percent: 17.0,
            noise_share: 0.4,
            correlation: 0.5,
            ..Adequacy::default()
        };
        assert!(coloured.is_coloured());
        assert!(!Adequacy { noise_share: 0.6, ..coloured }.is_coloured());
        // Of 11.5 %, noise leaves what makes the rest 9.6 %.
        let small = Adequacy { reported_moving_percent: 11.5, noise_share: 0.3, ..coloured };
        assert!(!small.is_coloured() && Adequacy { noise_share: 0.1, ..small }.is_coloured());
        let at_rest = Adequacy { reported_moving_percent: 3.0, noise_share: 0.0, ..coloured };
        assert!(!at_rest.is_coloured());
        assert_eq!((coloured.notes().len(), at_rest.notes().len()), (1, 1));
        assert!(at_rest.notes()[0].contains("moves the error is 3.0 %"), "{:?}", at_rest.notes());
    }

    #[test]
    fn a_wave_is_coloured_though_it_is_uncorrelated_at_one_lag() {
        let block = |correlations: &[f64]| Moving {
            rows: 100,
            square: 1.0,
            correlations: correlations.to_vec(),
        };
        // A quarter of the wave's period lies between the first two lags.
        let wave = [block(&[0.0, -0.5, 0.0]), block(&[0.1, -0.6, 0.1]), block(&[-0.1, -0.4, 0.0])];
        assert!((largest_correlation(&wave) - 0.5).abs() < 1e-12);
        // What is correlated in one block alone is chance.
        let white = [block(&[0.0, 0.1]), block(&[0.9, -0.1]), block(&[0.05, 0.0])];
        assert!(largest_correlation(&white) < 0.1);
        assert_eq!(largest_correlation(&[]), 0.0);
    }

    #[test]
    fn of_a_negligible_error_a_good_part_must_be_explained_on_the_reporting_rows_too() {
        let takes_little = |declared_percent: f64, left_reported: f64| {
            Adequacy { declared_percent, left_reported, ..Adequacy::default() }
                .takes_little_of_negligible()
        };
        assert!(takes_little(1.4, 0.86));
        assert!(!takes_little(1.4, 0.3) && !takes_little(5.0, 0.86));
    }

    #[test]
    fn effects_are_judged_by_what_they_leave_while_the_machine_moves() {
        let leaves = |reported_moving_percent: f64, left_reported: f64| {
            let left_selected = 0.3;
            Adequacy {
                reported_moving_percent,
                left_selected,
                left_reported,
                ..Adequacy::default()
            }
            .leaves_most()
        };
        assert!(leaves(20.0, 0.95) && !leaves(20.0, 0.6));
        assert!(leaves(40.0, 0.6) && !leaves(5.0, 0.95));
    }
}
