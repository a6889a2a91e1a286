//! The rig finds the ends of its travel: the whole chain of processes, and what the recording
//! shows.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;
use std::time::Duration;

use ipc_types::{
    COMMAND, Event, EventKind, Mode, MotorCommand, Process, SAMPLE, Sample, Severity, event_topic,
};
use launch::UnitState;
use recording::mcap_read::Recording;
use serde_json::Value;

use common::{Signal, TestRig, kill, told, wait_for, workers};

const RIG: &str = include_str!("../launch/rigs/hydrostatic.toml");

/// End stops close to the middle, so that the test is short.
const STOPS_DEG: (f64, f64) = (-24.0, 18.0);

const PROTOCOL: &str = r#"[protocol]
name = "find"

[[segments]]
kind = "initialise"
label = "initialise"
speed_deg_s = 40.0
volts = 4.0
duration_s = 25.0

[[segments]]
kind = "centre"
label = "centre"
position_deg = -2.0
rise_s = 2.0
duration_s = 4.0
"#;

/// A movement that needs positions.
const MOVEMENT: &str = r#"[protocol]
name = "move"

[[segments]]
kind = "steps"
label = "steps"
positions_deg = [5.0, -5.0]
rise_s = 1.0
dwell_s = 0.5
"#;

/// The rig with its stops elsewhere, in the simulation and in the rig file.
fn rig_text() -> String {
    let (lower, upper) = STOPS_DEG;
    let moved = [
        ("end_stop_min_deg = -85.0", format!("end_stop_min_deg = {lower:?}")),
        ("end_stop_max_deg = 85.0", format!("end_stop_max_deg = {upper:?}")),
        ("lower_stop_deg = -85.0", format!("lower_stop_deg = {lower:?}")),
        ("upper_stop_deg = 85.0", format!("upper_stop_deg = {upper:?}")),
    ];
    moved.iter().fold(RIG.to_owned(), |text, (old, new)| {
        assert_eq!(text.matches(old).count(), 1, "{old}");
        text.replace(old, new)
    })
}

/// Powers up and plays to the end. On a loaded host a best-effort rig may trip, rightly; the test
/// then resets it and starts again.
fn play(rig: &TestRig, protocol: &str) -> String {
    let mut last = String::new();
    for attempt in 1..=20 {
        // An enabled rig refuses `enable`.
        let _disarmed = rig.run(["disarm"]);
        rig.power_up();
        let output = rig.run(["run", protocol]);
        last = told(&output);
        println!("attempt {attempt}: {}", String::from_utf8_lossy(&output.stdout).trim());
        if output.status.success() {
            return String::from_utf8(output.stdout).unwrap();
        }
        assert!(last.contains("tripped"), "{last}");
    }
    panic!("never played to its end: {last}");
}

/// Axes that are not homed, by `farreach status`.
fn unhomed(rig: &TestRig) -> Value {
    let status: Value = serde_json::from_str(&rig.ok(["status", "--json"])).unwrap();
    status["unhomed"].clone()
}

/// Axes whose range of motion is not in force, by `farreach status`.
fn not_in_force(rig: &TestRig) -> Value {
    let status: Value = serde_json::from_str(&rig.ok(["status", "--json"])).unwrap();
    status["range_not_in_force"].clone()
}

/// Kills a process and waits until its successor is ready.
fn replace(rig: &TestRig, unit: &str) {
    let process = || rig.launcher_status().unit(unit).and_then(|unit| unit.process);
    let before = process().unwrap();
    kill(before.pid, Signal::KILL);
    let ready = || {
        let status = rig.launcher_status();
        status.unit(unit).is_some_and(|unit| {
            unit.state == UnitState::Ready && unit.process.is_some_and(|now| now != before)
        })
    };
    assert!(wait_for(Duration::from_secs(30), ready), "{unit}: {}", rig.why(unit));
}

