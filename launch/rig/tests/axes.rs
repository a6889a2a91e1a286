//! Rigs of several axes, and protocols that move several axes together.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::PathBuf;

use plant::ParameterSet;
use rig::RigFile;
use rig::protocol::{Movement, Protocol};

const TWO: &str = include_str!("../../rigs/two-axis.toml");
const THREE: &str = include_str!("../../rigs/three-axis.toml");

fn rig(text: &str) -> RigFile {
    RigFile::parse(text, "rig.toml").unwrap_or_else(|error| panic!("{error}"))
}

fn refused(text: &str, from: &str, to: &str) -> String {
    assert_eq!(text.matches(from).count(), 1, "the edit must hit one place: {from}");
    RigFile::parse(&text.replace(from, to), "rig.toml").unwrap_err().to_string()
}

fn protocol(segment: &str) -> Result<Protocol, String> {
    let text = format!("[protocol]\nname = \"test\"\n\n[[segments]]\n{segment}");
    Protocol::parse(&text, "p.toml").map_err(|error| error.to_string())
}

const SINE: &str =
    "kind = \"guided_sine\"\namplitude_deg = 20.0\nfrequency_hz = 1.0\nduration_s = 10.0\n";

#[test]
fn the_shipped_rigs_have_two_and_three_axes_at_1_khz() {
    for (text, axes) in [(TWO, 2), (THREE, 3)] {
        let rig = rig(text);
        assert_eq!((rig.axes.len(), rig.rates.control_hz), (axes, 1000));
        assert_eq!(rig.model.handle_coupling.len(), axes * (axes - 1) / 2);
        let channels: Vec<_> = rig.axes.iter().map(|axis| axis.torque.unwrap().channel).collect();
        assert_eq!(channels, (0..axes).collect::<Vec<_>>());
    }
}

#[test]
fn an_axis_has_the_models_parameters_but_for_its_own() {
    let rig = rig(THREE);
    let length = |axis: usize| match rig.axis_parameters(&rig.axes[axis]).unwrap() {
        plant::transmission_kinds::Parameters::Hydrostatic(own) => {
            own.get("hose_length_m").unwrap()
        }
        plant::transmission_kinds::Parameters::Cable(_) => panic!("a cable"),
    };
    assert_eq!([length(0), length(1), length(2)], [10.0, 10.0, 8.0]);
    let all = rig.axis_parameters(&rig.axes[0]).unwrap();
    assert_eq!(all, rig.model.transmission("").unwrap());
    let message = refused(THREE, "hose_length_m = { value = 8.0", "hose_lenght_m = { value = 8.0");
    assert!(
        message
            .contains("axes.2.model.hose_lenght_m: expected a parameter of the hydrostatic model"),
        "{message}"
    );
    assert!(message.contains("did you mean `hose_length_m`?"), "{message}");
    let message =
        refused(THREE, "hose_length_m = { value = 8.0", "hose_length_m = { value = 800.0");
    assert!(
        message.contains("axes.2.model.hose_length_m: expected 0.1 to 50 m, found 800"),
        "{message}"
    );
    let drive = include_str!("../../rigs/emps.toml");
    let message = refused(drive, "[axes.limits]", "[axes.model]\nmass_kg = 90.0\n\n[axes.limits]");
    assert!(
        message.contains(
            "axes.0.model: expected a transmission of the axis's own, found the model \"drive\""
        ),
        "{message}"
    );
}

#[test]
fn a_handle_that_cannot_be_is_refused() {
    let key = "handle_coupling_kg_m2 = [2.0e-4]";
    for (value, expected) in [
        (
            "[1.7e-3]",
            "expected a handle with at least 0.2 of the axes' own inertia in every direction",
        ),
        ("[-1.7e-3]", "with a least of 0.1"),
        ("[1e-4, 1e-4, 1e-4]", "expected 1 numbers, one for each pair of the 2 axes, found 3"),
        ("[]", "expected a list of numbers, at least one"),
        ("2.0e-4", "expected a list of numbers"),
        ("[\"heavy\"]", "expected a number"),
        ("[nan]", "expected a finite number"),
        ("[2.0]", "expected a number from -1 to 1"),
    ] {
        let message = refused(TWO, key, &format!("handle_coupling_kg_m2 = {value}"));
        assert!(
            message.contains("model.handle_coupling_kg_m2") && message.contains(expected),
            "{value}: {message}"
        );
    }
    assert!(
        rig(&TWO.replace(key, "handle_coupling_kg_m2 = [1.5e-3]")).model.handle_coupling
            == [1.5e-3]
    );
    assert!(rig(&TWO.replace(key, "")).model.handle_coupling.is_empty());
    let drive = include_str!("../../rigs/emps.toml");
    let message =
        refused(drive, "kind = \"drive\"", "kind = \"drive\"\nhandle_coupling_kg_m2 = [1e-4]");
    assert!(message.contains("expected a transmission, whose slave is at the handle"), "{message}");
}

