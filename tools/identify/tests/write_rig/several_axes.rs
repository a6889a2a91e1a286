//! The file that is written for one axis of several.

use super::*;

/// The result of an axis, with a coupling of the handle as fitted and beyond its tolerance.
fn of_axis(axis: &str, other: &str, with: &str, effects: Vec<FoundEffect>) -> Outcome {
    let coupling = format!("handle_coupling_kg_m2.{other}");
    let parameters = vec![
        parameter("motor_torque_per_volt_nm", Some(1.8), 1.7, Some(0.02)),
        parameter("hose_length_m", Some(10.0), 10.0, None),
        parameter("friction_smoothing_rad_s", None, 0.05, None),
        parameter(&coupling, Some(2e-4), 2.25e-4, Some(1e-5)),
    ];
    let beyond = effect("handle_coupling", "slave", &[(with, 4e-4)]);
    let effects = [vec![beyond], effects].concat();
    Outcome { axis: Some(axis.into()), ..outcome(Verdict::Effect, parameters, effects) }
}

#[test]
fn the_result_of_one_axis_leaves_the_others_as_they_were() {
    let backlash = effect("backlash", "slave", &[("gap", 0.06)]);
    let written =
        write(TWO_AXES, &of_axis("rotation", "flexion", "with_axis_0", vec![backlash])).unwrap();
    assert_eq!(written.told, "3 parameters as fitted, 1 effect");
    let (before, after) = (
        RigFile::parse(TWO_AXES, "rig.toml").unwrap(),
        RigFile::parse(text(&written), "rig.toml").unwrap(),
    );
    let torque = |rig: &RigFile, axis: usize| {
        rig.axis_model(&rig.axes[axis]).parameter("motor_torque_per_volt_nm").unwrap().clone()
    };
    assert_eq!(torque(&after, 0), torque(&before, 0));
    assert_eq!((torque(&after, 1).value, torque(&after, 1).source), (1.7, ParameterSource::Fitted));
    assert!(torque(&after, 1).tolerance < torque(&before, 1).tolerance);
    assert!(after.axes[1].model.iter().all(|own| own.name != "hose_length_m"));
    assert_eq!(after.model.parameters, before.model.parameters);
    let handle = after.model.handle_coupling[0];
    assert!((handle - 6.25e-4).abs() < 1e-12, "{handle}");
    let of = |axis: usize| {
        let made = after.axis_effects(&after.axes[axis]).unwrap();
        made.iter().map(|effect| effect.id()).collect::<Vec<_>>()
    };
    assert_eq!((of(0), of(1)), (Vec::new(), vec!["backlash"]));
    let comments = |text: &str| text.lines().filter(|line| line.starts_with('#')).count();
    let (fitted_by, found_in) = (4, 1);
    assert_eq!(comments(text(&written)), comments(TWO_AXES) + fitted_by + found_in);
}

#[test]
fn effects_of_every_axis_stay_with_the_others_and_a_second_axis_adds_its_own() {
    let of_all = "\n[[model.effects]]\nid = \"viscous_friction\"\nsite = \"slave\"\n";
    let backlash = || vec![effect("backlash", "slave", &[("gap", 0.06)])];
    let first = format!("{TWO_AXES}{of_all}");
    let first = write(&first, &of_axis("rotation", "flexion", "with_axis_0", backlash())).unwrap();
    let leak = vec![effect("leakage", "line", &[("conductance", 5e-13)])];
    let ids = |text: &str| -> Vec<Vec<&'static str>> {
        let rig = RigFile::parse(text, "rig.toml").unwrap();
        assert!(rig.model.effects.is_empty());
        let of = |axis: &rig::Axis| axis.effects.iter().map(|effect| effect.id).collect();
        rig.axes.iter().map(of).collect()
    };
    assert_eq!(ids(text(&first)), [vec!["viscous_friction"], vec!["backlash"]]);
    let second = write(text(&first), &of_axis("flexion", "rotation", "with_axis_1", leak)).unwrap();
    assert_eq!(ids(text(&second)), [vec!["leakage"], vec!["backlash"]]);
}

#[test]
fn a_handle_without_a_declared_coupling_gets_one() {
    let none = TWO_AXES.replace("handle_coupling_kg_m2 = [2.0e-4]", "");
    let mut found = of_axis("flexion", "rotation", "with_axis_1", Vec::new());
    found.parameters.pop();
    let written = write(&none, &found).unwrap();
    let rig = RigFile::parse(text(&written), "rig.toml").unwrap();
    assert_eq!(rig.model.handle_coupling, [4e-4]);
}