#[test]
fn sr_27_an_axis_is_homed_between_its_stops_until_the_card_is_powered_up_again() {
    let rig = TestRig::patient("initialise");
    let (rig_file, protocol, record) =
        (rig.path("stops.toml"), rig.path("find.toml"), rig.path("find.mcap"));
    std::fs::write(&rig_file, rig_text()).unwrap();
    std::fs::write(&protocol, PROTOCOL).unwrap();
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let (rig_file, protocol, record) = (text(&rig_file), text(&protocol), text(&record));
    let movement = text(&rig.path("move.toml"));
    std::fs::write(&movement, MOVEMENT).unwrap();
    rig.ok(["up", "--simulate", "--rig", &rig_file, "--record", &record]);
    rig.power_up();
    assert_eq!(unhomed(&rig), serde_json::json!([0]));
    let refused = rig.run(["run", &movement]);
    assert_eq!(refused.status.code(), Some(1), "{}", told(&refused));
    common::assert_told(&refused, &["axis 0", "not homed", "farreach run home"]);

    // `run` shows the range that was found.
    let stdout = play(&rig, &protocol);
    assert!(stdout.contains("axis 0: range -2"), "{stdout}");
    assert_eq!(unhomed(&rig), serde_json::json!([]));
    rig.ok(["rec", "stop"]);

    for unit in workers() {
        replace(&rig, unit);
        // The newest sample of the successor, or of the next acquisition.
        let expected =
            if unit == "simulator" { serde_json::json!([0]) } else { serde_json::json!([]) };
        let shown = wait_for(Duration::from_secs(10), || unhomed(&rig) == expected);
        assert!(shown, "after the kill of {unit}: {}", unhomed(&rig));
        if unit == "simulator" {
            rig.power_up();
            let refused = rig.run(["run", &movement]);
            common::assert_told(&refused, &["not homed"]);
            play(&rig, &protocol);
            assert_eq!(unhomed(&rig), serde_json::json!([]));
        }
    }
    play(&rig, &movement);
    rig.down();

    let recording = Recording::open(Path::new(&record)).unwrap();
    let topic = event_topic(Process::Experiment).unwrap().topic.name;
    let events: Vec<Event> =
        recording.messages::<Event>(topic).unwrap().map(|event| event.unwrap().message).collect();
    let found: Vec<&Event> =
        events.iter().filter(|event| event.kind == EventKind::RangeFound.code()).collect();
    let [ends, warning] = found[found.len() - 2..] else { panic!("{found:?}") };
    println!("found {:.2}° to {:.2}°: {}", ends.a.to_degrees(), ends.b.to_degrees(), ends.text());
    println!(
        "motor {:.2}° to {:.2}°: {}",
        warning.a.to_degrees(),
        warning.b.to_degrees(),
        warning.text()
    );
    assert!(
        (ends.a.to_degrees() - STOPS_DEG.0).abs() < 1.0
            && (ends.b.to_degrees() - STOPS_DEG.1).abs() < 1.0
    );
    assert_eq!((ends.c, ends.severity), (0.0, Severity::Info.code()));
    assert_eq!(warning.severity, Severity::Warning.code(), "the stops are far within the limits");

    let commands: Vec<MotorCommand> = recording
        .messages::<MotorCommand>(COMMAND.topic.name)
        .unwrap()
        .map(|command| command.unwrap().message)
        .collect();
    let of = |mode: Mode| commands.iter().filter(move |command| command.mode == mode.code());
    assert!(of(Mode::Initialise).count() > 1000 && of(Mode::Centre).count() > 500);
    let most = of(Mode::Initialise).map(|command| command.volts[0].abs()).fold(0.0, f64::max);
    // Coming from another mode, a larger output would decrease within 50 ms; here the first mode is
    // the one with the low limit.
    assert!(most <= 4.0 + 1e-9, "{most} V");
    let samples: Vec<Sample> = recording
        .messages::<Sample>(SAMPLE.topic.name)
        .unwrap()
        .map(|sample| sample.unwrap().message)
        .collect();
    let ended = of(Mode::Centre).next_back().unwrap().sample_tick;
    let at_the_end = samples.iter().rev().find(|sample| sample.tick <= ended).unwrap();
    let position = at_the_end.master_position[0].to_degrees();
    assert!((position + 2.0).abs() < 6.0, "the handle rests at {position}°");
}

/// A range of motion far within the stops: shown while nothing holds the handle to it, left by the
/// search, and kept by what follows.
#[test]
fn a_range_of_motion_is_in_force_once_the_axis_is_homed() {
    let rig = TestRig::patient("range");
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let range = "[axes.range_of_motion]\nmin_deg = -12.0\nmax_deg = 10.0\n\n[axes.homing]";
    let rig_file = rig.path("range.toml");
    std::fs::write(&rig_file, rig_text().replace("[axes.homing]", range)).unwrap();
    let (within, beyond) = (text(&rig.path("within.toml")), text(&rig.path("beyond.toml")));
    std::fs::write(&within, MOVEMENT).unwrap();
    std::fs::write(&beyond, MOVEMENT.replace("[5.0, -5.0]", "[5.0, 15.0]")).unwrap();
    rig.ok(["up", "--simulate", "--rig", &text(&rig_file)]);
    rig.power_up();
    let shown = rig.ok(["status"]);
    assert!(shown.contains("range of motion not in force on axis 0 (not homed)"), "{shown}");
    assert_eq!(not_in_force(&rig), serde_json::json!([0]));

    play(&rig, "home");
    assert_eq!(not_in_force(&rig), serde_json::json!([]));
    let shown = rig.ok(["status"]);
    assert!(!shown.contains("range of motion"), "{shown}");
    let refused = rig.run(["run", &beyond]);
    assert!(!refused.status.success(), "{}", told(&refused));
    common::assert_told(
        &refused,
        &[
            "segments.0.positions_deg: expected positions from -12.0° to 10.0°",
            "the range of motion of axis 0 (\"handle\")",
            "found a steps from 5.0° to 15.0°",
        ],
    );
    // A search with a subject's segments beside it.
    let refused = rig.run(["run", "initialise"]);
    assert!(!refused.status.success(), "{}", told(&refused));
    common::assert_told(&refused, &["segments.2.kind: expected only initialise, centre and hold"]);
    play(&rig, &within);
    rig.down();
}
