//! Which effects on no list a campaign draws from: the earlier ones stay what they were, and the
//! others are a set by themselves.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeSet;

use blind_cases::case::{Case, DrawnFrom, Set, drawn, make, unjudged};
use blind_cases::effects::{Kinds, unlisted};
use rayon::prelude::*;

fn case(index: usize, kinds: Kinds) -> Case {
    unjudged(Set::Unlisted, index, 1, &DrawnFrom { kinds, ..DrawnFrom::default() }).unwrap()
}

/// Cases of seed 1 as they were before there were others: name, numbers, bulk modulus (Pa), and of
/// the second record at rows 400 and 1200 the volts, master and slave (rad).
type Known = (usize, &'static str, &'static [f64], f64, [[f64; 3]; 2]);

const KNOWN: [Known; 4] = [
    (
        0,
        "gain_over_angle@drive",
        &[0.18148073300352097, 3.0, 1.1033337448724705],
        1857784626.606432,
        [
            [1.34918212890625, 0.11780972450961726, 0.00471238898038469],
            [1.58721923828125, 0.4272566008882119, 0.27174776453551713],
        ],
    ),
    (
        17,
        "acceleration_friction@slave",
        &[-0.24897048020973467, 14.226310996415558],
        1876019101.453105,
        [
            [1.44683837890625, 0.10210176124166828, 0.00942477796076938],
            [1.24237060546875, 0.4618141200776996, 0.3251548396465436],
        ],
    ),
    (
        18,
        "gain_over_angle@drive",
        &[0.24873654282383353, 2.0, 0.4312368659972554],
        1915429949.2340517,
        [
            [1.2689208984375, 0.1837831702350029, 0.045553093477052005],
            [1.06903076171875, 0.8183848862601412, 0.576482251933727],
        ],
    ),
    (
        31,
        "compliant_grip@slave",
        &[0.003111608758424948, 3.4756409255754126, 0.1252272933096562],
        1895081171.7812755,
        [
            [1.45751953125, 0.12880529879718153, 0.012566370614359173],
            [1.4306640625, 0.5387831400906495, 0.3738495257771854],
        ],
    ),
];

#[test]
fn old_cases_are_unchanged() {
    for (index, name, numbers, bulk_modulus_pa, rows) in KNOWN {
        let case = case(index, Kinds::Old);
        let effect = &case.truth.effects[0];
        assert_eq!(effect.name(), name);
        assert_eq!(effect.parameters.0.len(), numbers.len());
        for (value, known) in effect.parameters.0.iter().zip(numbers) {
            assert!(
                (value.value / known - 1.0).abs() < 1e-12,
                "{index}: {} {}",
                value.name,
                value.value
            );
        }
        assert!((case.truth.machine["bulk_modulus_pa"] / bulk_modulus_pa - 1.0).abs() < 1e-12);
        let record = &case.records[1];
        for (row, known) in [400, 1200].into_iter().zip(rows) {
            // A last digit of the mathematics library may move an angle by a count.
            let found = [record.motor_v[row], record.master_rad[row], record.slave_rad[row]];
            for (found, known, slack) in
                [(found[0], known[0], 0.05), (found[1], known[1], 2e-3), (found[2], known[2], 2e-3)]
            {
                assert!((found - known).abs() < slack, "{index}, row {row}: {found} for {known}");
            }
        }
    }
}

#[test]
fn all_kinds_begin_with_the_old_ones_and_new_ones_are_disjoint() {
    let names =
        |kinds: Kinds| -> Vec<&str> { unlisted(kinds).iter().map(|entry| entry.id).collect() };
    let (old, new, all) = (names(Kinds::Old), names(Kinds::New), names(Kinds::All));
    assert_eq!(all, [old.clone(), new.clone()].concat());
    let common: BTreeSet<&&str> = old.iter().filter(|id| new.contains(id)).collect();
    assert!(common.is_empty(), "{common:?}");
    assert!(new.len() >= 8);
    let (one, other) = (case(3, Kinds::Old), case(3, Kinds::All));
    assert_eq!(one.truth, other.truth);
    assert_eq!(one.records, other.records);
    let first = |index: usize, kinds: Kinds| {
        let from = DrawnFrom { kinds, ..DrawnFrom::default() };
        drawn(Set::Unlisted, index, 1, &from).unwrap().effects[0].id.clone()
    };
    assert_eq!(first(3, Kinds::New), new[3]);
    assert_eq!(first(old.len() + 1, Kinds::All), new[1]);
}

/// A good instrument sees every second of the hold-out, and the machine stays within its travel.
/// To judge a case takes seconds; the table of a campaign counts the detectable ones of all.
#[test]
fn new_effects_are_detectable() {
    (0..unlisted(Kinds::New).len()).into_par_iter().step_by(2).for_each(|index| {
        let from = DrawnFrom { kinds: Kinds::New, ..DrawnFrom::default() };
        let case = make(Set::Unlisted, index, 9, &from).unwrap();
        let (effect, seen) = (&case.truth.effects[0], &case.truth.detectability[0]);
        assert!(seen.detectable(), "{} {:?}: {seen:?}", effect.name(), effect.parameters);
        let angles = case
            .records
            .iter()
            .flat_map(|record| record.master_rad.iter().chain(&record.slave_rad));
        let largest = angles.fold(0.0_f64, |largest, angle| largest.max(angle.abs()));
        assert!(largest < 2.0, "{} goes to {largest} rad", effect.name());
    });
}
