//! `--write-rig`: the file that is written makes the plant that was fitted, and keeps what the laboratory wrote.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use identify::outcome::{
    EffectParameter, FittedParameter, FoundEffect, Named, NextExperiment, Outcome, Roles, Sight, UnlistedTable, Verdict,
};
use identify::write_rig::{Written, fitted};
use plant::ParameterSet as _;
use plant::any::Parameters;
use plant::effects::{Effect, Site, make};
use plant::transmission::{Input, Motion, Transmission as _};
use rig::{ParameterSource, RigFile};

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const DRIVE: &str = include_str!("../../../launch/rigs/emps.toml");

fn parameter(name: &str, declared: Option<f64>, fitted: f64, std: Option<f64>) -> FittedParameter {
    FittedParameter {
        name: name.into(),
        declared,
        fitted,
        std,
        unit: String::new(),
        identifiable: std.is_some(),
        at_tolerance: false,
        sight: if std.is_some() { Sight::Seen } else { Sight::Flat },
        trades_with: None,
    }
}

fn effect(id: &str, site: &str, values: &[(&str, f64)]) -> FoundEffect {
    let parameters = values
        .iter()
        .map(|(name, value)| EffectParameter { name: (*name).into(), value: *value, std: None, unit: String::new() })
        .collect();
    FoundEffect { id: id.into(), site: site.into(), parameters, t: 9.0, gain_percent: 40.0 }
}

fn outcome(verdict: Verdict, parameters: Vec<FittedParameter>, effects: Vec<FoundEffect>) -> Outcome {
    Outcome {
        verdict,
        effects,
        ambiguous_with: Vec::new(),
        remains: false,
        unlisted: None,
        calibration: None,
        left: Vec::new(),
        error: Default::default(),
        parameters,
        records: Roles::default(),
        next_experiment: NextExperiment { why: String::new(), what: String::new(), protocol: None },
        steps: Vec::new(),
        candidates: Vec::new(),
        notes: Vec::new(),
        seconds: 0.0,
    }
}

const FITTED: [(&str, f64, f64); 4] = [
    ("motor_torque_per_volt_nm", 1.621_234_567, 0.04),
    ("line_stiffness_factor", 0.062_857_1, 1e-4),
    ("slave_static_friction_nm", 2.531, 0.5),
    ("friction_smoothing_rad_s", 0.071_3, 0.002),
];

fn found(effects: Vec<FoundEffect>) -> Outcome {
    let original = RigFile::parse(RIG, "rig.toml").unwrap();
    let declared = |name: &str| original.model.parameter(name).map(|parameter| parameter.value);
    let parameters = FITTED.iter().map(|(name, value, std)| parameter(name, declared(name), *value, Some(*std)));
    let mut parameters: Vec<_> = parameters.collect();
    parameters.push(parameter("slave_encoder_zero_rad", None, 4e-4, Some(1e-5)));
    parameters.push(parameter("bulk_modulus_pa", declared("bulk_modulus_pa"), 1.86e9, None));
    let verdict = if effects.is_empty() { Verdict::None } else { Verdict::Effect };
    outcome(verdict, parameters, effects)
}

fn text(written: &Written) -> &str {
    written.text.as_deref().unwrap()
}

/// Where a plant is after it was pulled to and fro.
fn moved(parameters: Parameters, effects: Vec<Box<dyn Effect>>) -> Motion {
    let mut plant = parameters.plant(effects).unwrap();
    for row in 0..1500 {
        let motor_v = 5.0 * (12.0 * f64::from(row) * 1e-3).sin();
        plant.step(Input { motor_v, hand_torque_nm: 0.0 }, 1e-3);
    }
    plant.motion()
}

#[test]
fn the_plant_made_from_the_file_is_the_fitted_one() {
    let effects = vec![
        effect("backlash", "slave", &[("gap", 0.061_234)]),
        effect("torque_ripple", "drive", &[("amplitude", 0.13), ("order", 12.0), ("phase", -0.4)]),
    ];
    let written = fitted(RIG, "rig.toml", &found(effects)).unwrap();
    assert_eq!((written.told.as_str(), written.left_out.len()), ("5 parameters as fitted, 2 effects", 0));
    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let of_file = moved(rig.axis_parameters(&rig.axes[0]).unwrap(), rig.model_effects().unwrap());

    let Parameters::Hydrostatic(mut own) = RigFile::parse(RIG, "rig.toml").unwrap().transmission_parameters().unwrap()
    else {
        panic!("a hydrostatic rig")
    };
    for (name, value, _) in FITTED {
        own.set(name, value).unwrap();
    }
    let mut ripple = make("torque_ripple", Site::Drive, 0.13).unwrap();
    ripple.set("order", 12.0).unwrap();
    ripple.set("phase", -0.4).unwrap();
    let direct = moved(own.into(), vec![make("backlash", Site::Slave, 0.061_234).unwrap(), ripple]);
    assert!((of_file.slave_position_rad - direct.slave_position_rad).abs() < 1e-6, "{of_file:?} {direct:?}");
    assert!((of_file.master_velocity_rad_s - direct.master_velocity_rad_s).abs() < 1e-4, "{of_file:?} {direct:?}");
    // And it is another one than the declared.
    let declared = moved(RigFile::parse(RIG, "rig.toml").unwrap().transmission_parameters().unwrap(), Vec::new());
    assert!((of_file.slave_position_rad - declared.slave_position_rad).abs() > 1e-3);
}

