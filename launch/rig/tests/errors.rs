//! What a person reads who made a mistake: file, line, key, expected, found, what to do.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use rig::RigFile;
use rig::protocol::{Protocol, with_overrides};

const RIG: &str = include_str!("../../rigs/hydrostatic.toml");

/// The message after one edit of the shipped rig.
fn rig_error(from: &str, to: &str) -> String {
    assert_eq!(RIG.matches(from).count(), 1, "the edit must hit one place: {from}");
    RigFile::parse(&RIG.replace(from, to), "rig.toml").unwrap_err().to_string()
}

const PROTOCOL: &str = r#"[protocol]
name = "test"

[[segments]]
kind = "guided_sine"
amplitude_deg = 30.0    # to either side
frequency_hz = 1.0
duration_s = 10.0
"#;

fn protocol_error(from: &str, to: &str) -> String {
    assert_eq!(PROTOCOL.matches(from).count(), 1, "the edit must hit one place: {from}");
    Protocol::parse(&PROTOCOL.replace(from, to), "p.toml").unwrap_err().to_string()
}

fn misfit(from: &str, to: &str) -> String {
    assert_eq!(PROTOCOL.matches(from).count(), 1, "the edit must hit one place: {from}");
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    let protocol = Protocol::parse(&PROTOCOL.replace(from, to), "p.toml").unwrap();
    protocol.check_against(&rig).unwrap_err().to_string()
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
    assert!(
        message.contains(
            "colour: expected a parameter of the hydrostatic model, found an unknown key; the model has hose"
        )
    );
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
fn protocol_unknown_key() {
    insta::assert_snapshot!(protocol_error("duration_s = 10.0", "duration = 10.0"));
}

#[test]
fn protocol_unknown_kind() {
    insta::assert_snapshot!(protocol_error("guided_sine", "guidedsine"));
}

#[test]
fn protocol_frequency_beyond_the_thesis() {
    insta::assert_snapshot!(protocol_error("frequency_hz = 1.0", "frequency_hz = 5"));
}

#[test]
fn protocol_fades_longer_than_the_movement() {
    insta::assert_snapshot!(protocol_error(
        "duration_s = 10.0",
        "duration_s = 10.0\nfade_in_s = 8"
    ));
}

#[test]
fn protocol_with_two_units() {
    insta::assert_snapshot!(protocol_error(
        "duration_s = 10.0",
        "duration_s = 10.0\ncentre_m = 0.01"
    ));
}

#[test]
fn protocol_without_segments() {
    insta::assert_snapshot!(Protocol::parse("[protocol]\nname = \"x\"\n", "p.toml").unwrap_err());
}

#[test]
fn protocol_with_amplitudes_that_do_not_match() {
    let text = "[protocol]\nname = \"x\"\n[[segments]]\nkind = \"multisine\"\nfrequencies_hz = [1, 2, 3]\namplitudes_deg = [1, 2]\nduration_s = 5\n";
    insta::assert_snapshot!(Protocol::parse(text, "p.toml").unwrap_err());
}

#[test]
fn protocol_beyond_the_limits() {
    insta::assert_snapshot!(misfit(
        "amplitude_deg = 30.0",
        "centre_deg = 100\namplitude_deg = 30.0"
    ));
}

#[test]
fn protocol_too_fast() {
    insta::assert_snapshot!(misfit("duration_s = 10.0", "duration_s = 10.0\nfade_in_s = 0.1"));
}

#[test]
fn protocol_for_an_axis_that_is_not_there() {
    insta::assert_snapshot!(misfit("duration_s = 10.0", "duration_s = 10.0\naxis = 2"));
}

#[test]
fn overrides_change_values_and_nothing_else() {
    let text = with_overrides(
        PROTOCOL,
        "p.toml",
        &["segments.0.amplitude_deg=20", "protocol.name=other", "segments.0.label = \"a = b\""],
    )
    .unwrap();
    let protocol = Protocol::parse(&text, "p.toml").unwrap();
    assert_eq!(protocol.segments[0].movement.range().unwrap().1, 20.0_f64.to_radians());
    assert_eq!((protocol.name.as_str(), protocol.segments[0].label.as_str()), ("other", "a = b"));
    assert!(text.contains("amplitude_deg = 20    # to either side"), "{text}");
    assert_ne!(protocol.identity(), rig::identity(PROTOCOL));
}

#[test]
fn overrides_that_miss() {
    let error = |assignment: &str| {
        with_overrides(PROTOCOL, "p.toml", &[assignment]).unwrap_err().to_string()
    };
    let wrong = [
        "amplitude",
        "segments.1.amplitude_deg=20",
        "segmets.0.amplitude_deg=20",
        "segments.0.amplitude_deg=20 °",
        "segments.0=3",
        "segments..x=3",
    ];
    insta::assert_snapshot!(wrong.map(error).join("\n"));
}

#[test]
fn an_override_that_is_no_key_is_found_when_the_text_is_read() {
    let text = with_overrides(PROTOCOL, "p.toml", &["segments.0.amplitude=20"]).unwrap();
    let error = Protocol::parse(&text, "p.toml").unwrap_err();
    assert_eq!(error.problems()[0].key, "segments.0.amplitude");
    assert_eq!(error.problems()[0].advice, "did you mean `amplitude_deg`?");
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

const FREE: &str =
    "[protocol]\nname = \"free\"\n\n[[segments]]\nkind = \"free\"\nduration_s = 10.0\n";

/// A free movement with one more line, held against a rig.
fn free(line: &str, rig: &str) -> String {
    let rig = RigFile::parse(rig, "rig.toml").unwrap();
    match Protocol::parse(&format!("{FREE}{line}\n"), "p.toml") {
        Ok(protocol) => protocol.check_against(&rig).unwrap_err().to_string(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn field_that_is_none_or_stronger_than_the_rig_allows() {
    insta::assert_snapshot!(free("spring = 8.0", RIG));
    insta::assert_snapshot!(free("spring = 800.0", RIG));
    insta::assert_snapshot!(free("wall_min_deg = 30.0\nwall_max_deg = -30.0", RIG));
    insta::assert_snapshot!(free("wall_min_deg = 30.0", RIG));
    insta::assert_snapshot!(free("wall_stiffness = 3.0", RIG));
    insta::assert_snapshot!(free("amplitude_deg = 30.0", RIG));
    insta::assert_snapshot!(free("", include_str!("../../rigs/emps.toml")));
}

/// Problems of a learning segment on a rig.
fn learning(keys: &str, rig: &str) -> String {
    let text = format!("[protocol]\nname = \"p\"\n\n[[segments]]\nkind = \"learn\"\n{keys}\n");
    let found = Protocol::parse(&text, "p.toml").and_then(|protocol| {
        let rig = RigFile::parse(rig, "rig.toml").unwrap();
        protocol.check_against(&rig)
    });
    found.unwrap_err().to_string()
}

#[test]
fn learning_that_no_rig_can_do() {
    let sine = "amplitude_deg = 20\nfrequency_hz = 1.0\nblocks = 9\n";
    let with = |keys: &str| learning(&format!("{sine}{keys}"), RIG);
    let found = [
        with(""),
        with("law = \"model\""),
        with("law = \"none\""),
        with("law = \"published\"\ngamma_p = -0.1"),
        with("law = \"published\"\ngamma_p = nan"),
        with("law = \"published\"\ngamma_p = 0.4\ngamma_d = 0.2"),
        with("law = \"published\"\nharmonics = 3"),
        with("law = \"model-based\"\ncutoff_hz = 3.0\ngain = 2.0"),
        with("law = \"model-based\"\nharmonics = 30"),
        with("law = \"model-based\"\nharmonics = 24\nidentify_amplitude_deg = 110"),
        with("law = \"published\"\ncycles_per_block = 3\nsettling_cycles = 3"),
        with("law = \"published\"\nsave = \"../else\""),
        learning("amplitude_deg = 20\nfrequency_hz = 0.7\nblocks = 9\nlaw = \"published\"", RIG),
        learning(
            "amplitude_deg = 80\ncentre_deg = 80\nfrequency_hz = 1.0\nblocks = 9\nlaw = \"published\"",
            RIG,
        ),
        learning(&format!("{sine}law = \"published\""), include_str!("../../rigs/emps.toml")),
    ];
    insta::assert_snapshot!(found.join("\n"));
}

#[test]
fn force_control_without_a_torque_cell() {
    let edited = RIG.replace("[axes.torque]\nchannel = 0             # index of one of the channels below\nvolts_per_nm = 0.5      # assumed: no calibration is printed\noffset_v = 0.0          # reading with nobody at the handle\n", "").replace("torque_max_nm = 12.0\n", "");
    assert!(edited.len() + 100 < RIG.len());
    insta::assert_snapshot!(RigFile::parse(&edited, "rig.toml").unwrap_err());
}

#[test]
fn tables_that_are_none() {
    insta::assert_snapshot!(free("position_table_deg = [[-40, 0.0], [0, 0.5, 1.0]]", RIG));
    insta::assert_snapshot!(free("position_table_deg = [[0, 0.5]]", RIG));
    insta::assert_snapshot!(free("position_table_deg = [[0, 0.5], [0, 0.7]]", RIG));
    insta::assert_snapshot!(free("position_table_deg = [0.5, 0.7]", RIG));
    insta::assert_snapshot!(free(
        "position_table_deg = [[-40, 0.0], [-1, 0.0], [0, 2.0], [1, 0.0], [40, 0.0]]",
        RIG
    ));
    insta::assert_snapshot!(free("position_table_deg = [[-40, 0.0], [40, 20.0]]", RIG));
    insta::assert_snapshot!(free("velocity_table_deg_s = [[-40, nan], [40, 1.0]]", RIG));
    insta::assert_snapshot!(free(
        "position_table_deg = [[-40, 0.0], [40, 1.0]]\nposition_table_m = [[0, 1.0], [1, 0.0]]",
        RIG
    ));
}

#[test]
fn matrices_that_do_not_fit() {
    insta::assert_snapshot!(free("matrix_damping = [[0.1, 0.2], [0.2, 0.1]]", RIG));
    insta::assert_snapshot!(free("curl = 0.1", RIG));
    insta::assert_snapshot!(free("matrix_stiffness = [[0.1, 0.2], [0.2]]", RIG));
    insta::assert_snapshot!(free(
        "matrix_stiffness = [[0.1]]\nmatrix_damping = [[0.1, 0.0], [0.0, 0.1]]",
        RIG
    ));
    insta::assert_snapshot!(free("matrix_stiffness = [[0.1]]\nspring = 1.0", RIG));
    insta::assert_snapshot!(free("matrix_stiffness = [[0.1]]\ncentres_deg = [0.0, 1.0]", RIG));
    insta::assert_snapshot!(free("centres_deg = [0.0]", RIG));
    insta::assert_snapshot!(free("matrix_stiffness = [[9.0]]", RIG));
}

#[test]
fn fields_that_the_rig_would_not_bear() {
    insta::assert_snapshot!(free("damper = 1.5", RIG));
    insta::assert_snapshot!(free("damper = -0.5", RIG));
    insta::assert_snapshot!(free("inertia = 0.05", RIG));
    insta::assert_snapshot!(free("inertia = -0.05", RIG));
    insta::assert_snapshot!(free("spring = -3.0", RIG));
    insta::assert_snapshot!(free("matrix_damping = [[1.0]]", RIG));
    insta::assert_snapshot!(free("velocity_table_deg_s = [[-30, 2.0], [30, -2.0]]", RIG));
    // What is told to be the most passes, and a tenth more does not.
    let passes = |line: &str| {
        let protocol = Protocol::parse(&format!("{FREE}{line}\n"), "p.toml").unwrap();
        protocol.check_against(&RigFile::parse(RIG, "rig.toml").unwrap()).is_ok()
    };
    for (key, value) in [("damper", 1.5), ("damper", -0.5), ("inertia", 0.05), ("spring", -3.0)] {
        let told = free(&format!("{key} = {value}"), RIG);
        let words: Vec<&str> = told.split_whitespace().collect();
        let at = words
            .windows(2)
            .position(|pair| pair[0] == "at" && ["most", "least"].contains(&pair[1]))
            .unwrap();
        let most: f64 = words[at + 2].parse().unwrap();
        assert!(
            passes(&format!("{key} = {most}")) && !passes(&format!("{key} = {}", 1.1 * most)),
            "{told}"
        );
    }
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

/// The message after the shipped rig's check of a protocol with this one segment.
fn segment(keys: &str) -> String {
    let text = format!("[protocol]\nname = \"p\"\n\n[[segments]]\n{keys}");
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    match Protocol::parse(&text, "p.toml").and_then(|protocol| protocol.check_against(&rig)) {
        Ok(()) => panic!("accepted: {keys}"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn segments_of_the_new_kinds_that_the_rig_cannot_play() {
    let initialise = "kind = \"initialise\"\nspeed_deg_s = 25.0\nvolts = 4.0\nduration_s = 40.0\n";
    let all = [
        segment(&initialise.replace("4.0\n", "9.0\n")),
        segment(&initialise.replace("40.0", "10.0")),
        segment(&initialise.replace("25.0", "300.0")),
        segment(&format!("{initialise}first = \"left\"\n")),
        segment("kind = \"centre\"\nposition_deg = 10.0\nrise_s = 3.0\nduration_s = 2.0\n"),
        segment(
            "kind = \"rhythm\"\nfrequency_hz = 0.5\namplitude_deg = 100.0\ncentre_deg = 30.0\nduration_s = 20.0\n",
        ),
        segment("kind = \"rhythm\"\nfrequency_hz = 0.5\namplitude_deg = 30.0\nduration_s = 1.0\n"),
        segment("kind = \"ramp\"\nposition_deg = 60.0\nspeed_deg_s = 20.0\nduration_s = 4.0\n"),
        segment(
            "kind = \"chirp\"\namplitude_deg = 60.0\nfrom_hz = 0.1\nto_hz = 10.0\nduration_s = 60.0\n",
        ),
        segment(
            "kind = \"chirp\"\namplitude_deg = 5.0\nfrom_hz = 0.0\nto_hz = 10.0\nduration_s = 60.0\n",
        ),
        segment("kind = \"file\"\npath = \"way.csv\"\n"),
        segment("kind = \"file\"\ntimes_s = [0.0, 1.0, 0.5]\npositions_deg = [0.0, 1.0, 2.0]\n"),
        segment("kind = \"file\"\ntimes_s = [0.0, 1.0]\npositions_deg = [0.0, 1.0, 2.0]\n"),
        segment("kind = \"file\"\ntimes_s = [0.0, 0.01]\npositions_deg = [0.0, 60.0]\n"),
    ];
    insta::assert_snapshot!(all.join("\n"));
}

#[test]
fn a_table_is_taken_in_and_its_rows_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let protocol = folder.path().join("p.toml");
    let text = "[protocol]\nname = \"p\"\n\n[[segments]]\nkind = \"file\"\npath = \"way.csv\"\n\n[[segments]]\nkind = \"hold\"\nduration_s = 1.0\n";
    std::fs::write(&protocol, text).unwrap();
    let load = |csv: &str| {
        std::fs::write(folder.path().join("way.csv"), csv).unwrap();
        let told = |error: rig::ProtocolError| {
            error.to_string().replace(folder.path().to_str().unwrap(), "FOLDER")
        };
        Protocol::load(&protocol).map_err(told)
    };
    let good =
        load("# measured\nt_s, left_deg, right_deg\n0.0, 1.0, 0\n0.5, 10.25, 0\n2.0, -3.0, 0\n")
            .unwrap();
    let way = &good.segments[0].movement;
    assert!((way.duration_s() - 3.0).abs() < 1e-12, "a rise of 1 s, then the table");
    assert!((way.end(None).unwrap() - (-3.0_f64).to_radians()).abs() < 1e-12);
    // The text alone is enough to play it: the numbers are in it, and it is another text with other
    // numbers.
    let again = Protocol::parse(good.text(), "p.toml").unwrap();
    assert_eq!(again.segments, good.segments);
    assert_ne!(load("t_s,left_deg\n0,1\n2,-3\n").unwrap().identity(), good.identity());
    let bad = [
        load("time,left_deg\n0,1\n").unwrap_err(),
        load("t_s,left_deg\n0,1\n").unwrap_err(),
        load("t_s,left_deg\n0,1\n1,nan\n0.5,3\n2,x\n3,130\n4\n").unwrap_err(),
    ];
    insta::assert_snapshot!(bad.join("\n"));
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
