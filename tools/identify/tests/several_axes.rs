//! A rig with two axes at one handle: each is identified by itself, with what the motion of the
//! other does to it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::f64::consts::TAU;

use identify::input::Series;
use identify::outcome::{Outcome, Verdict};
use identify::study::{StudyOptions, study};
use plant::coupled_axes::{HandleCoupling, Plant};
use plant::effects::parse;
use plant::transmission::Input;
use rig::RigFile;
use two_sides::{COUNT_RAD, STEP_S, servo_v, uniform_noise};

mod two_sides;

const RIG: &str = include_str!("../../../launch/rigs/two-axis.toml");
const DECLARED: &str = "handle_coupling_kg_m2 = [2.0e-4]";

/// The rig with another line for the coupling of its handle.
fn rig(coupling: &str) -> RigFile {
    RigFile::parse(&RIG.replace(DECLARED, coupling), "two-axis.toml").unwrap()
}

/// Records of both axes in closed loop along sines of their own, or at rest where `moves` says so,
/// with this coupling of the handle (kg·m²) and effects by axis. A hand pushes the first axis in
/// the last record.
fn records(coupling: f64, effects: [&[&str]; 2], moves: [bool; 2]) -> Vec<Series> {
    (0..6).map(|turn| record(turn, coupling, effects, moves)).collect()
}

fn record(turn: usize, coupling: f64, effects: [&[&str]; 2], moves: [bool; 2]) -> Series {
    let declared = rig(DECLARED);
    let axes = [0, 1].map(|axis: usize| {
        let mut own = declared.axis_parameters(&declared.axes[axis]).unwrap();
        let torque = if axis == 0 { 1.8 * 0.93 } else { 1.8 * 1.06 };
        own.set("motor_torque_per_volt_nm", torque).unwrap();
        own.set("motor_coulomb_nm", 0.767 * 1.05).unwrap();
        own.plant(effects[axis].iter().map(|name| parse(name).unwrap()).collect()).unwrap()
    });
    let handle = HandleCoupling::of_pairs(2, &[coupling]).unwrap();
    let mut plant = Plant::new(axes.to_vec(), &handle).unwrap();
    // The fourth record and the next repeat the first two, which gives the noise floor.
    let phase = 0.7 + 1.9 * (turn % 3) as f64;
    let mut random = uniform_noise(5 + turn as u64);
    let rows = 4000;
    let mut columns: [Vec<f64>; 9] = std::array::from_fn(|_| Vec::with_capacity(rows));
    for row in 0..rows {
        let t = row as f64 * STEP_S;
        let rise = (t / 0.5).min(1.0);
        let sine = |size: f64, hz: f64, phase: f64| size * (TAU * hz * t + phase).sin();
        let references = [
            sine(0.45, 0.6, phase) + sine(0.2, 1.7, 2.0 * phase) + sine(0.05, 5.3, 0.0),
            sine(0.4, 0.5, 1.0 + phase) + sine(0.25, 1.9, phase) + sine(0.05, 4.1, 0.3),
        ];
        let mut inputs = [Input::default(); 2];
        columns[0].push(4.0 * turn as f64 + t);
        for axis in 0..2 {
            let motion = plant.motion(axis);
            let reference = if moves[axis] { rise * references[axis] } else { 0.0 };
            let volts = servo_v(reference, &motion);
            let pushed = axis == 0 && turn == 5;
            let hand = if pushed { 2.0 * rise * (TAU * 0.9 * t).sin() } else { 0.0 };
            let counts = |rad: f64, dither: f64| ((rad / COUNT_RAD + dither).round()) * COUNT_RAD;
            let values = [
                volts,
                counts(motion.master_position_rad, 0.6 * random()),
                counts(motion.slave_position_rad, 0.6 * random()),
                hand + 4e-3 * random(),
            ];
            for (column, value) in columns[1 + 4 * axis..].iter_mut().zip(values) {
                column.push(value);
            }
            inputs[axis] = Input { motor_v: volts, hand_torque_nm: hand };
        }
        plant.step(&inputs, STEP_S);
    }
    let names = ["motor_v", "master_rad", "slave_rad", "slave_torque_nm"];
    let of_axis = |axis: &str| names.map(|name| format!("{axis}.{name}"));
    let names = [vec!["t_s".to_owned()], of_axis("flexion").into(), of_axis("rotation").into()];
    let columns = names.concat().into_iter().zip(columns).collect();
    Series { file: format!("record-{turn}.csv"), columns, ..Series::default() }
}

