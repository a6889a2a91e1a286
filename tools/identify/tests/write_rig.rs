//! `--write-rig`: the file that is written makes the plant that was fitted, and keeps what the
//! laboratory wrote.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use identify::outcome::{
    EffectParameter, FittedParameter, FoundEffect, Named, NextExperiment, Outcome, Roles, Sight,
    UNKNOWN, UnlistedTable, Verdict,
};
use identify::write_rig::{Written, fitted};
use plant::ParameterSet as _;
use plant::any::Parameters;
use plant::drive;
use plant::effects::{Effect, Moment, Side, SideLoad, Site, make};
use plant::friction::Load;
use plant::transmission::{Input, Motion, Transmission as _};
use rig::{ParameterSource, RigFile};

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const DRIVE: &str = include_str!("../../../launch/rigs/emps.toml");
const ELEMENT: &str = include_str!("../../../launch/rigs/element.toml");
const OSCILLATOR: &str = include_str!("../../../launch/rigs/silverbox.toml");

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
        .map(|(name, value)| EffectParameter {
            name: (*name).into(),
            value: *value,
            std: None,
            unit: String::new(),
        })
        .collect();
    FoundEffect { id: id.into(), site: site.into(), parameters, t: 9.0, gain_percent: 40.0 }
}

/// As a fit of one channel tells it: names of its own, with units.
fn found_by_columns(id: &str, site: &str, values: &[(&str, f64, &str)]) -> FoundEffect {
    let plain: Vec<(&str, f64)> = values.iter().map(|(name, value, _)| (*name, *value)).collect();
    let mut found = effect(id, site, &plain);
    for (parameter, (_, _, unit)) in found.parameters.iter_mut().zip(values) {
        parameter.unit = (*unit).into();
    }
    found
}

/// A declared parameter in its unit: declared, fitted.
fn in_unit(name: &str, unit: &str, (declared, fitted): (f64, f64)) -> FittedParameter {
    FittedParameter {
        unit: unit.into(),
        ..parameter(name, Some(declared), fitted, Some(1e-3 * fitted.abs()))
    }
}

/// The file that is written for a model of one channel.
fn written_for(
    original: &str,
    parameters: Vec<FittedParameter>,
    effects: Vec<FoundEffect>,
) -> (Written, RigFile) {
    let written =
        fitted(original, "rig.toml", &outcome(Verdict::Effect, parameters, effects)).unwrap();
    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    (written, rig)
}

