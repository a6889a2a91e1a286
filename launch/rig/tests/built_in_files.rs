//! The rig files that ship are valid, and say what the thesis says.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::PathBuf;

use plant::ParameterSet;
use plant::transmission_kinds::Kind;
use rig::protocol::Protocol;
use rig::{AxisUnit, ChannelKind, HandKind, ModelKind, ParameterSource, RigFile};

fn shipped(name: &str) -> RigFile {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(name);
    RigFile::load(&path).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn the_hydrostatic_rig_is_the_machine_of_the_thesis() {
    let rig = shipped("hydrostatic.toml");
    assert_eq!(rig.name, "hydrostatic");
    assert_eq!(rig.rates.acquisition_period_ns(), 500_000);
    assert_eq!(rig.rates.control_period_ns(), 2_000_000);
    assert_eq!(rig.phases.control_ns, 200_000);
    assert_eq!(rig.channels.len(), 8);
    assert_eq!(rig.channels.iter().filter(|channel| channel.kind == ChannelKind::Emg).count(), 6);
    let axis = &rig.axes[0];
    assert_eq!(axis.unit, AxisUnit::Radian);
    assert!((axis.limits.position_max - 120.0_f64.to_radians()).abs() < 1e-12);
    // § 4.1: 4.5e-3 V/count at 4000 counts a turn
    assert!((axis.control.position_gain - 4.5e-3 * 4000.0 / std::f64::consts::TAU).abs() < 1e-9);
    assert!((axis.master.position(4000) - std::f64::consts::TAU).abs() < 1e-12);
    assert_eq!(rig.model.kind, ModelKind::Transmission(Kind::Hydrostatic));
    assert_eq!(
        rig.model.parameter("line_stiffness_factor").unwrap().source,
        ParameterSource::Traced
    );
    assert_eq!(rig.simulation.hand.kind, HandKind::Passive);
}

#[test]
fn the_two_hydrostatic_rigs_differ_in_the_line_alone() {
    let (traced, printed) = (shipped("hydrostatic.toml"), shipped("hydrostatic-printed.toml"));
    // The printed line is too stiff for the printed gains; its file says that it knows.
    let mut axes = printed.axes.clone();
    assert!(axes[0].control.accept_unstable && !traced.axes[0].control.accept_unstable);
    axes[0].control.accept_unstable = false;
    assert_eq!(traced.axes, axes);
    assert_eq!(traced.channels, printed.channels);
    assert_eq!(traced.rates, printed.rates);
    for parameter in &traced.model.parameters {
        let other = printed.model.parameter(&parameter.name).unwrap();
        assert_eq!(
            parameter.name != "line_stiffness_factor",
            parameter == other,
            "{}",
            parameter.name
        );
    }
    assert_ne!(traced.identity(), printed.identity());
}

#[test]
fn the_cable_rig_is_the_test_bed_of_chapter_5() {
    let rig = shipped("cable.toml");
    assert_eq!(
        (rig.name.as_str(), rig.model.kind),
        ("cable", ModelKind::Transmission(Kind::Cable))
    );
    let axis = &rig.axes[0];
    // § 5.1: 5000 lines at the motor and at the handle
    assert!((axis.master.position(6 * 20_000) - std::f64::consts::TAU).abs() < 1e-12);
    assert!((axis.slave.unwrap().position(20_000) - std::f64::consts::TAU).abs() < 1e-12);
    let declared = rig.model.transmission("").unwrap();
    let traced = plant::cable::Parameters::calibrated();
    for info in plant::cable::Parameters::NAMES {
        let parameter = rig
            .model
            .parameter(info.name)
            .unwrap_or_else(|| panic!("{} is not declared", info.name));
        let (value, reference) = (declared.get(info.name).unwrap(), traced.get(info.name).unwrap());
        assert_eq!(value, parameter.value);
        assert!(
            (value - reference).abs() <= 1e-6 * reference.abs(),
            "{}: {value}, {reference}",
            info.name
        );
    }
    assert_eq!(rig.model.parameter("mechanical_ratio").unwrap().source, ParameterSource::Printed);
    assert_eq!(
        rig.model.parameter("cable_stiffness_factor").unwrap().source,
        ParameterSource::Traced
    );
}

#[test]
fn the_emps_carriage_counts_in_metres() {
    let rig = shipped("emps.toml");
    let axis = &rig.axes[0];
    assert_eq!(axis.unit, AxisUnit::Metre);
    assert!((axis.master.position(1) - 5e-8).abs() < 1e-20);
    // the record's law: kp kv = 160.18 * 243.45 V/m, kv = 243.45 V·s/m
    assert!((axis.control.position_gain / (160.18 * 243.45) - 1.0).abs() < 1e-3);
    assert!((axis.control.velocity_gain / 243.45 - 1.0).abs() < 1e-3);
    assert_eq!(rig.model.kind, ModelKind::Drive);
    assert!((rig.model.parameter("force_offset_n").unwrap().spread() - 10.0).abs() < 1e-12);
    assert_eq!(rig.replay.position, "position_m");
}

#[test]
fn models_of_one_channel_declare_what_they_must_and_nothing_unknown() {
    let silverbox = shipped("silverbox.toml");
    assert_eq!(silverbox.model.kind, ModelKind::Oscillator);
    let of = |name| silverbox.model.parameter(name).unwrap().value;
    let hertz = (of("stiffness") / of("mass_s2")).sqrt() / std::f64::consts::TAU;
    assert!((60.0..80.0).contains(&hertz), "Silverbox rings near 70 Hz: {hertz}");
    let element = shipped("element.toml");
    assert_eq!(element.model.kind, ModelKind::Element);
    assert!(element.model.parameter("stiffness_n_per_m").is_some());

    let edited = silverbox.text().replace("damping_s =", "dampning_s =");
    let error = RigFile::parse(&edited, "silverbox.toml").unwrap_err();
    assert_eq!(error.problems()[0].key, "model.parameters.dampning_s");
    assert!(error.problems()[0].advice.contains("damping_s"), "{error}");
    let edited = element.text().replace("value = 2.0e4", "value = -2.0e4");
    let error = RigFile::parse(&edited, "element.toml").unwrap_err();
    assert_eq!(error.problems()[0].key, "model.parameters.stiffness_n_per_m");
}

#[test]
fn a_rig_keeps_its_text_and_a_stable_identity() {
    let rig = shipped("hydrostatic.toml");
    assert!(rig.text().starts_with("# The hydrostatic"));
    let again = RigFile::parse(rig.text(), rig.file_name()).unwrap();
    assert_eq!(again, rig);
    assert_eq!(rig.identity(), rig::identity(rig.text()));
}

#[test]
fn declared_parameters_reach_the_model() {
    let traced = shipped("hydrostatic.toml").model.transmission("").unwrap();
    let printed = shipped("hydrostatic-printed.toml").model.transmission("").unwrap();
    assert_eq!(printed, Kind::Hydrostatic.printed());
    let reference = plant::hydrostatic::Parameters::calibrated().line_stiffness_factor;
    let declared = traced.get("line_stiffness_factor").unwrap();
    assert!((declared / reference - 1.0).abs() < 1e-6);

    let cable = shipped("cable.toml");
    let edited = cable.text().replace("cable_stiffness_factor = {", "# cable_stiffness_factor = {");
    let error = RigFile::parse(&edited, "cable.toml").unwrap_err();
    assert_eq!(
        error.problems()[0].key,
        "axes.0.control.p_v_per_count",
        "36 times stiffer, its gains are too high"
    );
    let edited = edited.replace("[axes.control]\n", "[axes.control]\naccept_unstable = true\n");
    let edited = RigFile::parse(&edited, "cable.toml").unwrap();
    let undeclared = edited.model.transmission("").unwrap().get("cable_stiffness_factor");
    assert_eq!(undeclared, Some(1.0), "left out, it is as printed");

    let emps = shipped("emps.toml");
    let error = emps.model.transmission("").unwrap_err().to_string();
    assert!(error.contains("the model \"hydrostatic\" or \"cable\", found \"drive\""), "{error}");
    let value = |name| emps.model.parameter(name).unwrap().value;
    assert_eq!((value("mass_kg"), value("force_per_volt_n")), (100.0, 35.15065));
    assert!(error.ends_with("found \"drive\"; use a rig file with that model"), "{error}");
}

#[test]
fn the_protocols_fit_both_transmissions() {
    for (rig, name) in ["hydrostatic.toml", "cable.toml"].into_iter().flat_map(|rig| {
        [
            "guided-1hz.toml",
            "excitation.toml",
            "demo.toml",
            "steps.toml",
            "free-movement.toml",
            "force-fields.toml",
            "learning.toml",
            "learning-model-based.toml",
        ]
        .map(|name| (shipped(rig), name))
    }) {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../protocols").join(name);
        let protocol = Protocol::load(path).unwrap_or_else(|error| panic!("{error}"));
        protocol.check_against(&rig).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(format!("{}.toml", protocol.name), name);
    }
}

#[test]
fn a_protocol_in_degrees_does_not_fit_a_carriage() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../protocols/guided-1hz.toml");
    let error = Protocol::load(path).unwrap().check_against(&shipped("emps.toml")).unwrap_err();
    assert_eq!(error.problems().len(), 1);
    assert_eq!(error.problems()[0].key, "segments.0.amplitude_deg");
    assert!(error.problems()[0].expected.contains("(m)"));
}
