//! Whole cases: the same seed gives the same case, and every effect leaves its mark on the records.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::HashSet;

use blind_cases::case::{DrawnFrom, Set, drawn, unjudged};
use blind_cases::case_plan::Builder;
use blind_cases::effects::{Kinds, beside, listed, unlisted};
use blind_cases::machine_parameters::MachineParameters;
use blind_cases::random::{Draw, subseed};
use blind_cases::record::{Noise, Record, SAMPLE_S, run};
use blind_cases::reference::{Kind, hand, reference};
use blind_cases::rules::{Missing, Rules};
use blind_cases::simulator::{Input, MOST, Simulator, State};
use blind_cases::smoothing::{Shape, Smoothing};

#[test]
fn a_case_follows_from_its_seed() {
    let case = unjudged(Set::Pairs, 3, 11, &DrawnFrom::default()).unwrap();
    let again = unjudged(Set::Pairs, 3, 11, &DrawnFrom::default()).unwrap();
    assert_eq!(case.truth, again.truth);
    assert_eq!(case.records, again.records);
    assert_ne!(
        drawn(Set::Pairs, 3, 12, &DrawnFrom::default()).unwrap().machine,
        case.truth.machine
    );
    assert!((8..=10).contains(&case.records.len()));
    let [one, other] = &case.truth.effects[..] else { panic!("two effects") };
    assert!(one.site != other.site && one.id != other.id);
    assert!(case.truth.records.iter().filter(|plan| plan.hand_seed.is_some()).count() >= 2);
    let repeats = case
        .truth
        .records
        .iter()
        .filter(|plan| plan.reference_seed == case.truth.records[0].reference_seed);
    assert!(repeats.count() >= 2, "a repeat, for the floor");
    for (number, record) in case.records.iter().enumerate() {
        assert_eq!(record.start_s, 15.0 * number as f64);
        assert_eq!(record.motor_v.len(), 20_000);
    }
}

#[test]
fn a_written_case_has_its_records_and_its_truth() {
    let folder = tempfile::tempdir().unwrap();
    let case = unjudged(Set::Clean, 1, 5, &DrawnFrom::default()).unwrap();
    case.write(folder.path()).unwrap();
    let truth: blind_cases::case::Truth =
        serde_json::from_str(&std::fs::read_to_string(folder.path().join("truth.json")).unwrap())
            .unwrap();
    assert_eq!(truth, case.truth);
    assert_ne!(
        truth.smoothing.shape,
        Shape::Root,
        "every second clean case has a foreign smoothing"
    );
    let text = std::fs::read_to_string(folder.path().join(&truth.records[1].file)).unwrap();
    assert_eq!(text.lines().next(), Some("t_s,motor_v,master_rad,slave_rad,slave_torque_nm"));
    assert_eq!(text.lines().count(), 20_001);
    assert!(text.lines().nth(1).unwrap().starts_with("15.0000,"), "time goes on over the records");
}

#[test]
fn three_effects_act_at_three_sites() {
    let truth = drawn(Set::Triples, 0, 7, &DrawnFrom::default()).unwrap();
    let sites: HashSet<_> = truth.effects.iter().map(|effect| effect.site).collect();
    assert_eq!((truth.effects.len(), sites.len()), (3, 3));
}

/// Cases that are drawn at lower rates, with a slave that sticks, with lost rows and without a
/// torque cell, and without an encoder at the slave.
#[test]
fn a_case_by_the_harder_rules_is_written_as_its_conditions_have_it() {
    let from = DrawnFrom { rules: Rules::Harder, ..DrawnFrom::default() };
    let (mut slower, mut lossy, mut stuck, mut missing) = (0, 0, 0, HashSet::new());
    for index in [3, 8, 9] {
        let case = unjudged(Set::Clean, index, 7, &from).unwrap();
        let taken = case.truth.conditions;
        let folder = tempfile::tempdir().unwrap();
        let files = case.write_records(folder.path()).unwrap();
        let text = std::fs::read_to_string(&files[0]).unwrap();
        let columns: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        assert_eq!(columns.len(), if taken.missing.is_some() { 4 } else { 5 }, "{taken:?}");
        missing.extend(taken.missing.map(Missing::name));
        let (rows, most) = (text.lines().count() - 1, 20_000 / taken.stride);
        assert!(rows <= most && rows >= most - most / 100, "{rows} of {most}");
        slower += usize::from(taken.stride > 1);
        lossy += usize::from(rows < most);
        if let Some(record) = taken.stuck {
            let slave = &case.records[record].slave_rad;
            let (low, high) = slave.iter().fold((0.0_f64, 0.0_f64), |(low, high), position| {
                (low.min(*position), high.max(*position))
            });
            assert!(high - low < 0.02, "it moves by {} rad", high - low);
            stuck += 1;
        }
    }
    assert!(slower > 0 && lossy > 0 && stuck > 0, "{slower} {lossy} {stuck}");
    assert_eq!(missing, HashSet::from(["slave_rad", "slave_torque_nm"]));
}

