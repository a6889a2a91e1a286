//! The file that is written for a transmission.

use super::*;

#[test]
fn a_plant_from_the_file_is_the_fitted_one() {
    let effects = vec![
        effect("backlash", "slave", &[("gap", 0.061_234)]),
        effect("torque_ripple", "drive", &[("amplitude", 0.13), ("order", 12.0), ("phase", -0.4)]),
    ];
    let written = write(RIG, &found(effects)).unwrap();
    assert_eq!(
        (written.told.as_str(), written.left_out.len()),
        ("6 parameters as fitted, 2 effects", 0)
    );
    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let of_file = moved(rig.axis_parameters(&rig.axes[0]).unwrap(), rig.model_effects().unwrap());

    let Parameters::Hydrostatic(mut own) =
        RigFile::parse(RIG, "rig.toml").unwrap().model.transmission("").unwrap()
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
    let declared =
        moved(RigFile::parse(RIG, "rig.toml").unwrap().model.transmission("").unwrap(), Vec::new());
    assert!((of_file.slave_position_rad - declared.slave_position_rad).abs() > 1e-3);
}

#[test]
fn comments_are_kept_and_tolerances_follow_the_records() {
    let written = write(RIG, &found(Vec::new())).unwrap();
    let kept = |text: &str| -> Vec<String> {
        text.lines().filter_map(|line| line.find('#').map(|at| line[at..].to_owned())).collect()
    };
    let (before, after) = (kept(RIG), kept(text(&written)));
    assert!(before.iter().all(|comment| after.contains(comment)), "{after:#?}");
    assert_eq!(
        after.len(),
        before.len() + 6,
        "four say where the values come from, two what speed and shape of the smoothing are"
    );
    let others = |text: &str| -> Vec<String> {
        let fitted = |line: &&str| FITTED.iter().any(|(name, ..)| line.starts_with(name));
        text.lines().filter(|line| !fitted(line)).map(str::to_owned).collect()
    };
    assert_eq!(
        others(text(&written))[4..],
        others(RIG),
        "lines that have nothing to do with it are as they were"
    );

    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let of = |name: &str| rig.model.parameter(name).unwrap().clone();
    let torque = of("motor_torque_per_volt_nm");
    assert!((torque.value - 1.621_234_567).abs() < 1e-7);
    assert_eq!(
        (torque.tolerance, torque.source),
        (0.13, ParameterSource::Fitted),
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
fn a_second_run_replaces_the_first() {
    let first = write(RIG, &found(vec![effect("backlash", "slave", &[("gap", 0.06)])])).unwrap();
    let second =
        write(text(&first), &found(vec![effect("leakage", "line", &[("conductance", 5e-13)])]))
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
fn unknown_values_are_not_written_with_a_message() {
    let mut ambiguous = found(vec![effect("transport_delay", "drive", &[("delay_s", 5e-3)])]);
    ambiguous.verdict = Verdict::Ambiguous;
    ambiguous.ambiguous_with = vec![Named { id: "amplifier_lag".into(), site: "drive".into() }];
    let written = write(RIG, &ambiguous).unwrap();
    assert_eq!(written.text, None);
    assert!(
        written.left_out[0].contains(
            "cannot distinguish transport_delay@drive from \
            amplifier_lag@drive"
        ),
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
    let written = write(RIG, &unlisted).unwrap();
    assert!(written.left_out[0].contains("explains (at the slave); tolerances"), "{written:?}");
    unlisted.unlisted = told("position", vec![[0.0, 0.1, 0.0]]);
    let written = write(RIG, &unlisted).unwrap();
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
fn nothing_is_written_of_an_early_answer() {
    let written = write(RIG, &Outcome { early: true, ..found(Vec::new()) }).unwrap();
    assert!(written.text.is_none() && written.left_out[0].contains("--limit-s"), "{written:?}");
}

#[test]
fn an_axis_that_has_a_parameter_of_its_own_keeps_it() {
    let own = RIG.replacen(
        "[axes.limits]",
        "[axes.model]\nmotor_torque_per_volt_nm = 1.7 # of this motor\n\n[axes.limits]",
        1,
    );
    let written = write(&own, &found(Vec::new())).unwrap();
    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    let axis = &rig.axes[0].model[0];
    assert!((axis.value - 1.621_234_567).abs() < 1e-7, "{axis:?}");
    assert_eq!(rig.model.parameter("motor_torque_per_volt_nm").unwrap().value, 1.8);
    assert!(text(&written).contains("# of this motor"));
}

#[test]
fn absolute_tolerances_of_a_drive_stay_absolute() {
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
fn gains_unstable_with_the_fitted_machine_are_refused() {
    let mut weak = found(Vec::new());
    // A motor four times as strong: the loop has four times the gain.
    weak.parameters[0].fitted = 14.0;
    let error = write(RIG, &weak).unwrap_err().to_string();
    assert!(
        error.contains("is not written") && error.contains("axes.0.control.p_v_per_count"),
        "{error}"
    );
}

#[test]
fn the_file_gives_the_source_of_its_values() {
    let mut outcome = found(Vec::new());
    outcome.records.fit = vec!["a.mcap".into(), "b.mcap[1.0..4.0 s]".into()];
    outcome.records.report = vec!["c\nd.mcap".into()];
    let first = write(RIG, &outcome).unwrap();
    let header = "# Fitted by `farreach identify` on 2026-11-23, revision 1a2b3c4, to records\n\
                  #   to fit: a.mcap, b.mcap[1.0..4.0 s]\n#   to select: \n#   to report: c \
                  d.mcap\n";
    assert!(text(&first).starts_with(header), "{}", &text(&first)[..300]);
    let second = write(text(&first), &outcome).unwrap();
    assert_eq!(text(&second).matches("# Fitted by").count(), 1, "it replaces an earlier one");
    let rig = RigFile::parse(text(&first), "fitted.toml").unwrap();
    let source = |name: &str| rig.model.parameter(name).unwrap().source;
    assert_eq!(source("line_stiffness_factor"), ParameterSource::Fitted);
    assert_eq!(source("bulk_modulus_pa"), ParameterSource::Printed, "its value did not change");
}
