//! A recording of a rig of real processes, run again: homing, a movement, control killed in the
//! midst of it, a trip, and a movement with its successor; the experiment killed in the midst of a
//! movement that its successor ends, a stop, and a protocol in a scanner. Nothing differs; a bit
//! that is altered in the recording is found.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::Duration;

use ipc_types::{
    COMMAND, ENABLE_LINE, EnableLine, EnableToken, Message, MotorCommand, SAMPLE, SETPOINT, Sample,
    Setpoint, TOKEN, TypedTopic,
};
use recording::mcap_read::Recording;
use recording::mcap_write::{Start, Writer, key};
use serde_json::Value;

use common::playing::{messages, play_until, play_with_kills};
use common::{Signal, TestRig, kill, told, wait_for};

/// Two steps between the volumes of a scanner.
const SCAN: &str = r#"[protocol]
name = "scan"

[scanner]
repetition_s = 0.5

[[segments]]
kind = "wait_for_scanner"
timeout_s = 4.0
start_up_s = 0.2

[[segments]]
kind = "steps"
positions_deg = [10.0, 0.0]
rise_s = 0.4
dwell_s = 0.6
"#;

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

/// Plays the movement and stops it; again after a trip of the rig.
fn stop(rig: &TestRig) {
    for _ in 0..10 {
        let _disarmed = rig.run(["disarm"]);
        rig.power_up();
        let mut run = rig.farreach(MOVEMENT);
        let run = run.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs(2));
        let stopped = rig.run(["stop"]);
        let output = run.wait_with_output().unwrap();
        // A trip ends it in other words.
        if stopped.status.success() && told(&output).contains("stopped after") {
            // It comes to rest, and the volts go to 0.
            std::thread::sleep(Duration::from_secs(2));
            return;
        }
    }
    panic!("never stopped");
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
    play_with_kills(&rig, &MOVEMENT[1..], &[0]);
    stop(&rig);
    let scan = rig.path("scan.toml");
    std::fs::write(&scan, SCAN).unwrap();
    let in_scanner = ["run", scan.to_str().unwrap(), "--emulate-scanner", "0.5"];
    play_until(&rig, &in_scanner, "completed");
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
    for core in [0_usize, 4] {
        let begins = found["cores"][core]["begins"].as_array().unwrap();
        assert!(begins.len() >= 2, "{}", text());
    }
    let experiment = &found["cores"][4];
    assert_eq!(experiment["core"], "experiment");
    // Where the host lost a message, what follows is left out; nothing else is.
    for why in experiment["not_compared"].as_object().unwrap().keys() {
        assert!(["input_missing", "messages_missing"].contains(&why.as_str()), "{}", text());
    }
    let trips = found["trips"].as_array().unwrap();
    assert!(!trips.is_empty(), "{}", text());
    for trip in trips {
        assert_eq!(trip["recorded"], trip["recomputed"], "{}", text());
    }
    assert!(text().contains("all that was compared is the same"), "{}", text());
    println!("{}", text());
    alter_command(&rig, &file);
    alter_setpoint(&rig, &file);
    other_gains(&rig, &file);
}

/// Writes the recording once more with commands and setpoints changed, and runs it again; what is
/// found.
fn altered(
    rig: &TestRig,
    recording: &Recording,
    change_command: impl Fn(&mut MotorCommand),
    change_setpoint: impl Fn(&mut Setpoint),
) -> Value {
    let folder: PathBuf = rig.path("altered");
    std::fs::create_dir(&folder).unwrap();
    let path = folder.join("run.mcap");
    let start = [key::RIG_FILE, key::PROFILE]
        .iter()
        .fold(Start::default(), |start, key| start.with(key, recording.metadata(key).unwrap()));
    let mut writer = Writer::create(&path, &start, 0).unwrap();
    for run in recording.runs() {
        writer.write_run(run).unwrap();
    }
    copy::<Sample>(recording, &SAMPLE, &mut writer, |_| {});
    copy::<EnableToken>(recording, &TOKEN, &mut writer, |_| {});
    copy::<EnableLine>(recording, &ENABLE_LINE, &mut writer, |_| {});
    copy::<Setpoint>(recording, &SETPOINT, &mut writer, change_setpoint);
    copy::<MotorCommand>(recording, &COMMAND, &mut writer, change_command);
    writer.finish(&[]).unwrap();
    let output = rig.farreach(["rec", "resim", "--json"]).arg(&path).output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", told(&output));
    std::fs::remove_dir_all(folder).unwrap();
    json(&output)
}

/// Alters the position of one setpoint of each run: these alone differ, of the runs in which the
/// host lost no message before.
fn alter_setpoint(rig: &TestRig, file: &Path) {
    let recording = Recording::open(file).unwrap();
    let mut runs: BTreeMap<(u64, u32), Vec<Setpoint>> = BTreeMap::new();
    for one in messages::<Setpoint>(&recording, SETPOINT.topic.name) {
        if one.velocity[0] != 0.0 {
            runs.entry((one.incarnation, one.run)).or_default().push(one);
        }
    }
    let chosen = runs.values().map(|run| run[run.len() / 2]);
    let chosen: BTreeMap<(u64, u64), Setpoint> =
        chosen.map(|one| ((one.incarnation, one.sequence), one)).collect();
    let change = |one: &mut Setpoint| {
        if chosen.contains_key(&(one.incarnation, one.sequence)) {
            one.position[0] = f64::from_bits(one.position[0].to_bits() ^ 1);
        }
    };
    let found = altered(rig, &recording, |_| {}, change);
    let experiment = &found["cores"][4];
    let differing = experiment["differing"].as_u64().unwrap();
    assert!((1..=chosen.len() as u64).contains(&differing), "{experiment}");
    let first = &experiment["first_difference"];
    assert_eq!((&first["topic"], &first["field"]), (&"setpoint".into(), &"position[0]".into()));
    let sequence = first["sequence"].as_u64().unwrap();
    let one = chosen
        .values()
        .find(|one| one.sequence == sequence && Some(one.sample_tick) == first["tick"].as_u64());
    assert!(one.is_some(), "{first}");
    let topics: Vec<_> =
        first["inputs"].as_array().unwrap().iter().map(|used| &used["topic"]).collect();
    assert_eq!(topics, ["sample", "token", "setpoint"]);
}

/// Alters the volts of one command: it is the only one of control that differs.
fn alter_command(rig: &TestRig, file: &Path) {
    let recording = Recording::open(file).unwrap();
    let commands: Vec<MotorCommand> = messages(&recording, COMMAND.topic.name);
    let mut altered_one = *commands.iter().filter(|one| one.volts[0] != 0.0).nth(500).unwrap();
    let was = altered_one.volts[0];
    altered_one.volts[0] += 0.25;
    let change = |one: &mut MotorCommand| {
        if (one.incarnation, one.sequence) == (altered_one.incarnation, altered_one.sequence) {
            *one = altered_one;
        }
    };
    let found = altered(rig, &recording, change, |_| {});
    let control = &found["cores"][0];
    assert_eq!(control["differing"], 1, "{control}");
    let first = &control["first_difference"];
    assert_eq!(first["topic"], "command");
    assert_eq!(first["field"], "volts[0]");
    assert_eq!(first["sequence"], altered_one.sequence);
    assert_eq!(first["tick"], altered_one.sample_tick);
    let close = |key: &str, volts: f64| (first[key].as_f64().unwrap() - volts).abs() < 1e-9;
    assert!(close("recorded", altered_one.volts[0]) && close("recomputed", was), "{first}");
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
