//! Messages for mistakes in a rig file: file, line, key, expected, found, what to do.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use rig::RigFile;

const RIG: &str = include_str!("../../rigs/hydrostatic.toml");

/// The message after one edit of the shipped rig.
fn rig_error(from: &str, to: &str) -> String {
    assert_eq!(RIG.matches(from).count(), 1, "the edit must hit one place: {from}");
    RigFile::parse(&RIG.replace(from, to), "rig.toml").unwrap_err().to_string()
}

#[test]
fn unknown_key() {
    insta::assert_snapshot!(rig_error("speed_max_deg_s = 1500.0", "speed_max_degs = 1500.0"));
}

#[test]
fn unknown_section() {
    insta::assert_snapshot!(rig_error("[phases_us]", "[phase_us]"));
}

#[test]
fn unknown_parameter() {
    insta::assert_snapshot!(rig_error("hose_length_m = {", "hose_lenght_m = {"));
}

#[test]
fn unknown_parameter_with_no_like() {
    let message = rig_error("hose_length_m = {", "colour = {");
    assert!(message.contains(
        "colour: expected a parameter of the hydrostatic model, found an unknown key; \
             the model has hose"
    ));
}

/// The message after one edit of the shipped cable rig.
fn cable_error(from: &str, to: &str) -> String {
    let text = include_str!("../../rigs/cable.toml");
    assert_eq!(text.matches(from).count(), 1, "the edit must hit one place: {from}");
    RigFile::parse(&text.replace(from, to), "rig.toml").unwrap_err().to_string()
}

#[test]
fn unknown_parameter_of_the_cable() {
    insta::assert_snapshot!(cable_error("pretension_n = {", "pre_tension_n = {"));
}

#[test]
fn parameter_of_the_cable_out_of_range() {
    insta::assert_snapshot!(cable_error(
        "line_length_m = { value = 9.0",
        "line_length_m = { value = 900.0"
    ));
}

#[test]
fn torque_cell_that_drifts_out_of_range() {
    insta::assert_snapshot!(rig_error("torque_drift_v_per_s = 0.0", "torque_drift_v_per_s = 5.0"));
    insta::assert_snapshot!(rig_error(
        "torque_walk_v_per_sqrt_s = 0.0",
        "torque_walk_v_per_sqrt_s = -0.1"
    ));
    insta::assert_snapshot!(rig_error("torque_bandwidth_hz = 200.0", "torque_bandwidth_hz = 0.0"));
}

