//! Whole cases: the same seed gives the same case, and every effect leaves its mark on the records.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use sealed::case::{Set, unjudged};
use sealed::draw::{Draw, subseed};
use sealed::effects::{listed, unlisted};
use sealed::machine::Machine;
use sealed::model::Model;
use sealed::record::{Noise, Record, SAMPLE_S, run};
use sealed::reference::{Kind, hand, reference};
use sealed::smoothing::{Shape, Smoothing};

#[test]
fn a_case_follows_from_its_seed() {
    let case = unjudged(Set::Pairs, 3, 11, &[]).unwrap();
    let again = unjudged(Set::Pairs, 3, 11, &[]).unwrap();
    assert_eq!(case.truth, again.truth);
    assert_eq!(case.records, again.records);
    assert_ne!(unjudged(Set::Pairs, 3, 12, &[]).unwrap().truth.machine, case.truth.machine);
    assert!((8..=10).contains(&case.records.len()));
    let [one, other] = &case.truth.effects[..] else { panic!("two effects") };
    assert!(one.site != other.site && one.id != other.id);
    assert!(case.truth.records.iter().filter(|plan| plan.hand_seed.is_some()).count() >= 2);
    let repeats = case.truth.records.iter().filter(|plan| plan.reference_seed == case.truth.records[0].reference_seed);
    assert!(repeats.count() >= 2, "a repeat, for the floor");
    for (number, record) in case.records.iter().enumerate() {
        assert_eq!(record.start_s, 15.0 * number as f64);
        assert_eq!(record.motor_v.len(), 20_000);
    }
}

#[test]
fn a_written_case_has_its_records_and_its_truth() {
    let folder = tempfile::tempdir().unwrap();
    let case = unjudged(Set::Clean, 1, 5, &[]).unwrap();
    case.write(folder.path()).unwrap();
    let truth: sealed::case::Truth =
        serde_json::from_str(&std::fs::read_to_string(folder.path().join("truth.json")).unwrap()).unwrap();
    assert_eq!(truth, case.truth);
    assert_ne!(truth.smoothing.shape, Shape::Root, "every second clean case has a foreign smoothing");
    let text = std::fs::read_to_string(folder.path().join(&truth.records[1].file)).unwrap();
    assert_eq!(text.lines().next(), Some("t_s,motor_v,master_rad,slave_rad,slave_torque_nm"));
    assert_eq!(text.lines().count(), 20_001);
    assert!(text.lines().nth(1).unwrap().starts_with("15.0000,"), "time goes on over the records");
}

/// Two seconds with a hand and noise from the same seed, with the effect and without it.
#[test]
fn every_effect_leaves_its_mark() {
    let samples = 4000;
    let wanted = reference(Kind::Multisine, &mut Draw::new(1), samples, SAMPLE_S);
    let torque = hand(&mut Draw::new(2), samples, SAMPLE_S);
    let smoothing = Smoothing { shape: Shape::Root, speed_rad_s: 0.1 };
    let noise = Noise { torque_nm: 2.5e-3, process_nm: [4e-3; 2], process_hz: 10.0 };
    let record = |effect: Option<&sealed::effects::Effect>, start_s: f64| {
        let deviations = effect.map(|effect| effect.build().unwrap()).into_iter().collect();
        let mut model = Model::new(Machine::declared(), smoothing, deviations, SAMPLE_S);
        run(&mut model, &wanted, &torque, start_s, &noise, 7)
    };
    let rms = |one: &[f64], other: &[f64]| {
        let sum: f64 = one.iter().zip(other).map(|(one, other)| (one - other).powi(2)).sum();
        (sum / one.len() as f64).sqrt()
    };
    for entry in listed().into_iter().chain(unlisted()) {
        // Drifts need time to show, warm-ups none.
        let start_s = if entry.id == "sensor_drift" { 100.0 } else { 0.0 };
        let plain: Record = record(None, start_s);
        let effect = entry.draw(&mut Draw::new(subseed(4, entry.id)));
        let with = record(Some(&effect), start_s);
        let change = [
            rms(&plain.master_rad, &with.master_rad) / 5e-4,
            rms(&plain.slave_rad, &with.slave_rad) / 5e-4,
            rms(&plain.slave_torque_nm, &with.slave_torque_nm) / 2.5e-3,
        ];
        let largest = change.into_iter().fold(0.0, f64::max);
        assert!(largest > 1.0, "{}: {change:?} times the noise", effect.name());
        for column in [&with.master_rad, &with.slave_rad, &with.slave_torque_nm, &with.motor_v] {
            assert!(column.iter().all(|value| value.is_finite() && value.abs() < 20.0), "{} runs away", effect.name());
        }
    }
}
