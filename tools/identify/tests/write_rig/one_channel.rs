//! The file that is written for a drive, an element or an oscillator.

use super::*;

/// Where a drive is after it was pushed to and fro.
fn pushed(parameters: drive::Parameters, effects: Vec<Box<dyn Effect>>) -> f64 {
    let mut plant = drive::Plant::new(parameters, effects).unwrap();
    for row in 0..1500 {
        plant.step(60.0 * (9.0 * f64::from(row) * 1e-3).sin(), 1e-3);
    }
    plant.state().position_m
}

/// The constants of a drive that a rig file declares.
fn drive_parameters(rig: &RigFile) -> drive::Parameters {
    let mut parameters = drive::Parameters::default();
    for info in drive::Parameters::NAMES {
        if let Some(declared) = rig.model.parameter(info.name) {
            parameters.set(info.name, declared.value).unwrap();
        }
    }
    parameters
}

#[test]
fn a_drive_from_the_file_has_each_fitted_value_once() {
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

    let of_file = pushed(drive_parameters(&rig), rig.model_effects().unwrap());
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
fn an_excess_that_the_plant_cannot_express_stays_in_the_parameter() {
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
fn compliance_and_branch_of_an_element_are_relative_to_its_stiffness() {
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
fn effects_with_another_law_are_left_out_with_a_message() {
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
            "asymmetric_friction at the master: rig files have nothing that means the same as its \
             `viscous_difference`; the parameters are \
             as fitted beside it",
            "transport_delay at the drive: `delay_s` = -0.002 s: expected 0 to 1 s; the \
             parameters are as fitted beside it",
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
fn waves_have_the_sign_that_the_motion_had_to_overcome() {
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
