//! The excess over the noise floor, record by record: how much of it effects leave, and whether one
//! record has far more of it than others.
//!
//! Effects that take a quarter of the error may take little of what lies above the floor: they
//! resemble what is missing, and the fit of the declared parameters beside them does the rest.

use super::dataset::Dataset;
use super::noise_floor::{AT_FLOOR, floor_of, least};
use super::record::{repeats, rms};
use super::transmission_model::{Channel, Residual, Setting, TransmissionModel};
use crate::equation_error::block_roles::Role;

/// Fewest records and channels above the floor whose median is asked.
const FEWEST_ABOVE: usize = 3;

/// The error of a record in a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordError {
    /// The record.
    pub record: usize,
    /// The channel.
    pub channel: Channel,
    /// Its rms error over the noise floor.
    pub over_floor: f64,
}

/// Errors of some records over the noise floor, in every channel that has a floor. `residuals` are
/// those of all records.
fn record_errors(
    model: &TransmissionModel,
    records: &[usize],
    residuals: &[Residual],
) -> Vec<RecordError> {
    let pairs = repeats(&model.records);
    let of = |channel: Channel| {
        let floor = floor_of(model, &pairs, residuals, channel)?.max(least(model, channel));
        let error = move |record: &usize| {
            let rows = model.channel_of(*record, &residuals[*record], channel)?;
            let over_floor = rms(rows.iter().copied()) / floor;
            Some(RecordError { record: *record, channel, over_floor })
        };
        Some(records.iter().filter_map(error))
    };
    Channel::ALL.into_iter().filter_map(of).flatten().collect()
}

/// The largest error of a record that does not report; `None` if nothing is repeated, or no record
/// has the slave's position: its creep, which no model predicts then, differs by record.
pub(super) fn largest_error(
    model: &TransmissionModel,
    residuals: &[Residual],
) -> Option<RecordError> {
    if model.slave_unobserved() {
        return None;
    }
    let records: Vec<usize> =
        [Role::Fit, Role::Select].into_iter().flat_map(|role| model.of_role(role)).collect();
    let errors = record_errors(model, &records, residuals).into_iter();
    errors.max_by(|a, b| a.over_floor.total_cmp(&b.over_floor))
}

/// The median share of the excess that is left, over the records and channels that were above the
/// floor; `None` if those are few. In stick-slip one record may take the other branch, and what it
/// leaves then says nothing.
fn median_left(before: &[f64], after: &[f64]) -> Option<f64> {
    let pairs = before.iter().zip(after).filter(|(before, _)| **before > AT_FLOOR);
    let excess = |over_floor: f64| (over_floor * over_floor - 1.0).max(0.0);
    let mut shares: Vec<f64> =
        pairs.map(|(before, after)| excess(*after) / excess(*before)).collect();
    shares.sort_by(f64::total_cmp);
    let median = shares.get(shares.len() / 2).copied();
    median.filter(|_| shares.len() >= FEWEST_ABOVE)
}

/// Share of the excess over the noise floor that a model leaves where another one is not at the
/// floor: the median over records and channels, each model against its own floor. `None` if that is
/// not known: few are above the floor, nothing is repeated, or no record has the slave's position.
pub(super) fn excess_left(
    model: &TransmissionModel,
    records: &[usize],
    [before, after]: [&Setting; 2],
) -> Option<f64> {
    if model.slave_unobserved() {
        return None;
    }
    let errors = |setting: &Setting| -> Option<Vec<f64>> {
        let residuals = Dataset::whole(model).residuals(setting)?;
        let errors = record_errors(model, records, &residuals);
        Some(errors.into_iter().map(|error| error.over_floor).collect())
    };
    median_left(&errors(before)?, &errors(after)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_the_excess_is_left_at_the_median_of_those_above_the_floor() {
        let root = |squares: [f64; 3]| squares.map(f64::sqrt);
        let left = median_left(&root([3.0, 5.0, 9.0]), &root([2.0, 3.0, 5.0]));
        assert!((left.unwrap() - 0.5).abs() < 1e-9, "{left:?}");
        // Below the floor nothing is left, and one record alone decides nothing.
        assert_eq!(median_left(&[3.0, 5.0, 9.0], &[0.4, 0.9, 500.0]), Some(0.0));
        // What was at the floor before does not count.
        assert_eq!(median_left(&[1.19, 0.2, 3.0, 5.0, 9.0], &[9.0, 9.0, 1.0, 1.0, 1.0]), Some(0.0));
        assert_eq!(median_left(&[1.1, 3.0, 5.0], &[1.0, 1.0, 1.0]), None);
        assert_eq!(median_left(&[], &[]), None);
    }
}
