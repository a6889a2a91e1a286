//! The streams of Lab Streaming Layer, as a receiver gets them, against the recording of the same
//! time.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "common/bridge_process.rs"]
mod bridge_process;
mod common;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use bridge_process::Bridge;
use common::{Signal, TestRig, kill, told};
use ipc_types::{Event, Sample};
use recording::mcap_read::Recording;
use serde_json::Value;

/// A Python with the package pylsl, which brings liblsl along; without it the test is skipped.
const PYTHON: &str = "FARREACH_PYTHON";
/// Samples that the receiver takes: two seconds.
const SAMPLES: usize = 4000;
/// The receiver's times are those of the sender to the bits that decimal text and the offset's nine
/// digits leave (s).
const ROUNDED_S: f64 = 2e-9;

/// The library in the package.
fn library(python: &str) -> PathBuf {
    let at = "import os, pylsl.lib; print(os.path.dirname(pylsl.lib.__file__))";
    let output = Command::new(python).args(["-c", at]).output().unwrap();
    assert!(output.status.success(), "{}", told(&output));
    Path::new(String::from_utf8(output.stdout).unwrap().trim()).join("liblsl.so")
}

fn number(value: &Value) -> f64 {
    // Numbers that are not finite are no JSON: Python writes NaN.
    value.as_f64().unwrap_or(f64::NAN)
}

fn text_number(value: &Value) -> f64 {
    value.as_str().unwrap().parse().unwrap()
}

/// Runs the receiver until it has its samples and a marker of a `reset`; what it says.
fn received(rig: &TestRig, python: &str, configuration: &Path) -> Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/stand_in/lsl_receiver.py");
    let mut child = Command::new(python)
        .arg(script)
        .args([rig.name().as_str(), &SAMPLES.to_string(), "1"])
        .env("LSLAPICFG", configuration)
        .env("FARREACH_RIG_NAME", rig.name().as_str())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert_eq!(lines.next().as_deref(), Some("ready"));
    // Whether it is allowed or not, the watchdog tells it.
    rig.run(["reset"]);
    rig.run(["arm"]);
    let line = lines.next().expect("the receiver gave up");
    assert!(child.wait().unwrap().success());
    serde_json::from_str(&line.replace("NaN", "null")).unwrap()
}

#[test]
fn samples_and_markers_reach_a_receiver_in_python() {
    let Ok(python) = std::env::var(PYTHON) else {
        eprintln!("SKIPPED: {PYTHON} names no Python with the package pylsl");
        return;
    };
    let rig = TestRig::patient("bridge-lsl");
    // This test's streams are nobody else's business.
    let configuration = rig.path("lsl_api.cfg");
    std::fs::write(&configuration, "[multicast]\nResolveScope = machine\n").unwrap();
    rig.up_homed();
    let recording = rig.path("run.mcap");
    rig.ok(["rec", "start", recording.to_str().unwrap()]);
    let library = library(&python);
    let words = ["lsl", "--library", library.to_str().unwrap()];
    let configured = [("LSLAPICFG", configuration.to_str().unwrap())];
    let mut bridge = Bridge::start_with(&rig, &words, &configured);
    let all = received(&rig, &python, &configuration);
    kill(bridge.pid(), Signal::TERM);
    assert_eq!(bridge.exit_code(), Some(0));
    let line = bridge.line("sample: ", " samples sent, ");
    rig.ok(["rec", "stop"]);
    rig.down();

    let stream = &all["sample"];
    assert_eq!((stream["type"].as_str(), number(&stream["rate_hz"])), (Some("Sample"), 2000.0));
    let source = stream["source_id"].as_str().unwrap();
    assert!(source.ends_with(&format!("/{}/sample", rig.name())), "{source}");
    let channels = stream["channels"].as_array().unwrap();
    assert_eq!(stream["count"].as_u64().unwrap(), channels.len() as u64);
    let labels: Vec<&str> = channels.iter().map(|channel| channel[0].as_str().unwrap()).collect();
    let of = |label: &str| labels.iter().position(|known| *known == label).unwrap();
    assert_eq!(channels[of("handle_master")][1], "rad");
    assert_eq!(all["markers"]["type"], "Markers");
    // Both are on this computer: there is nothing to correct beyond what a round trip hides.
    assert!(number(&stream["correction_s"]).abs() < 0.1, "{stream}");

    let recording = Recording::open(&recording).unwrap();
    let offset_s = text_number(&stream["clock_offset_s"]);
    assert!(text_number(&stream["clock_uncertainty_s"]) < 1e-3, "{stream}");
    samples_are_the_recorded_ones(&recording, &all["samples"], offset_s, &of);
    markers_are_the_recorded_ones(&recording, &all["marks"], offset_s);
    let sent: usize = line.split(' ').nth(1).unwrap().parse().unwrap();
    assert!(sent >= SAMPLES, "{line}");
}

