//! What must hold for every transmission of the list, with every effect of the list.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{DT_S, effects, observed_errors, trajectory};
use plant::ParameterError;
use plant::effects::{LIST, of_one_axis, of_plants};
use plant::transmission::{Correction, Input, Reading, Transmission};
use plant::transmission_kinds::{Kind, Plant};

fn traced(kind: Kind, names: &[&str]) -> Plant {
    kind.calibrated().plant(effects(names)).unwrap()
}

/// A movement through stick and slip by motor and hand; the reading after each step.
fn moved(mut plant: Plant) -> (Plant, Vec<Reading>) {
    let readings = (0..4000).map(|index| {
        let time = f64::from(index) * DT_S;
        let input =
            Input { motor_v: 6.0 * (9.0 * time).sin(), hand_torque_nm: 2.0 * (4.0 * time).cos() };
        plant.step(input, DT_S);
        plant.reading()
    });
    let readings = readings.collect();
    (plant, readings)
}

#[track_caller]
fn assert_balance_closes(plant: &Plant, what: &str) {
    let energy = plant.energy();
    assert!(energy.throughput_j > 0.1, "{what}: {energy:?}");
    assert!(energy.defect_j().abs() < 2e-3 * energy.throughput_j, "{what}: {energy:?}");
}

/// Every effect at each of its sites changes what the instruments read, and the energy it takes is
/// accounted for; or the transmission refuses it.
#[test]
fn every_effect_changes_the_output_at_each_of_its_sites() {
    for &kind in Kind::ALL {
        let (_, without) = moved(traced(kind, &[]));
        for entry in of_one_axis() {
            for place in entry.sites {
                let name = format!("{}@{}", entry.id, place.site);
                let what = format!("{name} in a {} transmission", kind.name());
                let plant = match kind.calibrated().plant(effects(&[&name])) {
                    Ok(plant) => plant,
                    Err(ParameterError::EffectNotApplicable { id, .. }) => {
                        assert_eq!((id, entry.id), ("leakage", "leakage"), "{what}");
                        continue;
                    }
                    Err(error) => panic!("{what}: {error}"),
                };
                let (with, readings) = moved(plant);
                let change = |(a, b): (&Reading, &Reading)| {
                    (a.master_rad - b.master_rad).abs()
                        + (a.slave_rad - b.slave_rad).abs()
                        + (a.slave_torque_nm - b.slave_torque_nm).abs()
                };
                let change =
                    readings.iter().zip(&without).map(change).sum::<f64>() / without.len() as f64;
                assert!(change.is_finite() && change > 1e-5, "{what}: {change}");
                assert_balance_closes(&with, &what);
                assert_eq!(with.clone().state(), with.state());
            }
        }
    }
}

#[test]
fn steps_converge_through_stick_and_slip() {
    for &kind in Kind::ALL {
        let errors = observed_errors(0.1e-3, 0.1e-3 / 128.0, |dt| {
            trajectory(traced(kind, &[]), dt, 4.0, |plant| {
                let state = plant.state();
                [state.master_position_rad, state.slave_position_rad, state.line_position_m[0]]
            })
        });
        assert!(errors[0] < 1e-2 && errors[3] < 0.5 * errors[0], "{}: {errors:?}", kind.name());
    }
}

#[test]
fn stored_energy_only_falls_without_input() {
    for &kind in Kind::ALL {
        let mut plant = traced(kind, &[]);
        for _ in 0..600 {
            plant.step(Input { motor_v: 8.0, hand_torque_nm: 0.0 }, DT_S);
        }
        let start = plant.energy().stored_j;
        let mut last = start;
        for _ in 0..4000 {
            plant.step(Input::default(), DT_S);
            let stored = plant.energy().stored_j;
            assert!(stored <= last + 2e-3 * start, "{}: {last} {stored}", kind.name());
            last = stored;
        }
        assert!(last < 0.1 * start, "{}: {last} of {start}", kind.name());
    }
}

#[test]
fn a_correction_stays_out_of_the_balance() {
    for &kind in Kind::ALL {
        let mut plant = traced(kind, &[]);
        for index in 0..4000 {
            let time = f64::from(index) * DT_S;
            plant.step(Input { motor_v: 5.0 * (8.0 * time).sin(), hand_torque_nm: 0.0 }, DT_S);
            plant.correct(Correction {
                slave_position_rad: 1e-4 * (3.0 * time).sin(),
                ..Correction::default()
            });
        }
        assert_balance_closes(&plant, kind.name());
    }
}

/// Hooks that are not called would do nothing: a nonlinear spring of size 0 has all of them called.
#[test]
fn hooks_are_left_out_only_where_they_do_nothing() {
    const NO_SPRING: &str = "nonlinear_stiffness@line=0";
    for &kind in Kind::ALL {
        for entry in of_plants().filter(|entry| entry.id != "leakage") {
            for place in entry.sites {
                let name = format!("{}@{}", entry.id, place.site);
                let (_, with_all) = moved(traced(kind, &[&name, NO_SPRING]));
                let (_, readings) = moved(traced(kind, &[&name]));
                assert_eq!(readings, with_all, "{name}: does it act on the links of its side?");
            }
        }
    }
}

#[test]
fn without_its_energy_balance_a_plant_moves_alike() {
    for &kind in Kind::ALL {
        for names in [&[][..], &["backlash@slave"], &["coulomb_friction@master"]] {
            let (_, alike) = moved(traced(kind, names).without_energy_balance());
            assert_eq!(moved(traced(kind, names)).1, alike, "{names:?}");
        }
    }
}

/// A file in `src/effects` that declares an effect has a line in [`LIST`].
#[test]
fn every_effect_file_is_listed() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/effects");
    let mut declared = 0;
    for file in std::fs::read_dir(folder).unwrap() {
        let path = file.unwrap().path();
        if path.is_dir() {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        if !text.contains("\neffect! {") && !text.contains("ENTRY: Entry = Entry::of_one_channel(")
        {
            continue;
        }
        let id = path.file_stem().unwrap().to_str().unwrap();
        // Part of the simulated machine, not a deviation from its model.
        if id != "end_stop" {
            assert!(LIST.iter().any(|entry| entry.id == id), "{id} is missing in LIST");
            declared += 1;
        }
    }
    assert_eq!(declared, LIST.len());
}
