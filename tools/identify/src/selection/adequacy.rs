//! How much of the error a model leaves, and whether what it leaves looks like noise.

use super::candidates::FittedModel;
use super::predictor::Predictor;
use crate::equation_error::block_roles::Block;
use crate::equation_error::model::Fitted;

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

/// How adequate a model is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Adequacy {
    /// Error in percent of the channel's root mean square, on the selection rows.
    pub selected_percent: f64,
    /// The same on the reporting rows.
    pub reported_percent: f64,
    /// Squared error as a share of the declared model's, on the selection rows.
    pub left_selected: f64,
    /// The same on the reporting rows.
    pub left_reported: f64,
    /// Median over the reporting blocks of the correlation of residuals one period of the cut-off
    /// apart; 0 for white ones.
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
        let share = |blocks: &[Block]| {
            let [(before, _), (after, size)] =
                [declared, last].map(|model| predictor.error(&model.fitted, blocks));
            (100.0 * after / size.max(f64::MIN_POSITIVE), (after / before).powi(2))
        };
        let (selected_percent, left_selected) = share(select);
        let (reported_percent, left_reported) = share(report);
        let mut correlations: Vec<f64> =
            report.iter().map(|block| correlation(predictor, &last.fitted, block)).collect();
        correlations.sort_by(f64::total_cmp);
        let correlation = correlations.get(correlations.len() / 2).copied().unwrap_or(0.0);
        Self { selected_percent, reported_percent, left_selected, left_reported, correlation }
    }

    /// Whether the effects leave most of a large error.
    pub(super) fn leaves_most(&self) -> bool {
        let most_left_reported = match self.reported_percent > LARGE_PERCENT {
            true => MOST_LEFT_SELECTED,
            false => MOST_LEFT_REPORTED,
        };
        self.selected_percent.max(self.reported_percent) > SMALL_PERCENT
            && (self.left_selected > MOST_LEFT_SELECTED || self.left_reported > most_left_reported)
    }

    /// Whether a large error is left that is not noise.
    pub(super) fn is_coloured(&self) -> bool {
        self.reported_percent > SMALL_PERCENT && self.correlation > MOST_CORRELATION
    }
}

/// Correlation of a block's residuals one period of the cut-off apart.
fn correlation(predictor: &Predictor<'_>, fitted: &Fitted, block: &Block) -> f64 {
    let residual = predictor.residual(fitted, block);
    let balance = &predictor.regression().balances[block.record];
    let lag = (1.0 / balance.cut_off / balance.row_step()).ceil() as usize;
    // Without the block's own mean: an error that is constant over a block is no noise.
    let product = |lag: usize| -> f64 {
        residual.iter().zip(residual.iter().skip(lag)).map(|(a, b)| a * b).sum()
    };
    product(lag) / product(0).max(f64::MIN_POSITIVE)
}