#[test]
fn trigger_that_cannot_be_seen() {
    let scanner = |pulse: &str, more: &[(&str, &str)]| {
        let edited = RIG.replace("trigger_repetition_s = 0.0", "trigger_repetition_s = 2.0");
        let mut edited =
            edited.replace("trigger_pulse_s = 0.01", &format!("trigger_pulse_s = {pulse}"));
        for (from, to) in more {
            assert_eq!(edited.matches(from).count(), 1, "the edit must hit one place: {from}");
            edited = edited.replace(from, to);
        }
        RigFile::parse(&edited, "rig.toml").map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!(scanner("0.01", &[]), Ok(()));
    insta::assert_snapshot!(scanner("2.5", &[]).unwrap_err());
    insta::assert_snapshot!(scanner("1e-4", &[]).unwrap_err());
    insta::assert_snapshot!(
        scanner("0.01", &[("trigger_pulse_v = 0.0", "trigger_pulse_v = 5.0")]).unwrap_err()
    );
    insta::assert_snapshot!(
        scanner("0.01", &[("kind = \"trigger\"\nunit", "kind = \"other\"\nunit")]).unwrap_err()
    );
    insta::assert_snapshot!(rig_error("trigger_repetition_s = 0.0", "trigger_repetition_s = 1e-4"));
    let narrow = [
        ("name = \"scanner_trigger\"", "name = \"scanner_trigger\"\nrange_v = 2.0"),
        ("unit = \"V\"\nrange_v = 10.0", "unit = \"V\""),
    ];
    insta::assert_snapshot!(scanner("0.01", &narrow).unwrap_err());
}

#[test]
fn control_beyond_the_limit_on_volts() {
    insta::assert_snapshot!(rig_error("volts_max = 10.0", "volts_max = 5.0"));
}

#[test]
fn unknown_word() {
    insta::assert_snapshot!(rig_error("kind = \"hydrostatic\"", "kind = \"hydraulic\""));
}

#[test]
fn missing_channel() {
    insta::assert_snapshot!(rig_error("channel = 0  ", "channel = 9  "));
}

#[test]
fn channel_of_another_kind() {
    insta::assert_snapshot!(rig_error("channel = 0  ", "channel = 3  "));
}

#[test]
fn channel_twice() {
    insta::assert_snapshot!(rig_error("index = 7", "index = 6"));
}

#[test]
fn sensor_that_saturates_before_its_limit() {
    insta::assert_snapshot!(rig_error("volts_per_nm = 0.5", "volts_per_nm = 1.0"));
}

#[test]
fn limits_the_wrong_way_round() {
    let edited = RIG.replace("position_min_deg = -120.0", "position_min_deg = 90.0");
    let edited = edited.replace("position_max_deg = 120.0", "position_max_deg = -90.0");
    insta::assert_snapshot!(RigFile::parse(&edited, "rig.toml").unwrap_err());
}

#[test]
fn limits_in_radians() {
    let edited = RIG.replace("position_min_deg = -120.0", "position_min_deg = -2.09");
    let edited = edited.replace("position_max_deg = 120.0", "position_max_deg = 2.09");
    insta::assert_snapshot!(RigFile::parse(&edited, "rig.toml").unwrap_err());
}

#[test]
fn limit_beyond_the_thesis() {
    insta::assert_snapshot!(rig_error("position_max_deg = 120.0", "position_max_deg = 150.0"));
}

#[test]
fn volts_beyond_the_card() {
    insta::assert_snapshot!(rig_error("volts_max = 10.0", "volts_max = 24"));
}

#[test]
fn missing_limit() {
    insta::assert_snapshot!(rig_error("volts_max = 10.0\n", "\n"));
}

#[test]
fn jump_that_a_legal_movement_makes() {
    insta::assert_snapshot!(rig_error("encoder_jump_counts = 60", "encoder_jump_counts = 5"));
}

#[test]
fn key_of_the_other_unit() {
    insta::assert_snapshot!(rig_error("speed_max_deg_s = 1500.0", "speed_max_m_s = 0.3"));
}

#[test]
fn rate_that_does_not_divide() {
    insta::assert_snapshot!(rig_error("control_hz = 500", "control_hz = 600"));
}

#[test]
fn rate_that_does_not_divide_another() {
    insta::assert_snapshot!(rig_error("control_hz = 500", "control_hz = 625"));
}

#[test]
fn rate_without_whole_nanoseconds() {
    insta::assert_snapshot!(rig_error("acquisition_hz = 2000", "acquisition_hz = 3000"));
}

#[test]
fn watchdog_slower_than_control() {
    insta::assert_snapshot!(rig_error("watchdog_hz = 1000", "watchdog_hz = 250"));
}

#[test]
fn overlapping_phases() {
    // 690 µs is 190 µs modulo the shortest period of 500 µs, and control runs at 200 µs
    insta::assert_snapshot!(rig_error("watchdog = 350", "watchdog = 690"));
}

#[test]
fn overlapping_phases_round_the_end_of_the_period() {
    insta::assert_snapshot!(rig_error("experiment = 420", "experiment = 490"));
}

#[test]
fn phases_against_the_flow_of_data() {
    insta::assert_snapshot!(rig_error("control = 200", "control = 40"));
}

#[test]
fn phase_beyond_the_period() {
    insta::assert_snapshot!(rig_error("acquisition = 80", "acquisition = 580"));
}

#[test]
fn wrong_type() {
    insta::assert_snapshot!(rig_error("ramp_s = 1.0", "ramp_s = \"1.0\""));
}

#[test]
fn not_a_number() {
    insta::assert_snapshot!(rig_error("offset_v = 0.0", "offset_v = nan"));
}

#[test]
fn infinite_parameter() {
    insta::assert_snapshot!(rig_error("{ value = 847.0,", "{ value = -inf,"));
}

#[test]
fn parameter_of_another_magnitude() {
    insta::assert_snapshot!(rig_error("{ value = 0.031,", "{ value = 31,"));
}

#[test]
fn tolerance_in_percent() {
    insta::assert_snapshot!(rig_error(
        "{ value = 10.0, tolerance = 0.01",
        "{ value = 10.0, tolerance = 5"
    ));
}

#[test]
fn filter_beyond_half_the_rate() {
    insta::assert_snapshot!(rig_error("velocity_filter_hz = 40.0", "velocity_filter_hz = 300"));
}

#[test]
fn no_toml() {
    insta::assert_snapshot!(rig_error("name = \"hydrostatic\"", "name = hydrostatic"));
}

#[test]
fn every_problem_at_once_in_the_order_of_lines() {
    let edited =
        RIG.replace("volts_max = 10.0", "volts_max = 24").replace("ramp_s = 1.0", "ramp = 1.0");
    let edited = edited.replace("seed = 1\n", "seed = -1\n");
    insta::assert_snapshot!(RigFile::parse(&edited, "rig.toml").unwrap_err());
}

#[test]
fn empty_file() {
    insta::assert_snapshot!(RigFile::parse("", "rig.toml").unwrap_err());
}

#[test]
fn missing_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none.toml");
    let error = RigFile::load(&path).unwrap_err().to_string();
    assert!(
        error.starts_with(&format!("{}: cannot be read: No such file", path.display())),
        "{error}"
    );
}

