//! A recording of a rig of real processes, run again: homing, a movement, control killed in the
//! midst of it, a trip, and a movement with its successor. Nothing differs; a bit that is altered
//! in the recording is found.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;
use std::process::{Output, Stdio};
use std::time::Duration;

use ipc_types::{
    COMMAND, ENABLE_LINE, EnableLine, EnableToken, Message, MotorCommand, SAMPLE, SETPOINT, Sample,
    Setpoint, TOKEN, TypedTopic,
};
use recording::mcap_read::Recording;
use recording::mcap_write::{Start, Writer, key};
use serde_json::Value;

use common::playing::{messages, play_until};
use common::{Signal, TestRig, kill, told, wait_for};

const MOVEMENT: [&str; 4] = ["run", "guided-1hz", "--set", "segments.0.duration_s=4"];

/// Plays the movement and kills control once volts flow; the rig trips.
fn kill_control(rig: &TestRig) {
    let process = || rig.launcher_status().unit("control").and_then(|unit| unit.process);
    let _disarmed = rig.run(["disarm"]);
    rig.power_up();
    let mut run = rig.farreach(MOVEMENT);
    let run = run.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(2));
    let before = process().unwrap();
    kill(before.pid, Signal::KILL);
    let output = run.wait_with_output().unwrap();
    assert!(told(&output).contains("tripped"), "{}", told(&output));
    let restarted =
        wait_for(Duration::from_secs(30), || process().is_some_and(|now| now != before));
    assert!(restarted, "{}", rig.why("control"));
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", told(output)))
}

#[test]
fn a_recording_of_a_rig_gives_the_same_again_and_an_altered_one_does_not() {
    let rig = TestRig::patient("resim");
    let file = rig.path("run.mcap");
    let name = file.to_str().unwrap();
    rig.ok(["up", "--simulate", "--record", name]);
    play_until(&rig, &["run", "home"], "completed");
    play_until(&rig, &MOVEMENT, "completed");
    kill_control(&rig);
    play_until(&rig, &MOVEMENT, "completed");
    rig.down();

    let output = rig.run(["rec", "resim", name, "--json"]);
    let found = json(&output);
    let text = || String::from_utf8(rig.run(["rec", "resim", name]).stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text());
    assert_eq!(found["same"], true);
    assert_eq!(found["damaged_chunks"], 0);
    for core in found["cores"].as_array().unwrap() {
        let count = |key: &str| core[key].as_u64().unwrap();
        assert!(count("compared") > 5000 && count("differing") == 0, "{}", text());
        let skipped: u64 =
            core["not_compared"].as_object().unwrap().values().filter_map(Value::as_u64).sum();
        assert_eq!(count("compared") + skipped, count("messages"), "{}", text());
    }
    let control = &found["cores"][0];
    assert!(control["begins"].as_array().unwrap().len() >= 2, "{}", text());
    let trips = found["trips"].as_array().unwrap();
    assert!(!trips.is_empty(), "{}", text());
    for trip in trips {
        assert_eq!(trip["recorded"], trip["recomputed"], "{}", text());
    }
    assert!(text().contains("all that was compared is the same"), "{}", text());
    println!("{}", text());
    alter(&rig, &file);
    other_gains(&rig, &file);
}

/// Alters the volts of one command: it is the only one of control that differs.
fn alter(rig: &TestRig, file: &Path) {
    let recording = Recording::open(file).unwrap();
    let commands: Vec<MotorCommand> = messages(&recording, COMMAND.topic.name);
    let mut altered = *commands.iter().filter(|one| one.volts[0] != 0.0).nth(500).unwrap();
    let was = altered.volts[0];
    altered.volts[0] += 0.25;
    std::fs::create_dir(rig.path("altered")).unwrap();
    let path = rig.path("altered/run.mcap");
    let start = [key::RIG_FILE, key::PROFILE]
        .iter()
        .fold(Start::default(), |start, key| start.with(key, recording.metadata(key).unwrap()));
    let mut writer = Writer::create(&path, &start, 0).unwrap();
    copy::<Sample>(&recording, &SAMPLE, &mut writer, |_| {});
    copy::<Setpoint>(&recording, &SETPOINT, &mut writer, |_| {});
    copy::<EnableToken>(&recording, &TOKEN, &mut writer, |_| {});
    copy::<EnableLine>(&recording, &ENABLE_LINE, &mut writer, |_| {});
    copy::<MotorCommand>(&recording, &COMMAND, &mut writer, |one| {
        if (one.incarnation, one.sequence) == (altered.incarnation, altered.sequence) {
            *one = altered;
        }
    });
    writer.finish(&[]).unwrap();
    let output = rig.farreach(["rec", "resim", "--json"]).arg(&path).output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", told(&output));
    let found = json(&output);
    let control = &found["cores"][0];
    assert_eq!(control["differing"], 1, "{control}");
    let first = &control["first_difference"];
    assert_eq!(first["topic"], "command");
    assert_eq!(first["field"], "volts[0]");
    assert_eq!(first["sequence"], altered.sequence);
    assert_eq!(first["tick"], altered.sample_tick);
    let close = |key: &str, volts: f64| (first[key].as_f64().unwrap() - volts).abs() < 1e-9;
    assert!(close("recorded", altered.volts[0]) && close("recomputed", was), "{first}");
    assert_eq!(first["inputs"][0]["topic"], "sample");
}

/// Copies the messages of a topic.
fn copy<T: Message>(
    recording: &Recording,
    topic: &TypedTopic<T>,
    writer: &mut Writer,
    change: impl Fn(&mut T),
) {
    for mut message in messages::<T>(recording, topic.topic.name) {
        change(&mut message);
        writer.write_message(topic, &message).unwrap();
    }
}

/// The gains of the rig itself give its own volts, those of another one others.
fn other_gains(rig: &TestRig, file: &Path) {
    let own = rig.path("own.toml");
    let name = file.to_str().unwrap();
    std::fs::write(&own, rig.ok(["rec", "info", name, "--text", "rig_file"])).unwrap();
    let volts = |gains: &str| {
        let found = json(&rig.run(["rec", "resim", name, "--json", "--control", gains]));
        assert_eq!(found["same"], true, "{found}");
        found["other_gains"]["volts"][0]["rms_v"].as_f64().unwrap()
    };
    assert_eq!(volts(own.to_str().unwrap()), 0.0);
    assert!(volts("cable") > 0.0);
    let text = rig.ok(["rec", "resim", name, "--control", "cable"]);
    assert!(text.contains("the machine would have moved differently"), "{text}");
}