fn samples_are_the_recorded_ones(
    recording: &Recording,
    samples: &Value,
    offset_s: f64,
    of: &dyn Fn(&str) -> usize,
) {
    let recorded: BTreeMap<u64, Sample> = recording
        .messages::<Sample>("sample")
        .unwrap()
        .map(|sample| sample.unwrap().message)
        .map(|sample| (sample.tick, sample))
        .collect();
    let (tick_at, master_at, motor_at) = (of("tick"), of("handle_master"), of("handle_motor"));
    let (mut before, mut compared) = (0, 0);
    let samples = samples.as_array().unwrap();
    for sample in samples {
        let (at_s, values) = (number(&sample[0]), &sample[1]);
        let tick = number(&values[tick_at]) as u64;
        assert!(tick > before, "{tick} after {before}");
        before = tick;
        // The recording may lack what this host lost on the way to the disk.
        let Some(expected) = recorded.get(&tick) else { continue };
        compared += 1;
        assert_eq!(number(&values[master_at]), expected.master_position[0]);
        let motor_v = number(&values[motor_at]);
        assert!(expected.motor_present == 0 || motor_v == expected.motor_v[0]);
        let expected_s = expected.scan_time_ns as f64 / 1e9 + offset_s;
        assert!((at_s - expected_s).abs() < ROUNDED_S, "{at_s} s, and the scan at {expected_s} s");
    }
    assert!(compared * 2 > samples.len(), "{compared} of {} were recorded", samples.len());
}

fn markers_are_the_recorded_ones(recording: &Recording, marks: &Value, offset_s: f64) {
    let mut recorded: Vec<(f64, String)> = Vec::new();
    for topic in ipc_types::TOPICS.iter().filter(|topic| topic.ros_name.ends_with("/Event")) {
        for event in recording.messages::<Event>(topic.name).unwrap() {
            let event = event.unwrap().message;
            recorded.push((event.time_ns as f64 / 1e9 + offset_s, event.text().to_owned()));
        }
    }
    let marks = marks.as_array().unwrap();
    assert!(!marks.is_empty());
    for mark in marks {
        let (at_s, text) = (number(&mark[0]), mark[1].as_str().unwrap());
        let same = |(time_s, told): &&(f64, String)| {
            (time_s - at_s).abs() < ROUNDED_S && text.ends_with(told.as_str())
        };
        let lost = text.starts_with("bridge: ") && text.ends_with(" lost");
        assert!(lost || recorded.iter().find(same).is_some(), "{text} at {at_s} s: {recorded:?}");
    }
}

#[test]
fn without_the_library_it_says_what_to_install() {
    let rig = TestRig::patient("bridge-no-lsl");
    let missing = rig.path("liblsl.so");
    let words = ["bridge", "lsl", "--library", missing.to_str().unwrap()];
    let output = rig.farreach(words).output().unwrap();
    common::assert_refused(&rig, &output, 1, &["liblsl.so", "expected liblsl"]);
    let words = ["bridge", "lsl", "--topic", "sampel"];
    common::assert_refused(&rig, &rig.run(words), 1, &["sampel"]);
}
