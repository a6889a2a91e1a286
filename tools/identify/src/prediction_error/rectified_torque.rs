//! Recovers the sign of a torque whose sensor shows magnitudes only.
//!
//! A sensor that rectifies by more than half shows both signs as one, so that each reading has two
//! possible torques. Between zeros of the reading the torque keeps its sign. The model is simulated
//! with both signs, and for each segment between zeros the sign with the smaller innovations is
//! taken.

use super::record::Record;
use super::transmission_model::{Setting, TransmissionModel};

/// A channel is rectified if its negative readings reach no more than this share of its positive
/// ones.
const ONE_SIDED: f64 = 0.05;
/// Readings below this share of the largest count as zero.
const NOTHING: f64 = 0.015;
/// Quantile of outliers left out at either end.
const OUTLYING: f64 = 0.01;

/// Returns the records with a hand if none of them shows both signs, else none.
pub fn rectified_records(model: &TransmissionModel) -> Vec<usize> {
    let with_hand =
        |index: &usize| !model.records[*index].idle && model.records[*index].torque.is_some();
    let hands: Vec<usize> = (0..model.records.len()).filter(with_hand).collect();
    if hands.iter().all(|index| is_one_sided(&model.records[*index])) { hands } else { Vec::new() }
}

/// Marks the rows with negative torque in these records, by a setting that was fitted without them.
/// `None` if it cannot be simulated.
pub fn restore_signs(
    model: &mut TransmissionModel,
    hands: Vec<usize>,
    setting: &Setting,
) -> Option<()> {
    let mut sign_flipped = model.clone();
    for index in &hands {
        let torque = sign_flipped.records[*index].torque.iter_mut().flatten();
        torque.for_each(|reading| *reading = -*reading);
    }
    for index in hands {
        let (straight, other) =
            (model.residual(setting, index)?, sign_flipped.residual(setting, index)?);
        // The torque is not among these records' channels: a hand is at the handle.
        let gain: Vec<f64> = (0..straight.channels.first()?.len())
            .map(|row| {
                let channels = straight.channels.iter().zip(&other.channels);
                channels.map(|(straight, other)| straight[row].powi(2) - other[row].powi(2)).sum()
            })
            .collect();
        let record = &mut model.records[index];
        record.sign_flipped = flipped_rows(record, &gain);
    }
    Some(())
}

fn is_one_sided(record: &Record) -> bool {
    let mut sorted = record.torque.clone().unwrap_or_default();
    sorted.sort_by(f64::total_cmp);
    let out = (OUTLYING * sorted.len() as f64) as usize;
    match (sorted.get(out), sorted.len().checked_sub(out + 1).and_then(|at| sorted.get(at))) {
        (Some(low), Some(high)) => -low <= ONE_SIDED * high,
        _ => false,
    }
}

/// Returns the rows whose sign is to be flipped; `gain` is the decrease of the squared innovation
/// by flipping, per residual row.
fn flipped_rows(record: &Record, gain: &[f64]) -> Vec<bool> {
    let torque = record.torque.as_deref().unwrap_or_default();
    let (width, settling) = (record.decimation(), record.settling_rows());
    let of = |row: usize| {
        (row / width).checked_sub(settling).and_then(|at| gain.get(at)).copied().unwrap_or(0.0)
    };
    let mut sign_flipped = vec![false; torque.len()];
    let mut from = 0;
    for to in zeros(torque).into_iter().chain([torque.len()]) {
        let better = (from..to).map(of).sum::<f64>() > 0.0;
        sign_flipped[from..to].fill(better);
        from = to;
    }
    sign_flipped
}

/// Returns the zeros of a torque that is shown without its sign: the smallest row of each run of
/// rows that count as zero.
fn zeros(torque: &[f64]) -> Vec<usize> {
    let nothing = NOTHING * torque.iter().fold(0.0, |most: f64, reading| most.max(*reading));
    let runs = torque.chunk_by(|one, next| (*one > nothing) == (*next > nothing));
    let mut start = 0;
    let mut zeros = Vec::new();
    for run in runs {
        let least = run.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
        zeros.extend(least.filter(|(_, reading)| **reading <= nothing).map(|(at, _)| start + at));
        start += run.len();
    }
    zeros
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::equation_error::block_roles::Role;

    fn record(torque: Vec<f64>) -> Record {
        let rows = torque.len();
        Record {
            name: "record".to_owned(),
            start_s: 0.0,
            step_s: 4e-3,
            volts: vec![0.0; rows],
            master: vec![0.0; rows],
            slave: None,
            torque: Some(torque),
            sign_flipped: Vec::new(),
            role: Role::Fit,
            count_rad: [1e-3; 2],
            idle: false,
            others: Vec::new(),
            steps: 1,
            jumps: Default::default(),
        }
    }

    #[test]
    fn readings_of_one_sign_are_distinguished_from_those_of_both() {
        let swing: Vec<f64> = (0..1000).map(|row| (0.02 * f64::from(row)).sin()).collect();
        assert!(!is_one_sided(&record(swing.clone())));
        assert!(is_one_sided(&record(swing.iter().map(|torque| torque.abs()).collect())));
        // A row of noise makes no second sign.
        let mut noisy: Vec<f64> = swing.iter().map(|torque| torque.abs()).collect();
        noisy[500] = -3.0;
        assert!(is_one_sided(&record(noisy)));
        assert!(!is_one_sided(&record(Vec::new())));
    }

    #[test]
    fn a_segment_between_two_zeros_is_flipped_as_a_whole() {
        let torque: Vec<f64> = (0..400)
            .map(|row| (std::f64::consts::TAU * f64::from(row) / 200.0).sin().abs())
            .collect();
        let record = record(torque);
        // One residual row per row; 50 are left out at the start.
        assert_eq!((record.decimation(), record.settling_rows()), (1, 50));
        let mut gain = vec![0.0; 350];
        // Most of 200 to 300 improves by flipping; 300 to 400 deteriorates.
        gain[150..250].fill(1.0);
        gain[180..200].fill(-2.0);
        gain[250..350].fill(-1.0);
        let sign_flipped = flipped_rows(&record, &gain);
        assert!(sign_flipped[205..295].iter().all(|sign_flipped| *sign_flipped));
        assert!(
            !sign_flipped[..200]
                .iter()
                .chain(&sign_flipped[300..])
                .any(|sign_flipped| *sign_flipped)
        );
    }
}
