//! Options of the position law, and what the declared model says in volts.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use plant::reflected_dynamics::FrictionCurve;
use rig::{CompensationKind, ControlOptions, RigFile};

const RIG: &str = include_str!("../../rigs/hydrostatic.toml");
const CABLE: &str = include_str!("../../rigs/cable.toml");
const DRIVE: &str = include_str!("../../rigs/emps.toml");

fn with(sections: &str) -> String {
    let compensation = "[axes.control.compensation]\nkind = \"printed\"\n";
    assert_eq!(RIG.matches(compensation).count(), 1);
    RIG.replace(
        compensation,
        &format!("{sections}\n[axes.control.compensation]\nkind = \"identified\"\n"),
    )
}

fn near(value: f64, expected: f64, relative: f64) {
    assert!((value / expected - 1.0).abs() < relative, "{value}, expected {expected}");
}

#[test]
fn absent_sections_leave_the_printed_feed_forward_alone() {
    let defaults = ControlOptions::default();
    assert_eq!(
        (defaults.compensation.kind, defaults.observer, defaults.slave),
        (CompensationKind::Printed, None, None)
    );
    for (text, name) in [(RIG, "hydrostatic.toml"), (CABLE, "cable.toml")] {
        assert_eq!(RigFile::parse(text, name).unwrap().axes[0].control.options, defaults, "{name}");
    }
}

#[test]
fn sections_are_read_with_the_defaults_that_the_shipped_file_shows() {
    let rig = RigFile::parse(
        &with("[axes.control.observer]\n[axes.control.slave]\nlimit_deg = 10.0\n"),
        "rig.toml",
    )
    .unwrap();
    let options = rig.axes[0].control.options;
    assert_eq!(options.compensation.kind, CompensationKind::Identified);
    let (observer, slave) = (options.observer.unwrap(), options.slave.unwrap());
    assert_eq!((observer.cutoff_hz, observer.share, observer.limit_v), (3.0, 1.0, 1.5));
    near(slave.limit, 10f64.to_radians(), 1e-12);
    assert_eq!((slave.windup_share, slave.proportional_gain, slave.integral_gain), (1.0, 0.3, 2.0));
    assert_eq!((slave.filter_hz, slave.lead_s), (3.0, 0.03));
    // The keys in the shipped file's comments, taken out of them, say the same.
    let comments: String = RIG
        .lines()
        .skip_while(|line| *line != "# [axes.control.observer]")
        .take_while(|line| line.starts_with('#'))
        .filter(|line| line.contains(" = ") || line.starts_with("# [axes"))
        .map(|line| format!("{}\n", &line[2..]))
        .collect();
    let written = RigFile::parse(&with(&comments), "rig.toml").unwrap().axes[0].control.options;
    assert_eq!(written.observer, options.observer);
    near(written.slave.unwrap().limit, 20f64.to_radians(), 1e-12);
}

#[test]
fn the_hydrostatic_model_in_volts() {
    let rig = RigFile::parse(RIG, "hydrostatic.toml").unwrap();
    let model = rig.reflected_dynamics(0).unwrap();
    let plant::transmission_kinds::Parameters::Hydrostatic(parameters) =
        rig.model.transmission("").unwrap()
    else {
        panic!("a hydrostatic rig");
    };
    let volts = parameters.motor_torque_per_volt_nm;
    // At rest all friction is the breakaway torque, 2.74 N·m: 1.5 V, as § 4.1 measured.
    near(
        model.master_friction.level_v(0.0) + model.slave_friction.level_v(0.0),
        parameters.static_friction_at_motor_nm() / volts,
        1e-12,
    );
    near(model.master_friction.level_v(0.0) + model.slave_friction.level_v(0.0), 1.52, 0.01);
    near(model.inertia_v, 1.37e-2 / 1.8, 0.01);
    near(model.ratio, 1.78 * 0.031 / (1.9 * 0.034), 1e-12);
    // Two lines of 2338 N/m on 55.2 mm.
    near(model.line_v, 2.0 * 2338.0 * 0.05518 * 0.05518 / 1.8, 0.005);
    // It falls with speed at first: 1.267 N·m at 5.1 rad/s of the slave, and half a newton-metre of
    // oil.
    assert!(model.slave_friction.level_v(3.0) < model.slave_friction.level_v(0.0));
    assert!(rig.reflected_dynamics(1).is_none());
}

#[test]
fn the_cable_model_in_volts_of_handle_coordinates() {
    let rig = RigFile::parse(CABLE, "cable.toml").unwrap();
    let model = rig.reflected_dynamics(0).unwrap();
    let plant::transmission_kinds::Parameters::Cable(parameters) =
        rig.model.transmission("").unwrap()
    else {
        panic!("a cable rig");
    };
    let all = parameters.static_friction_at_motor_nm() / parameters.motor_torque_per_volt_nm;
    near(model.master_friction.level_v(0.0) + model.slave_friction.level_v(0.0), all, 1e-9);
    // Six turns of the motor for one of the handle: the handle follows one to one.
    near(model.ratio, 1.0, 1e-12);
    near(model.inertia_v, 1.0e-2, 0.06);
}

#[test]
fn a_curve_is_linear_between_its_points_and_level_beyond() {
    let curve = FrictionCurve::new(6.4, |speed| 2.0 - 0.5 * speed);
    for (speed, level) in
        [(0.0, 2.0), (0.05, 1.975), (-1.0, 1.5), (3.9, 0.05), (4.0, 0.0), (99.0, 0.0)]
    {
        assert!((curve.level_v(speed) - level).abs() < 1e-12, "{speed}");
    }
    assert_eq!((curve.peak_v(), curve.level_v(f64::NAN)), (2.0, 0.0));
}

fn error(text: &str) -> String {
    RigFile::parse(text, "rig.toml").unwrap_err().to_string()
}

#[test]
fn a_loop_on_a_slave_that_is_not_measured_is_refused() {
    let encoder = "[axes.slave]\ncounts_per_turn = 4000\n";
    let text = with("[axes.control.slave]\n");
    assert_eq!(text.matches(encoder).count(), 1);
    insta::assert_snapshot!(error(&text.replace(encoder, "")));
}

#[test]
fn settings_out_of_range_are_refused_with_their_keys() {
    let sections = "[axes.control.observer]\ncutoff_hz = 200.0\n[axes.control.slave]\n\
                    limit_deg = 500.0\nfilter = 3.0\n";
    insta::assert_snapshot!(error(
        &with(sections)
            .replace("share = 1.0                     # share of the model's", "share = 1.2 #")
    ));
}

#[test]
fn without_a_transmission_there_is_no_model_to_compensate_from() {
    let limits = "[axes.limits]";
    assert_eq!(DRIVE.matches(limits).count(), 1);
    let text = DRIVE.replace(
        limits,
        &format!("[axes.control.compensation]\nkind = \"identified\"\n\n{limits}"),
    );
    insta::assert_snapshot!(error(&text));
}