/// What is said of an axis, from the columns that are its own and those of the other.
fn said(rig: &RigFile, axis: usize, records: &[Series]) -> Outcome {
    let own = format!("{}.", rig.axes[axis].name);
    let records: Vec<Series> = records
        .iter()
        .map(|record| {
            let mut record = record.clone();
            for (name, _) in &mut record.columns {
                *name = name.strip_prefix(&own).unwrap_or(name).to_owned();
            }
            record
        })
        .collect();
    let how = StudyOptions { axis, ..StudyOptions::default() };
    let studied = study(rig, &records, how).unwrap();
    let begins = format!("Axis \"{}\": ", rig.axes[axis].name);
    assert!(studied.sentence.starts_with(&begins), "{}", studied.sentence);
    let outcome = studied.outcome;
    println!(
        "axis {axis}: {:?} {:?} {:?}, {:.1} s",
        outcome.verdict, outcome.effects, outcome.error, outcome.seconds
    );
    outcome
}

/// The product of inertia beyond the declared that was found, with its standard deviation.
fn beyond(outcome: &Outcome, with: &str) -> (f64, f64) {
    let [effect] = &outcome.effects[..] else { panic!("{:?}", outcome.effects) };
    assert_eq!((effect.id.as_str(), effect.site.as_str()), ("handle_coupling", "slave"));
    let [product] = &effect.parameters[..] else { panic!("{effect:?}") };
    assert_eq!((product.name.as_str(), product.unit.as_str()), (with, "kg m^2"));
    (product.value, product.std.unwrap())
}

/// The product of inertia as fitted within its tolerance.
fn fitted(outcome: &Outcome, other: &str) -> f64 {
    let name = format!("handle_coupling_kg_m2.{other}");
    outcome.parameters.iter().find(|parameter| parameter.name == name).unwrap().fitted
}

#[test]
fn a_declared_coupling_is_calibrated_and_nothing_is_missing() {
    let (rig, records) = (rig(DECLARED), records(2.3e-4, [&[], &[]], [true; 2]));
    for (axis, other) in [(0, "rotation"), (1, "flexion")] {
        let outcome = said(&rig, axis, &records);
        assert_eq!(outcome.verdict, Verdict::None);
        assert_eq!(outcome.axis.as_deref(), Some(rig.axes[axis].name.as_str()));
        assert!((fitted(&outcome, other) - 2.3e-4).abs() < 3e-5);
        assert!(!outcome.notes.iter().any(|note| note.contains("not used")));
    }
}

#[test]
fn a_coupling_that_nobody_declared_is_found_with_its_size() {
    let outcome = said(&rig(""), 0, &records(6e-4, [&[], &[]], [true; 2]));
    assert_eq!(outcome.verdict, Verdict::Effect);
    let (product, std) = beyond(&outcome, "with_axis_1");
    assert!((product - 6e-4).abs() < 4e-5, "{product}");
    assert!(std < 4e-5, "{std}");
    let slave = &outcome.error["slave_rad"];
    assert!(slave.after < 0.4 * slave.before, "{slave:?}");
}

#[test]
fn a_coupling_beyond_its_tolerance_is_found_beside_the_declared_part() {
    let outcome = said(&rig(DECLARED), 1, &records(8e-4, [&[], &[]], [true; 2]));
    assert_eq!(outcome.verdict, Verdict::Effect);
    let whole = beyond(&outcome, "with_axis_0").0 + fitted(&outcome, "flexion");
    assert!((whole - 8e-4).abs() < 8e-5, "{whole}");
}

#[test]
fn an_effect_belongs_to_the_axis_that_has_it() {
    let (rig, records) = (rig(DECLARED), records(2e-4, [&[], &["backlash@slave=0.06"]], [true; 2]));
    assert_eq!(said(&rig, 0, &records).verdict, Verdict::None);
    let outcome = said(&rig, 1, &records);
    let [effect] = &outcome.effects[..] else { panic!("{:?}", outcome.effects) };
    assert_eq!((effect.id.as_str(), effect.site.as_str()), ("backlash", "slave"));
    assert!((effect.parameters[0].value - 0.06).abs() < 0.004, "{effect:?}");
}

/// Where the other axis was not recorded, its motion is left out, which is told; while it was at
/// rest, nothing is missing for that.
#[test]
fn an_axis_that_was_not_recorded_is_told() {
    let mut records = records(2e-4, [&[], &[]], [true, false]);
    for record in &mut records {
        record.columns.retain(|(name, _)| !name.starts_with("rotation."));
    }
    let outcome = said(&rig(DECLARED), 0, &records);
    assert_eq!(outcome.verdict, Verdict::None);
    assert!(
        outcome.notes.iter().any(|note| note.contains("`rotation.slave_rad`")),
        "{:?}",
        outcome.notes
    );
    assert!(outcome.parameters.iter().all(|own| !own.name.starts_with("handle_coupling")));
}