/// Every pair that the set of pairs can draw, in either order: each has room, and its first sample
/// is a number.
#[test]
fn every_pair_can_be_built() {
    let smoothing = Smoothing { shape: Shape::Root, speed_rad_s: 0.1 };
    let (mut pairs, mut most) = (0, 0);
    for first in listed() {
        for second in beside(&[first]) {
            let mut draw = Draw::new(subseed(5, &format!("{} {}", first.id, second.id)));
            let effects = vec![first.draw(&mut draw), second.draw(&mut draw)];
            let names: Vec<String> =
                effects.iter().map(blind_cases::effects::Effect::name).collect();
            let machine = MachineParameters::drawn(&mut draw);
            let model = Builder { machine, smoothing, effects }.model(None).unwrap();
            let mut state = State::default();
            model.advance(&mut state, 0.0, 0.0, &Input { volts: &[2.0], ..Input::default() });
            assert!(state.0.iter().all(|value| value.is_finite()), "{names:?}");
            (pairs, most) = (pairs + 1, most.max(model.states()));
        }
    }
    assert!(pairs > 1000, "{pairs} pairs");
    assert!(
        (41..=MOST).contains(&most),
        "dead time of the line beside an effect with a state: {most} states"
    );
}

/// Two seconds with a hand and noise from the same seed, with the effect and without it.
#[test]
fn every_effect_changes_the_records() {
    let wanted = reference(Kind::Multisine, &mut Draw::new(1), 8000, SAMPLE_S);
    let torque = hand(&mut Draw::new(2), 8000, SAMPLE_S);
    let smoothing = Smoothing { shape: Shape::Root, speed_rad_s: 0.1 };
    let noise = Noise { torque_nm: 2.5e-3, process_nm: [4e-3; 2], process_hz: 10.0 };
    let record = |effect: Option<&blind_cases::effects::Effect>, start_s: f64, samples: usize| {
        let deviations = effect.map(|effect| effect.build().unwrap()).into_iter().collect();
        let mut model =
            Simulator::new(MachineParameters::declared(), smoothing, deviations, SAMPLE_S).unwrap();
        run(&mut model, &wanted[..samples], &torque[..samples], start_s, &noise, 7)
    };
    let rms = |one: &[f64], other: &[f64]| {
        let sum: f64 = one.iter().zip(other).map(|(one, other)| (one - other).powi(2)).sum();
        (sum / one.len() as f64).sqrt()
    };
    // The machine without an effect does not depend on time.
    let without: [Record; 2] = [4000, 8000].map(|samples| record(None, 0.0, samples));
    for entry in listed().into_iter().chain(unlisted(Kinds::All)) {
        // Drifts and windings need time to show, warm-ups none.
        let samples = if entry.id == "thermal_foldback" { 8000 } else { 4000 };
        let start_s = if entry.id == "sensor_drift" { 100.0 } else { 0.0 };
        let plain = &without[usize::from(samples == 8000)];
        let effect = entry.draw(&mut Draw::new(subseed(4, entry.id)));
        let with = record(Some(&effect), start_s, samples);
        let change = [
            rms(&plain.master_rad, &with.master_rad) / 5e-4,
            rms(&plain.slave_rad, &with.slave_rad) / 5e-4,
            rms(&plain.slave_torque_nm, &with.slave_torque_nm) / 2.5e-3,
        ];
        let largest = change.into_iter().fold(0.0, f64::max);
        assert!(largest > 1.0, "{}: {change:?} times the noise", effect.name());
        for column in [&with.master_rad, &with.slave_rad, &with.slave_torque_nm, &with.motor_v] {
            assert!(
                column.iter().all(|value| value.is_finite() && value.abs() < 20.0),
                "{} runs away",
                effect.name()
            );
        }
    }
}
