//! A torque channel that never shows one sign: which of its rows may have had the other one.
//!
//! A sensor that rectifies by more than half shows both signs as one; taken back, each reading has
//! two torques. Between two moments at which it shows nothing the torque kept its sign. Which one
//! it was, the movement tells: the model is pulled along twice, with the readings as they are and
//! turned around, and of every such stretch that sign is taken that leaves less.

use super::machine::{Machine, Setting};
use super::record::Record;

/// A channel is folded where what it shows of the one sign is no more than this share of what it
/// shows of the other.
const ONE_SIDED: f64 = 0.05;
/// Readings below this share of the largest are next to nothing.
const NOTHING: f64 = 0.015;
/// Share of the rows that are left out at either end of their order: single rows of noise make no
/// sign.
const OUTLYING: f64 = 0.01;

/// Records with a hand, where none of them shows both signs; else nothing.
pub fn folded(machine: &Machine) -> Vec<usize> {
    let with_hand =
        |index: &usize| !machine.records[*index].idle && machine.records[*index].torque.is_some();
    let hands: Vec<usize> = (0..machine.records.len()).filter(with_hand).collect();
    if hands.iter().all(|index| is_one_sided(&machine.records[*index])) {
        hands
    } else {
        Vec::new()
    }
}

/// Tells the rows of such records apart, by a setting that was fitted without them. `None` where it
/// cannot be simulated.
pub fn unfold(machine: &mut Machine, hands: Vec<usize>, setting: &Setting) -> Option<()> {
    let mut turned = machine.clone();
    for index in &hands {
        let torque = turned.records[*index].torque.iter_mut().flatten();
        torque.for_each(|reading| *reading = -*reading);
    }
    for index in hands {
        let (straight, other) =
            (machine.residual(setting, index)?, turned.residual(setting, index)?);
        // The torque itself is not among the channels: somebody was at the handle.
        let gain: Vec<f64> = (0..straight.channels.first()?.len())
            .map(|row| {
                let channels = straight.channels.iter().zip(&other.channels);
                channels.map(|(straight, other)| straight[row].powi(2) - other[row].powi(2)).sum()
            })
            .collect();
        let record = &mut machine.records[index];
        record.turned = turned_rows(record, &gain);
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

/// Rows of a record whose reading leaves less when turned around; `gain` is what it leaves less,
/// for each row of the residual.
fn turned_rows(record: &Record, gain: &[f64]) -> Vec<bool> {
    let torque = record.torque.as_deref().unwrap_or_default();
    let (width, settling) = (record.decimation(), record.settling_rows());
    let of = |row: usize| {
        (row / width).checked_sub(settling).and_then(|at| gain.get(at)).copied().unwrap_or(0.0)
    };
    let mut turned = vec![false; torque.len()];
    let mut from = 0;
    for to in zeros(torque).into_iter().chain([torque.len()]) {
        let better = (from..to).map(of).sum::<f64>() > 0.0;
        turned[from..to].fill(better);
        from = to;
    }
    turned
}

/// Rows at which a torque that is shown without its sign is nearest to nothing: one of each stretch
/// of rows that show next to nothing.
fn zeros(torque: &[f64]) -> Vec<usize> {
    let nothing = NOTHING * torque.iter().fold(0.0, |most: f64, reading| most.max(*reading));
    let stretches = torque.chunk_by(|one, next| (*one > nothing) == (*next > nothing));
    let mut start = 0;
    let mut zeros = Vec::new();
    for stretch in stretches {
        let least = stretch.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
        zeros.extend(least.filter(|(_, reading)| **reading <= nothing).map(|(at, _)| start + at));
        start += stretch.len();
    }
    zeros
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::inverse::split::Role;

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
            turned: Vec::new(),
            role: Role::Fit,
            count_rad: [1e-3; 2],
            idle: false,
        }
    }

    #[test]
    fn readings_of_one_sign_are_told_from_those_of_both() {
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
    fn a_stretch_between_two_zeros_is_turned_as_a_whole() {
        let torque: Vec<f64> = (0..400)
            .map(|row| (std::f64::consts::TAU * f64::from(row) / 200.0).sin().abs())
            .collect();
        let record = record(torque);
        // One row of the residual for each of the record; 50 are left out at the start.
        assert_eq!((record.decimation(), record.settling_rows()), (1, 50));
        let mut gain = vec![0.0; 350];
        // Of the stretch from 200 to 300 most says that it was turned; of that from 300 to 400,
        // that it was not.
        gain[150..250].fill(1.0);
        gain[180..200].fill(-2.0);
        gain[250..350].fill(-1.0);
        let turned = turned_rows(&record, &gain);
        assert!(turned[205..295].iter().all(|turned| *turned));
        assert!(!turned[..200].iter().chain(&turned[300..]).any(|turned| *turned));
    }
}