#[test]
fn comments_stay_and_tolerances_are_what_the_records_say() {
    let written = fitted(RIG, "rig.toml", &found(Vec::new())).unwrap();
    let kept = |text: &str| -> Vec<String> {
        text.lines().filter_map(|line| line.find('#').map(|at| line[at..].to_owned())).collect()
    };
    let (before, after) = (kept(RIG), kept(text(&written)));
    assert!(before.iter().all(|comment| after.contains(comment)), "{after:#?}");
    assert_eq!(after.len(), before.len() + 1, "one more says what the smoothing is");
    let others = |text: &str| -> Vec<String> {
        let fitted = |line: &&str| FITTED.iter().any(|(name, ..)| line.starts_with(name));
        text.lines().filter(|line| !fitted(line)).map(str::to_owned).collect()
    };
    assert_eq!(others(text(&written)), others(RIG), "lines that have nothing to do with it are as they were");

    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let of = |name: &str| rig.model.parameter(name).unwrap().clone();
    let torque = of("motor_torque_per_volt_nm");
    assert!((torque.value - 1.621_234_567).abs() < 1e-7);
    assert_eq!((torque.tolerance, torque.source), (0.13, ParameterSource::Traced), "5 · 0.04 / 1.62, rounded up");
    assert_eq!(of("line_stiffness_factor").tolerance, 0.084, "a third of the declared, however sure the fit is");
    assert_eq!(of("slave_static_friction_nm").tolerance, 0.25, "no wider than declared");
    let unseen = of("bulk_modulus_pa");
    assert_eq!((unseen.value, unseen.tolerance, unseen.source), (1.86e9, 0.05, ParameterSource::Printed));
    assert!(rig.model.parameter("slave_encoder_zero_rad").is_none(), "it belongs to the recording, not to the machine");
    assert!(rig.model.effects.is_empty());
}

#[test]
fn a_second_time_replaces_the_first() {
    let first = fitted(RIG, "rig.toml", &found(vec![effect("backlash", "slave", &[("gap", 0.06)])])).unwrap();
    let second =
        fitted(text(&first), "rig.toml", &found(vec![effect("leakage", "line", &[("conductance", 5e-13)])])).unwrap();
    let rig = RigFile::parse(text(&second), "rig.toml").unwrap();
    let names: Vec<_> = rig.model.effects.iter().map(|effect| (effect.id, effect.parameters.clone())).collect();
    assert_eq!(names, [("leakage", vec![("conductance".to_owned(), 5e-13)])]);
    assert_eq!(text(&second).matches("Found in measured records").count(), 1);
    assert_eq!(text(&second).matches("friction_smoothing_rad_s").count(), 1);
}

#[test]
fn what_is_not_known_is_not_written_and_said() {
    let mut ambiguous = found(vec![effect("transport_delay", "drive", &[("delay_s", 5e-3)])]);
    ambiguous.verdict = Verdict::Ambiguous;
    ambiguous.ambiguous_with = vec![Named { id: "amplifier_lag".into(), site: "drive".into() }];
    let written = fitted(RIG, "rig.toml", &ambiguous).unwrap();
    assert_eq!(written.text, None);
    assert!(written.left_out[0].contains("cannot tell transport_delay@drive from amplifier_lag@drive"), "{written:?}");

    let mut unlisted = found(Vec::new());
    unlisted.verdict = Verdict::Unlisted;
    unlisted.remains = true;
    unlisted.unlisted =
        Some(UnlistedTable { site: "slave".into(), depends_on: "position".into(), table: vec![[0.0, 0.1, 0.0]] });
    let written = fitted(RIG, "rig.toml", &unlisted).unwrap();
    assert!(written.left_out[0].contains("at the slave, over position"), "{written:?}");
    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let torque = rig.model.parameter("motor_torque_per_volt_nm").unwrap();
    assert_eq!((torque.tolerance, rig.model.effects.len()), (0.25, 0), "a residual without a name narrows nothing");
}

#[test]
fn an_axis_that_has_a_parameter_of_its_own_keeps_it() {
    let own = RIG.replacen(
        "[axes.limits]",
        "[axes.model]\nmotor_torque_per_volt_nm = 1.7 # of this motor\n\n[axes.limits]",
        1,
    );
    let written = fitted(&own, "rig.toml", &found(Vec::new())).unwrap();
    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let axis = &rig.axes[0].model[0];
    assert!((axis.value - 1.621_234_567).abs() < 1e-7, "{axis:?}");
    assert_eq!(rig.model.parameter("motor_torque_per_volt_nm").unwrap().value, 1.8);
    assert!(text(&written).contains("# of this motor"));
}

#[test]
fn of_a_drive_absolute_tolerances_stay_absolute() {
    let parameters = vec![
        parameter("mass_kg", Some(100.0), 95.1, Some(0.1)),
        parameter("force_offset_n", Some(0.0), -3.2, Some(0.9)),
    ];
    let found = outcome(Verdict::Effect, parameters, vec![effect("coulomb_friction", "master", &[("level", 20.4)])]);
    let written = fitted(DRIVE, "emps.toml", &found).unwrap();
    let rig = RigFile::parse(text(&written), "emps.toml").unwrap();
    let offset = rig.model.parameter("force_offset_n").unwrap();
    assert_eq!((offset.value, offset.tolerance_absolute), (-3.2, Some(4.5)));
    assert_eq!(rig.model.effects[0].id, "coulomb_friction");
}

#[test]
fn gains_that_the_fitted_machine_does_not_bear_are_refused_not_written() {
    let mut weak = found(Vec::new());
    // A motor four times as strong: the loop has four times the gain.
    weak.parameters[0].fitted = 14.0;
    let error = fitted(RIG, "rig.toml", &weak).unwrap_err().to_string();
    assert!(error.contains("is not written") && error.contains("axes.0.control.p_v_per_count"), "{error}");
}
