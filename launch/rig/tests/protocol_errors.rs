//! Messages for mistakes in a protocol: file, line, key, expected, found, what to do.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use rig::RigFile;
use rig::protocol::{Protocol, with_overrides};

const RIG: &str = include_str!("../../rigs/hydrostatic.toml");

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
    let text = "[protocol]\nname = \"x\"\n[[segments]]\nkind = \"multisine\"\n\
                frequencies_hz = [1, 2, 3]\namplitudes_deg = [1, 2]\nduration_s = 5\n";
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
            "amplitude_deg = 80\ncentre_deg = 80\nfrequency_hz = 1.0\nblocks = 9\n\
             law = \"published\"",
            RIG,
        ),
        learning(&format!("{sine}law = \"published\""), include_str!("../../rigs/emps.toml")),
    ];
    insta::assert_snapshot!(found.join("\n"));
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
            "kind = \"rhythm\"\nfrequency_hz = 0.5\namplitude_deg = 100.0\ncentre_deg = 30.0\n\
             duration_s = 20.0\n",
        ),
        segment("kind = \"rhythm\"\nfrequency_hz = 0.5\namplitude_deg = 30.0\nduration_s = 1.0\n"),
        segment("kind = \"ramp\"\nposition_deg = 60.0\nspeed_deg_s = 20.0\nduration_s = 4.0\n"),
        segment(
            "kind = \"chirp\"\namplitude_deg = 60.0\nfrom_hz = 0.1\nto_hz = 10.0\n\
             duration_s = 60.0\n",
        ),
        segment(
            "kind = \"chirp\"\namplitude_deg = 5.0\nfrom_hz = 0.0\nto_hz = 10.0\n\
             duration_s = 60.0\n",
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
    let text = "[protocol]\nname = \"p\"\n\n[[segments]]\nkind = \"file\"\npath = \"way.csv\"\n\n\
                [[segments]]\nkind = \"hold\"\nduration_s = 1.0\n";
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

/// Half a thousand million segments with their repeats: gone through one by one, that took minutes.
#[test]
fn too_many_repeats_are_told_without_going_through_them() {
    let segment = "[[segments]]\nkind = \"hold\"\nduration_s = 1.0\nrepeat = 1000\n";
    let text = format!("[protocol]\nname = \"p\"\nrepeat = 1000\n\n{}", segment.repeat(500));
    let error = Protocol::parse(&text, "p.toml").unwrap_err().to_string();
    assert!(error.contains("at most 10000 segments") && error.contains("500000000"), "{error}");
}