fn outcome(
    verdict: Verdict,
    parameters: Vec<FittedParameter>,
    effects: Vec<FoundEffect>,
) -> Outcome {
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

const FITTED: [(&str, f64, f64); 5] = [
    ("motor_torque_per_volt_nm", 1.621_234_567, 0.04),
    ("line_stiffness_factor", 0.062_857_1, 1e-4),
    ("slave_static_friction_nm", 2.531, 0.5),
    ("friction_smoothing_rad_s", 0.071_3, 0.002),
    ("friction_smoothing_shape", -0.6, 0.1),
];

fn found(effects: Vec<FoundEffect>) -> Outcome {
    let original = RigFile::parse(RIG, "rig.toml").unwrap();
    let declared = |name: &str| original.model.parameter(name).map(|parameter| parameter.value);
    let parameters =
        FITTED.iter().map(|(name, value, std)| parameter(name, declared(name), *value, Some(*std)));
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
    assert_eq!(
        (written.told.as_str(), written.left_out.len()),
        ("6 parameters as fitted, 2 effects", 0)
    );
    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let of_file = moved(rig.axis_parameters(&rig.axes[0]).unwrap(), rig.model_effects().unwrap());

    let Parameters::Hydrostatic(mut own) =
        RigFile::parse(RIG, "rig.toml").unwrap().transmission_parameters().unwrap()
    else {
        panic!("a hydrostatic rig")
    };
    for (name, value, _) in FITTED {
        own.set(name, value).unwrap();
    }
    let mut ripple = make("torque_ripple", Site::Drive, 0.13).unwrap();
    ripple.set("order", 12.0).unwrap();
    ripple.set("phase", -0.4).unwrap();
    let direct =
        moved(own.clone().into(), vec![make("backlash", Site::Slave, 0.061_234).unwrap(), ripple]);
    assert!(
        (of_file.slave_position_rad - direct.slave_position_rad).abs() < 1e-6,
        "{of_file:?} {direct:?}"
    );
    assert!(
        (of_file.master_velocity_rad_s - direct.master_velocity_rad_s).abs() < 1e-4,
        "{of_file:?} {direct:?}"
    );
    // With dry friction rounded in another shape it would be another.
    own.set("friction_smoothing_shape", 0.0).unwrap();
    let plain = moved(own.clone().into(), Vec::new());
    own.set("friction_smoothing_shape", -0.6).unwrap();
    let long = moved(own.into(), Vec::new());
    assert!(
        (plain.slave_position_rad - long.slave_position_rad).abs() > 1e-5,
        "{plain:?} {long:?}"
    );
    // And it is another one than the declared.
    let declared = moved(
        RigFile::parse(RIG, "rig.toml").unwrap().transmission_parameters().unwrap(),
        Vec::new(),
    );
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
    assert_eq!(
        after.len(),
        before.len() + 2,
        "two more say what speed and shape of the smoothing are"
    );
    let others = |text: &str| -> Vec<String> {
        let fitted = |line: &&str| FITTED.iter().any(|(name, ..)| line.starts_with(name));
        text.lines().filter(|line| !fitted(line)).map(str::to_owned).collect()
    };
    assert_eq!(
        others(text(&written)),
        others(RIG),
        "lines that have nothing to do with it are as they were"
    );

    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let of = |name: &str| rig.model.parameter(name).unwrap().clone();
    let torque = of("motor_torque_per_volt_nm");
    assert!((torque.value - 1.621_234_567).abs() < 1e-7);
    assert_eq!(
        (torque.tolerance, torque.source),
        (0.13, ParameterSource::Traced),
        "5 · 0.04 / 1.62, rounded up"
    );
    assert_eq!(
        of("line_stiffness_factor").tolerance,
        0.084,
        "a third of the declared, however sure the fit is"
    );
    assert_eq!(of("slave_static_friction_nm").tolerance, 0.25, "no wider than declared");
    assert_eq!(of("friction_smoothing_shape").value, -0.6);
    let unseen = of("bulk_modulus_pa");
    assert_eq!(
        (unseen.value, unseen.tolerance, unseen.source),
        (1.86e9, 0.05, ParameterSource::Printed)
    );
    assert!(
        rig.model.parameter("slave_encoder_zero_rad").is_none(),
        "it belongs to the recording, not to the machine"
    );
    assert!(rig.model.effects.is_empty());
}

#[test]
fn a_second_time_replaces_the_first() {
    let first =
        fitted(RIG, "rig.toml", &found(vec![effect("backlash", "slave", &[("gap", 0.06)])]))
            .unwrap();
    let second = fitted(
        text(&first),
        "rig.toml",
        &found(vec![effect("leakage", "line", &[("conductance", 5e-13)])]),
    )
    .unwrap();
    let rig = RigFile::parse(text(&second), "rig.toml").unwrap();
    let names: Vec<_> =
        rig.model.effects.iter().map(|effect| (effect.id, effect.parameters.clone())).collect();
    assert_eq!(names, [("leakage", vec![("conductance".to_owned(), 5e-13)])]);
    assert_eq!(text(&second).matches("Found in measured records").count(), 1);
    assert_eq!(text(&second).matches("\nfriction_smoothing_rad_s = ").count(), 1);
    assert_eq!(text(&second).matches("\nfriction_smoothing_shape = ").count(), 1);
}

#[test]
fn what_is_not_known_is_not_written_and_said() {
    let mut ambiguous = found(vec![effect("transport_delay", "drive", &[("delay_s", 5e-3)])]);
    ambiguous.verdict = Verdict::Ambiguous;
    ambiguous.ambiguous_with = vec![Named { id: "amplifier_lag".into(), site: "drive".into() }];
    let written = fitted(RIG, "rig.toml", &ambiguous).unwrap();
    assert_eq!(written.text, None);
    assert!(
        written.left_out[0].contains("cannot tell transport_delay@drive from amplifier_lag@drive"),
        "{written:?}"
    );

    let mut unlisted = found(Vec::new());
    unlisted.verdict = Verdict::Unlisted;
    unlisted.remains = true;
    let told = |depends_on: &str, table: Vec<[f64; 3]>| {
        Some(UnlistedTable {
            site: "slave".into(),
            depends_on: depends_on.into(),
            table,
            ..UnlistedTable::default()
        })
    };
    unlisted.unlisted = told(UNKNOWN, Vec::new());
    let written = fitted(RIG, "rig.toml", &unlisted).unwrap();
    assert!(written.left_out[0].contains("explains (at the slave); tolerances"), "{written:?}");
    unlisted.unlisted = told("position", vec![[0.0, 0.1, 0.0]]);
    let written = fitted(RIG, "rig.toml", &unlisted).unwrap();
    assert!(written.left_out[0].contains("at the slave, over position"), "{written:?}");
    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let torque = rig.model.parameter("motor_torque_per_volt_nm").unwrap();
    assert_eq!(
        (torque.tolerance, rig.model.effects.len()),
        (0.25, 0),
        "a residual without a name narrows nothing"
    );
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
    let coulomb = found_by_columns("coulomb_friction", "master", &[("coulomb", 20.4, "N")]);
    let (_, rig) = written_for(DRIVE, parameters, vec![coulomb]);
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
    assert!(
        error.contains("is not written") && error.contains("axes.0.control.p_v_per_count"),
        "{error}"
    );
}

/// Where a drive is after it was pushed to and fro.
fn pushed(parameters: drive::Parameters, effects: Vec<Box<dyn Effect>>) -> f64 {
    let mut plant = drive::Plant::new(parameters, effects).unwrap();
    for row in 0..1500 {
        plant.step(60.0 * (9.0 * f64::from(row) * 1e-3).sin(), 1e-3);
    }
    plant.state().position_m
}

#[test]
fn the_drive_made_from_the_file_has_what_was_fitted_once() {
    let parameters = vec![
        in_unit("mass_kg", "kg", (100.0, 140.0)),
        in_unit("viscous_friction_n_s_per_m", "N·s/m", (200.0, 620.0)),
        in_unit("force_offset_n", "N", (0.0, -3.2)),
    ];
    let effects = vec![
        found_by_columns("extra_inertia", "master", &[("mass_beyond_declared", 40.0, "kg")]),
        found_by_columns("coulomb_friction", "master", &[("coulomb", 20.4, "N")]),
        found_by_columns(
            "viscous_friction",
            "master",
            &[("viscous_beyond_declared", 420.0, "N·s/m")],
        ),
    ];
    let (written, rig) = written_for(DRIVE, parameters, effects);
    assert_eq!(
        (written.told.as_str(), written.left_out.len()),
        ("1 parameter as fitted, 3 effects", 0),
        "{written:?}"
    );
    let mass = rig.model.parameter("mass_kg").unwrap();
    assert_eq!(
        (mass.value, mass.tolerance, mass.source),
        (100.0, 0.25, ParameterSource::Assumed),
        "as declared"
    );
    let names: Vec<_> =
        rig.model.effects.iter().flat_map(|effect| effect.parameters.clone()).collect();
    let expected = [("inertia", 40.0), ("level", 20.4), ("coefficient", 420.0)];
    assert_eq!(names, expected.map(|(name, value)| (name.to_owned(), value)));

    let of_file = pushed(rig.drive_parameters().unwrap(), rig.model_effects().unwrap());
    let total = drive::Parameters {
        mass_kg: 140.0,
        viscous_friction_n_s_per_m: 620.0,
        force_offset_n: -3.2,
    };
    let coulomb = || vec![make("coulomb_friction", Site::Master, 20.4).unwrap()];
    let direct = pushed(total.clone(), coulomb());
    assert!((of_file - direct).abs() < 1e-9, "{of_file} {direct}");
    let twice = pushed(drive::Parameters { mass_kg: 180.0, ..total }, coulomb());
    assert!((twice - direct).abs() > 1e-5, "{twice} {direct}");
}

#[test]
fn an_excess_that_is_no_effect_of_the_plant_stays_in_the_parameter() {
    let lighter =
        found_by_columns("extra_inertia", "master", &[("mass_beyond_declared", -38.0, "kg")]);
    let (written, rig) =
        written_for(DRIVE, vec![in_unit("mass_kg", "kg", (100.0, 62.0))], vec![lighter]);
    assert_eq!((rig.model.parameter("mass_kg").unwrap().value, rig.model.effects.len()), (62.0, 0));
    assert_eq!(written.told, "1 parameter as fitted, no effect");
    let said = &written.left_out[0];
    assert!(said.starts_with("extra_inertia at the master: `inertia` = -38 "), "{said}");
    assert!(said.ends_with("mass_kg has all of the fitted value instead"), "{said}");

    let heavier =
        found_by_columns("extra_inertia", "slave", &[("mass_beyond_declared", 4e-6, "s²")]);
    let (written, rig) =
        written_for(OSCILLATOR, vec![in_unit("mass_s2", "s²", (5e-6, 9e-6))], vec![heavier]);
    assert_eq!((rig.model.parameter("mass_s2").unwrap().value, rig.model.effects.len()), (9e-6, 0));
    assert!(written.left_out[0].contains("in kg m^2 (kg), and it was found in s²"), "{written:?}");

    let damped =
        found_by_columns("line_damping", "line", &[("damping_beyond_declared", 1400.0, "N·s/m")]);
    let damping = in_unit("viscous_damping_n_s_per_m", "N·s/m", (50.0, 1450.0));
    let (written, rig) = written_for(ELEMENT, vec![damping], vec![damped]);
    let value = rig.model.parameter("viscous_damping_n_s_per_m").unwrap().value;
    assert_eq!(
        (value, rig.model.effects.len(), written.left_out.len()),
        (1450.0, 0, 1),
        "beyond the effect's range"
    );
}

#[test]
fn of_an_element_line_and_branch_are_told_by_its_stiffness() {
    let parameters = vec![
        in_unit("stiffness_n_per_m", "N/m", (2e4, 1.25e4)),
        in_unit("viscous_damping_n_s_per_m", "N·s/m", (50.0, 80.0)),
    ];
    let effects = vec![
        found_by_columns(
            "line_compliance",
            "line",
            &[("stiffness_beyond_declared", -7.5e3, "N/m")],
        ),
        found_by_columns("line_damping", "line", &[("damping_beyond_declared", 30.0, "N·s/m")]),
        found_by_columns(
            "viscoelastic_line",
            "line",
            &[("branch_stiffness", 5e3, "N/m"), ("relaxation", 0.3, "s")],
        ),
    ];
    let (written, rig) = written_for(ELEMENT, parameters, effects);
    assert!(written.left_out.is_empty(), "{written:?}");
    let declared = |name: &str| rig.model.parameter(name).unwrap().value;
    assert_eq!((declared("stiffness_n_per_m"), declared("viscous_damping_n_s_per_m")), (2e4, 50.0));
    let made = rig.model_effects().unwrap();
    let ratio = made[0].get("compliance_ratio").unwrap();
    assert!((2e4 / (1.0 + ratio) - 1.25e4).abs() < 1e-2, "{ratio}");
    assert_eq!(made[1].get("damping"), Some(30.0));
    assert_eq!(
        (made[2].get("stiffness_ratio"), made[2].get("relaxation_s")),
        (Some(0.4), Some(0.3))
    );
}

#[test]
fn what_the_plant_has_otherwise_is_left_out_and_said() {
    let effects = vec![
        found_by_columns("coulomb_friction", "master", &[("coulomb", 20.4, "N")]),
        found_by_columns(
            "asymmetric_friction",
            "master",
            &[("viscous_difference", -60.0, "N·s/m")],
        ),
        found_by_columns("transport_delay", "drive", &[("delay", -2e-3, "s")]),
    ];
    let (written, rig) = written_for(DRIVE, vec![in_unit("mass_kg", "kg", (100.0, 95.1))], effects);
    let names: Vec<_> =
        rig.model.effects.iter().map(|effect| (effect.id, effect.parameters.clone())).collect();
    assert_eq!(names, [("coulomb_friction", vec![("level".to_owned(), 20.4)])]);
    assert_eq!(written.told, "1 parameter as fitted, 1 effect");
    assert_eq!(
        written.left_out,
        [
            "asymmetric_friction at the master: rig files have nothing that means the same as its `viscous_difference`; the parameters are \
             as fitted beside it",
            "transport_delay at the drive: `delay_s` = -0.002 s: expected 0 to 1 s; the parameters are as fitted beside it",
        ]
    );
    let volts = found_by_columns("coulomb_friction", "slave", &[("coulomb", 0.02, "V")]);
    let (written, rig) =
        written_for(OSCILLATOR, vec![in_unit("stiffness", "1", (1.0, 1.1))], vec![volts]);
    assert!(rig.model.effects.is_empty());
    assert!(
        written.left_out[0]
            .starts_with("coulomb_friction at the slave: rig files have its `level` in"),
        "{written:?}"
    );
}

/// What an effect at the mass puts on it, at a position and a time.
fn put_on_the_mass(effect: &mut dyn Effect, position_rad: f64, time_s: f64) -> f64 {
    let mut load = SideLoad {
        side: Side::Master,
        position_rad,
        velocity_rad_s: 0.0,
        transmitted_nm: 0.0,
        load: Load::default(),
    };
    effect.side(&mut load, &Moment { time_s, ..Moment::default() });
    load.load.force
}

#[test]
fn waves_are_those_that_the_motion_had_to_overcome() {
    let (sine, cosine) = (0.3, -0.7);
    let asked = |angle: f64| sine * angle.sin() + cosine * angle.cos();
    let pair = |unit: &'static str| vec![("sine", sine, unit), ("cosine", cosine, unit)];
    let with = |unit: &'static str, shape: (&'static str, f64, &'static str)| {
        let mut all = pair(unit);
        all.push(shape);
        all
    };
    let effects = vec![
        found_by_columns("torque_ripple", "drive", &with("N", ("order", 3.0, "waves/turn"))),
        found_by_columns("gravity_imbalance", "master", &pair("N·m")),
        found_by_columns("periodic_disturbance", "master", &with("N", ("frequency", 7.5, "Hz"))),
    ];
    let (written, rig) = written_for(DRIVE, Vec::new(), effects);
    assert!(written.left_out.is_empty(), "{written:?}");
    let mut made = rig.model_effects().unwrap();
    for step in 0..40 {
        let at = 0.005 * f64::from(step);
        let moment = Moment { master_position_rad: at, ..Moment::default() };
        // A turn of this drive's motor is 2.5 mm.
        let ripple = made[0].motor(0.0, &moment) + asked(3.0 * std::f64::consts::TAU * at / 0.0025);
        let gravity = put_on_the_mass(made[1].as_mut(), at, 0.0) + asked(at);
        let vibration =
            put_on_the_mass(made[2].as_mut(), 0.0, at) + asked(7.5 * std::f64::consts::TAU * at);
        assert!(
            ripple.abs() < 1e-3 && gravity.abs() < 1e-6 && vibration.abs() < 1e-6,
            "{ripple} {gravity} {vibration}"
        );
    }
    // Where no turn is declared, waves are counted by the metre.
    let by_metre =
        found_by_columns("torque_ripple", "drive", &with("N", ("order", 50.0, "waves/m")));
    let (_, rig) = written_for(DRIVE, Vec::new(), vec![by_metre]);
    let order = rig.model_effects().unwrap()[0].get("order").unwrap();
    assert!((order - 50.0 * std::f64::consts::TAU).abs() < 1e-4, "{order}");
}
