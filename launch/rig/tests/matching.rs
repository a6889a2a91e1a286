//! The matching experiment of the appendix: its limits, its sequence, and where its centre is.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use rig::RigFile;
use rig::protocol::{Movement, Protocol, Signal};

const GOOD: &str = r#"
[protocol]
name = "matching"

[matching]
signal = "torque"
sets = 2
session_s = 30
rest_s = 20
start_up_s = 10
centre_deg = 100
frequency_hz = 1
amplitude_deg = 30
spring = 0.5
"#;

fn rig_text() -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../rigs/hydrostatic.toml");
    std::fs::read_to_string(path).unwrap()
}

fn rig() -> RigFile {
    RigFile::parse(&rig_text(), "hydrostatic.toml").unwrap()
}

fn protocol(text: &str) -> Protocol {
    Protocol::parse(text, "matching.toml").unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn the_sequence_is_that_of_the_appendix() {
    let protocol = protocol(GOOD);
    let segments = protocol.segments_on(&rig());
    let kinds: Vec<_> = segments.iter().map(|segment| segment.movement.kind()).collect();
    let expected = [
        "wait_for_scanner",
        "rhythm",
        "centre",
        "rest",
        "guided_sine",
        "centre",
        "rest",
        "rhythm",
        "centre",
        "rest",
        "guided_sine",
        "centre",
    ];
    assert_eq!(kinds, expected, "rhythm and guided in turn, no rest after the last");
    let sessions = segments.iter().filter(|segment| segment.session);
    let labels: Vec<_> = sessions.map(|segment| segment.label.as_str()).collect();
    assert_eq!(
        labels,
        [
            "session 1 of 4: rhythm",
            "session 2 of 4: guided",
            "session 3 of 4: rhythm",
            "session 4 of 4: guided"
        ]
    );
    // 10 s after the pulse, which may take 300 s; sessions of 30 s, centring 3 s, rests of 20 s.
    assert_eq!(protocol.duration_s(), 310.0 + 4.0 * 33.0 + 3.0 * 20.0);
    assert_eq!(protocol.matching.unwrap().signal, Signal::Torque);
}

#[test]
fn the_centre_counts_from_the_corner_of_the_rig() {
    let protocol = protocol(GOOD);
    let centres = |rig: &RigFile| {
        let segments = protocol.segments_on(rig);
        let centre = |at: usize| match &segments[at].movement {
            Movement::Rhythm(rhythm) => rhythm.field.centre.to_degrees(),
            Movement::GuidedSine(sine) => sine.envelope.centre.to_degrees(),
            Movement::Centre(centre) => centre.position.unwrap().to_degrees(),
            other => panic!("{other:?}"),
        };
        [1, 2, 4].map(centre)
    };
    // The lower stop is at -85°.
    assert!(centres(&rig()).iter().all(|centre| (centre - 15.0).abs() < 1e-9));
    // With absolute encoders the corner is the lower limit.
    let text = rig_text();
    let begin = text.find("[axes.homing]").unwrap();
    let end = begin + text[begin..].find("\n\n").unwrap();
    let absolute =
        format!("{}[axes.homing]\nmethod = \"absolute\"{}", &text[..begin], &text[end..]);
    let absolute = RigFile::parse(&absolute, "absolute.toml").unwrap();
    assert!(centres(&absolute).iter().all(|centre| (centre + 20.0).abs() < 1e-9));
}

#[test]
fn values_beyond_the_appendix_are_refused_with_their_key() {
    let refused = [
        ("sets = 2", "sets = 0", "matching.sets", "a whole number from 1 to 100"),
        ("session_s = 30", "session_s = 4.9", "matching.session_s", "from 5 to 600"),
        ("rest_s = 20", "rest_s = 9", "matching.rest_s", "from 10 to 3600"),
        ("start_up_s = 10", "start_up_s = 9.5", "matching.start_up_s", "from 10 to 600"),
        ("centre_deg = 100", "centre_deg = 69", "matching.centre_deg", "from 70 to 130"),
        ("centre_deg = 100", "centre_deg = 131", "matching.centre_deg", "from 70 to 130"),
        ("frequency_hz = 1", "frequency_hz = 3.1", "matching.frequency_hz", "from 0.2 to 3"),
        ("amplitude_deg = 30", "amplitude_deg = 41", "matching.amplitude_deg", "from 0 to 40"),
        ("spring = 0.5", "spring = 2.1", "matching.spring", "from 0.1 to 2"),
        ("\"torque\"", "\"force\"", "matching.signal", "one of \"torque\", \"emg\""),
        ("spring = 0.5", "spring = 0.5\nsprings = 1", "matching.springs", "one of"),
        ("sets = 2\n", "", "matching.sets", "a whole number"),
    ];
    for (from, to, key, expected) in refused {
        let text = GOOD.replace(from, to);
        assert_ne!(text, GOOD);
        let error = Protocol::parse(&text, "matching.toml").unwrap_err().to_string();
        assert!(error.contains(key) && error.contains(expected), "{to}: {error}");
    }
    let text = GOOD.replace("session_s = 30", "session_s = 5\nfade_s = 2.6");
    let error = Protocol::parse(&text, "matching.toml").unwrap_err().to_string();
    assert!(error.contains("matching.fade_s") && error.contains("half of session_s"), "{error}");
}

#[test]
fn a_matching_experiment_has_no_segments_of_its_own() {
    let both = format!("{GOOD}\n[[segments]]\nkind = \"rest\"\nduration_s = 1\n");
    let error = Protocol::parse(&both, "matching.toml").unwrap_err().to_string();
    assert!(error.contains("either segments or [matching]"), "{error}");
    let twice = GOOD.replace("[protocol]", "[protocol]\nrepeat = 2");
    let error = Protocol::parse(&twice, "matching.toml").unwrap_err().to_string();
    assert!(error.contains("protocol.repeat") && error.contains("matching.sets"), "{error}");
    let early = "[protocol]\nname = \"early\"\n[[segments]]\nkind = \"wait_for_scanner\"\n\
                 timeout_s = 10\nstart_up_s = 0.1\n[[segments]]\nkind = \"rest\"\nduration_s = 5\n\
                 session = true\n";
    let error = Protocol::parse(early, "early.toml").unwrap_err().to_string();
    assert!(error.contains("a start_up_s of at least 0.2 s before a session"), "{error}");
    assert!(Protocol::parse(&early.replace("session = true", ""), "early.toml").is_ok());
    let none = "[protocol]\nname = \"none\"\n";
    let error = Protocol::parse(none, "matching.toml").unwrap_err().to_string();
    assert!(error.contains("at least one segment"), "{error}");
}

#[test]
fn what_the_rig_cannot_do_names_the_key_of_the_section() {
    let refusal =
        |text: &str, rig: &RigFile| protocol(text).check_against(rig).unwrap_err().to_string();
    protocol(GOOD).check_against(&rig()).unwrap();
    let slow = rig_text().replace("speed_max_deg_s = 1500.0", "speed_max_deg_s = 400.0");
    let slow = RigFile::parse(&slow, "slow.toml").unwrap();
    let fast = GOOD.replace("frequency_hz = 1", "frequency_hz = 3");
    let error = refusal(&fast, &slow);
    assert!(error.contains("matching.amplitude_deg: expected speeds up to 400"), "{error}");
    let narrow = rig_text().replace("upper_stop_deg = 85.0", "upper_stop_deg = 40.0");
    let narrow = RigFile::parse(&narrow, "narrow.toml").unwrap();
    let error = refusal(GOOD, &narrow);
    assert!(
        error.contains("matching.amplitude_deg: expected positions between the stops"),
        "{error}"
    );
    let error = refusal(&format!("{GOOD}axis = 2\n"), &rig());
    assert!(error.contains("matching.axis: expected an axis of the rig"), "{error}");
}

#[test]
fn a_still_session_is_allowed() {
    // The appendix accepts an amplitude of 0.
    let still = protocol(&GOOD.replace("amplitude_deg = 30", "amplitude_deg = 0"));
    still.check_against(&rig()).unwrap();
    for segment in still.segments_on(&rig()).iter() {
        let peak = segment.movement.feedforward_speed();
        let point = segment.movement.at(0.1, 0.7, peak);
        assert!(point.position.is_finite() && point.velocity.is_finite(), "{}", segment.label);
    }
}