#[test]
fn gear_that_no_handle_has_or_that_stands_at_the_handle() {
    insta::assert_snapshot!(rig_error(
        "turns_per_handle_turn = 1.0",
        "turns_per_handle_turn = 600"
    ));
    let edited = RIG.replace("[axes.slave]\n", "[axes.slave]\nturns_per_handle_turn = 6.0\n");
    insta::assert_snapshot!(RigFile::parse(&edited, "rig.toml").unwrap_err());
}

#[test]
fn force_control_without_a_torque_cell() {
    let (head, rest) = RIG.split_once("[axes.torque]").unwrap();
    let (_, tail) = rest.split_once("# Limits beyond which").unwrap();
    let edited = format!("{head}# Limits beyond which{tail}").replace("torque_max_nm = 12.0\n", "");
    assert!(edited.len() + 100 < RIG.len());
    insta::assert_snapshot!(RigFile::parse(&edited, "rig.toml").unwrap_err());
}

#[test]
fn gains_that_the_rig_would_not_bear() {
    insta::assert_snapshot!(rig_error("p_v_per_count = 4.5e-3", "p_v_per_count = 0.2"));
    insta::assert_snapshot!(rig_error("p1 = 0.333 ", "p1 = 6.0 "));
    insta::assert_snapshot!(rig_error("p_v_per_count = 4.5e-3", "p_v_per_count = -4.5e-3"));
    insta::assert_snapshot!(rig_error("p_v_per_count = 4.5e-3", "p_v_per_count = nan"));
    let accepted =
        RIG.replace("p_v_per_count = 4.5e-3", "p_v_per_count = 0.2\naccept_unstable = true");
    assert!(RigFile::parse(&accepted, "rig.toml").is_ok());
}

#[test]
fn gains_of_the_wrong_sign_or_none_are_refused() {
    let keys = [
        ("p_v_per_count = 4.5e-3", "p_v_per_count"),
        ("d_v_s_per_count = 7.0e-4", "d_v_s_per_count"),
        ("velocity_filter_hz = 40.0", "velocity_filter_hz"),
        ("output_limit_v = 8.0", "output_limit_v"),
        ("ramp_s = 1.0", "ramp_s"),
        ("friction_peak_v = 1.5", "friction_peak_v"),
        ("friction_floor_v = 1.2", "friction_floor_v"),
        ("inertia_v_per_rad_s2 = 8.0e-3", "inertia_v_per_rad_s2"),
        ("p1 = 0.333", "p1"),
        ("forgetting = 0.4", "forgetting"),
        ("offset_slow_v = 1.5", "offset_slow_v"),
        ("p2_v_s_per_count = 1.11e-4", "p2_v_s_per_count"),
        ("end_stop_stiffness = 10.0", "end_stop_stiffness"),
    ];
    for (line, key) in keys {
        for value in ["nan", "inf", "-inf", "-1e-3"] {
            let message = rig_error(line, &format!("{key} = {value}"));
            assert!(
                message.contains(key) && message.contains("expected"),
                "{key} = {value}: {message}"
            );
        }
    }
}

#[test]
fn end_stops_that_make_no_sense() {
    let (lower, upper) = ("end_stop_min_deg = -85.0\n", "end_stop_max_deg = 85.0\n");
    let all = [
        rig_error(lower, ""),
        rig_error(upper, "end_stop_max_deg = -85.0\n"),
        rig_error(lower, "end_stop_min_m = -0.2\n"),
        rig_error(&format!("{lower}{upper}"), "end_stop_min_deg = 0.0\nend_stop_max_deg = 0.0\n"),
    ];
    insta::assert_snapshot!(all.join("\n"));
}

/// Samples that are always older than the enable line bears: the watchdog looks right before they
/// come.
#[test]
fn rates_and_phases_that_no_profile_can_arm() {
    let text = RIG
        .replace("acquisition_hz = 2000", "acquisition_hz = 100")
        .replace("control_hz = 500", "control_hz = 100")
        .replace("watchdog_hz = 1000", "watchdog_hz = 100")
        .replace("experiment_hz = 500", "experiment_hz = 100");
    let late = "[phases_us]\nacquisition = 9900\ncontrol = 9950\nwatchdog = 9870\n";
    let before = text.find("[phases_us]").unwrap();
    let after = before + 1 + text[before + 1..].find("\n[").unwrap() + 1;
    let text = format!("{}{late}\n{}", &text[..before], &text[after..]);
    let error = RigFile::parse(&text, "rig.toml").unwrap_err().to_string();
    let expected = "rates.acquisition_hz: expected samples with which the enable line toggles of \
                    at most 14.88 ms (timeouts of the profile best-effort), found 19.87 ms at 100 \
                    Hz; raise the rate, or move phases_us: no profile has longer timeouts";
    assert!(error.contains(expected), "{error}");
}