#[test]
fn the_shipped_protocols_fit_their_rigs() {
    for (name, text, axes) in
        [("circle.toml", TWO, 2), ("three-axes.toml", THREE, 3), ("circle.toml", THREE, 2)]
    {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../protocols").join(name);
        let protocol = Protocol::load(path).unwrap_or_else(|error| panic!("{error}"));
        protocol.check_against(&rig(text)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(protocol.segments[0].moves().count(), axes);
        assert_eq!(format!("{}.toml", protocol.name), name);
    }
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../protocols/three-axes.toml");
    let message = Protocol::load(path).unwrap().check_against(&rig(TWO)).unwrap_err().to_string();
    assert!(
        message.contains(
            "segments.0.axes: expected an axis of the rig \"two-axis\" (0 to 1), found 2"
        ),
        "{message}"
    );
}

#[test]
fn each_axis_has_its_phase_and_its_part_of_the_amplitude() {
    let protocol = protocol(&format!(
        "{SINE}axes = [2, 0, 1]\nphases_deg = [0.0, 90.0, 0.0]\nscales = [1.0, 0.5, -1.0]\n"
    ))
    .unwrap();
    let moves: Vec<_> = protocol.segments[0].moves().collect();
    assert_eq!(moves.iter().map(|(axis, _)| *axis).collect::<Vec<_>>(), [2, 0, 1]);
    for ((_, movement), (size, angle)) in
        moves.iter().zip([(1.0, 0.0), (0.5, FRAC_PI_2), (1.0, PI)])
    {
        let Movement::GuidedSine(sine) = movement else { panic!("{movement:?}") };
        assert!((sine.line.amplitude - size * TAU / 18.0).abs() < 1e-12);
        assert!((sine.line.phase - angle).abs() < 1e-12);
        assert_eq!(movement.duration_s(), 10.0);
    }
    let steps = protocol_of_steps("scales = [1.0, -0.5]\n").unwrap();
    let Movement::Steps(mirrored) = &steps.segments[0].companions[0].movement else { panic!() };
    assert!((mirrored.positions[0].to_degrees() + 5.0).abs() < 1e-12, "{mirrored:?}");
}

fn protocol_of_steps(more: &str) -> Result<Protocol, String> {
    protocol(&format!(
        "kind = \"steps\"\npositions_deg = [10.0]\ndwell_s = 1.0\naxes = [0, 1]\n{more}"
    ))
}

#[test]
fn lists_that_do_not_match_are_refused() {
    for (more, expected) in [
        ("axes = [0, 0]", "segments.0.axes: expected whole indices, each once"),
        ("axes = [0.5, 1]", "segments.0.axes: expected whole indices, each once"),
        ("axes = [0, 3]", "segments.0.axes: expected a number from 0 to 2"),
        ("axes = [0, 1]\naxis = 0", "segments.0.axis: expected either one axis, or `axes`"),
        (
            "axes = [0, 1]\nphases_deg = [0.0]",
            "segments.0.phases_deg: expected one for each of the 2 axes, found 1",
        ),
        ("axes = [0, 1]\nscales = [1.0, 2.0]", "segments.0.scales: expected a number from -1 to 1"),
        ("phases_deg = [0.0, 90.0]", "segments.0.phases_deg: expected `axes` beside it"),
    ] {
        let message = protocol(&format!("{SINE}{more}\n")).unwrap_err();
        assert!(message.contains(expected), "{more}: {message}");
    }
    let message = protocol_of_steps("phases_deg = [0.0, 90.0]\n").unwrap_err();
    assert!(
        message
            .contains("segments.0.phases_deg: expected a guided_sine or a multisine, found steps"),
        "{message}"
    );
    let message =
        protocol("kind = \"free\"\nduration_s = 1.0\naxes = [0, 1]\nscales = [1.0, 0.5]\n")
            .unwrap_err();
    assert!(
        message.contains("segments.0.scales: expected a movement of the machine, found free"),
        "{message}"
    );
    // Beyond the second axis's limits, within the first's.
    let narrow = TWO.replacen("position_max_deg = 120.0", "position_max_deg = 15.0", 1).replacen(
        "upper_stop_deg = 85.0",
        "upper_stop_deg = 15.0",
        1,
    );
    let message = protocol(&format!("{SINE}axes = [1, 0]\n"))
        .unwrap()
        .check_against(&rig(&narrow))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("segments.0.amplitude_deg: expected positions from -120.0° to 15.0°"),
        "{message}"
    );
}

#[test]
fn gains_are_held_against_the_axis_s_own_transmission() {
    // The last axis alone has a motor ten times as strong; the gains that the other two bear are
    // too high for it.
    let own = "hose_length_m = { value = 8.0";
    let message =
        refused(THREE, own, "motor_torque_per_volt_nm = 20.0\nhose_length_m = { value = 8.0");
    assert!(
        message.contains(
            "axes.2.control.p_v_per_count: expected gains that the declared transmission bears"
        ),
        "{message}"
    );
    assert!(!message.contains("axes.0") && !message.contains("axes.1"), "{message}");
}

#[test]
fn what_the_model_says_of_an_axis_is_that_of_its_own_transmission() {
    let rig = rig(THREE);
    let [first, second, third] = [0, 1, 2].map(|axis| rig.reflected_dynamics(axis).unwrap());
    assert_eq!(first, second);
    // 8 m of hose instead of 10 m: stiffer and lighter.
    assert!(
        third.line_v > first.line_v && third.inertia_v < first.inertia_v,
        "{} {}",
        third.line_v,
        third.inertia_v
    );
}
