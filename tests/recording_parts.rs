//! On a running rig: a recording in parts, and a ring of which what led to a trip is kept, also
//! where the logger is killed meanwhile.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::Duration;

use common::{Signal, TestRig, kill, told, wait_for};
use ipc_types::{EnableToken, SAMPLE, Sample, TOKEN, WatchdogState};
use recording::mcap_edit::EDIT_RECORD;
use recording::mcap_read::Recording;
use recording::part_path;
use serde_json::Value;

const LIMIT: Duration = Duration::from_secs(60);
const SECOND_NS: u64 = 1_000_000_000;
/// Long enough for a logger to die and come back within it on a busy host.
const RING_S: u64 = 10;
/// Exit code: done, but messages are missing.
const DATA_LOST: Option<i32> = Some(3);

fn text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

fn json(rig: &TestRig, arguments: &[&str]) -> Value {
    serde_json::from_str(&rig.ok(arguments)).unwrap()
}

/// Sequence number and time of every sample.
fn samples(path: &Path) -> Vec<(u64, u64)> {
    let recording = Recording::open(path).unwrap();
    let samples = recording.messages::<Sample>(SAMPLE.topic.name).unwrap();
    samples
        .map(|sample| sample.unwrap().message)
        .map(|sample| (sample.sequence, sample.time_ns))
        .collect()
}

fn assert_without_gap(path: &Path) {
    let samples = samples(path);
    for pair in samples.windows(2) {
        assert_eq!(pair[1].0, pair[0].0 + 1, "{}", path.display());
    }
}

/// Kills the logger; its successor has answered when this returns.
fn kill_logger(rig: &TestRig) {
    let logger = |rig: &TestRig| {
        let status = rig.launcher_status();
        let unit = status.unit("logger").unwrap();
        unit.process.map(|process| process.pid)
    };
    let before = logger(rig).unwrap();
    kill(before, Signal::KILL);
    let back = wait_for(LIMIT, || {
        logger(rig).is_some_and(|pid| pid != before)
            && rig.run(["rec", "tag", "back"]).status.success()
    });
    assert!(back, "{}", rig.why("logger"));
}

/// Parts that are there, from the first.
fn parts(first: &Path) -> Vec<PathBuf> {
    (1..).map(|number| part_path(first, number)).take_while(|part| part.exists()).collect()
}

/// The number of the newest part, where the first ones may be gone.
fn newest(first: &Path) -> u32 {
    (1..1_000).rev().find(|number| part_path(first, *number).exists()).unwrap()
}

#[test]
fn parts_of_a_running_rig_lose_nothing_at_their_seams_and_go_on_after_a_kill() {
    let rig = TestRig::patient("parts");
    rig.up_simulated();
    let first = rig.path("run.mcap");
    rig.ok(["rec", "start", &text(&first), "--split", "1s", "--metadata", "subject=S07"]);
    assert!(wait_for(LIMIT, || parts(&first).len() >= 4), "{:?}", parts(&first));
    let before_kill = parts(&first).len() - 1;
    kill_logger(&rig);
    let at_kill = parts(&first).len();
    assert!(wait_for(LIMIT, || parts(&first).len() >= at_kill + 2), "{:?}", parts(&first));
    rig.ok(["rec", "tag", "the end is near", "--author", "anna"]);
    let stopped = rig.run(["rec", "stop"]);
    assert_eq!(stopped.status.code(), DATA_LOST, "{}", told(&stopped));
    rig.down();

    // What the dead logger was just creating may be an empty file.
    let mut parts = parts(&first);
    parts.retain(|part| Recording::open(part).is_ok());
    for part in &parts {
        assert_without_gap(part);
        assert_eq!(Recording::open(part).unwrap().metadata("subject"), Some("S07"));
    }
    let ends: Vec<_> = parts.iter().map(|part| samples(part)).collect();
    // One that was just begun at the kill, or at the end, may have none.
    let empty = ends.iter().filter(|samples| samples.is_empty()).count();
    assert!(empty <= 2 && ends.len() >= 6, "{empty} of {} parts without samples", ends.len());
    for seam in ends[..before_kill].windows(2) {
        assert_eq!(seam[1][0].0, seam[0].last().unwrap().0 + 1, "a seam before the kill");
    }
    let whole = rig.path("whole.mcap");
    let mut merge = vec!["rec".to_owned(), "merge".to_owned()];
    merge.extend(parts.iter().map(|part| text(part)));
    merge.extend(["-o".to_owned(), text(&whole)]);
    let merging = rig.run(&merge);
    assert_eq!(merging.status.code(), DATA_LOST, "{}", told(&merging));
    let merged = samples(&whole);
    assert_eq!(merged.len(), ends.iter().map(Vec::len).sum::<usize>());
    assert!(merged.windows(2).all(|pair| pair[1].0 > pair[0].0));
    // What the dead logger did not write is missing, is counted, and is told.
    let missing = merged.last().unwrap().0 - merged[0].0 + 1 - merged.len() as u64;
    let verified = rig.run(["rec", "verify", &text(&whole), "--json"]);
    let found: Value = serde_json::from_slice(&verified.stdout).unwrap();
    let topics = found["topics"].as_array().unwrap();
    let sample = topics.iter().find(|topic| topic["topic"] == SAMPLE.topic.name).unwrap();
    assert_eq!(sample["gaps"], missing, "{sample:#}");
    assert_eq!(verified.status.code(), DATA_LOST, "{found:#}");
    let info = json(&rig, &["rec", "info", &text(&whole), "--json"]);
    let notes: Vec<_> =
        info["notes"].as_array().unwrap().iter().map(|note| &note["text"]).collect();
    assert_eq!(notes.last().unwrap().as_str(), Some("anna: the end is near"), "{info:#}");
}

/// Waits for the next trip; the rig is tripped until it has seen one.
fn snapshot_of_a_trip(rig: &TestRig, file: &Path) -> Value {
    let waiting = ["rec", "snapshot", "--on", "trip", "--before", "2s", "--after", "1s", "--json"];
    let mut command = rig.farreach(waiting);
    command.arg(file).stdout(std::process::Stdio::piped());
    let mut child: Child = command.spawn().unwrap();
    let done = wait_for(LIMIT, || {
        rig.power_up();
        rig.ok(["estop"]);
        // A second after the trip that it saw, it is done.
        wait_for(Duration::from_secs(5), || child.try_wait().unwrap().is_some())
    });
    if !done {
        let _killed = child.kill();
    }
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", told(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn assert_snapshot_of_a_trip(rig: &TestRig, file: &Path, answer: &Value) {
    let at_ns = answer["trigger_ns"].as_u64().unwrap();
    assert_eq!(answer["data_lost"], false);
    let recording = Recording::open(file).unwrap();
    let edit = recording.metadata_records.iter().find(|(name, _)| name == EDIT_RECORD).unwrap();
    assert_eq!(edit.1["trigger"], "trip");
    assert_eq!(edit.1["trigger_ns"], at_ns.to_string());
    let tokens: Vec<EnableToken> = recording
        .messages::<EnableToken>(TOKEN.topic.name)
        .unwrap()
        .map(|token| token.unwrap().message)
        .collect();
    let tripped = |token: &&EnableToken| token.state == WatchdogState::Tripped.code();
    let at = tokens.iter().position(|token| token.time_ns == at_ns).unwrap();
    assert!(tripped(&&tokens[at]), "{:?}", tokens[at]);
    assert_eq!(tokens[at - 1].enabled, 1, "power, until the trip");
    assert_without_gap(file);
    let samples = samples(file);
    let (begin, end) = (samples[0].1, samples.last().unwrap().1);
    assert!((at_ns - 2 * SECOND_NS..=at_ns - SECOND_NS).contains(&begin), "{begin}, trip {at_ns}");
    assert!((at_ns..=at_ns + SECOND_NS).contains(&end), "{end}, trip {at_ns}");
    rig.ok(["rec", "verify", &text(file)]);
}

#[test]
fn a_ring_keeps_what_led_to_a_trip_and_outlives_its_logger() {
    let rig = TestRig::patient("ring");
    rig.up_simulated();
    let none = rig.run(["rec", "snapshot", &text(&rig.path("none.mcap"))]);
    assert!(!none.status.success());
    assert!(told(&none).contains("rec start --ring"), "{}", told(&none));
    let ring = rig.path("ring.mcap");
    rig.ok(["rec", "start", &text(&ring), "--ring", &format!("{RING_S}s")]);
    // The oldest go.
    assert!(wait_for(LIMIT, || !ring.exists()), "the first part is there still");
    let trip = rig.path("trip.mcap");
    let answer = snapshot_of_a_trip(&rig, &trip);
    assert_snapshot_of_a_trip(&rig, &trip, &answer);
    // Nobody's file is overwritten.
    let again = rig.run(["rec", "snapshot", &text(&trip)]);
    assert!(!again.status.success() && told(&again).contains("never overwritten"));

    // Far from a seam, and once the note is flushed: it is in the part that is cut off.
    let present = newest(&ring);
    assert!(wait_for(LIMIT, || newest(&ring) > present), "no part after the {present}th");
    rig.ok(["rec", "tag", "before"]);
    std::thread::sleep(Duration::from_secs(1));
    kill_logger(&rig);
    let status = json(&rig, &["status", "--json"]);
    assert_eq!(status["recording"]["ring"]["keep_ns"], RING_S * SECOND_NS, "{status:#}");
    let now = rig.path("now.mcap");
    let snapshot = rig.run(["rec", "snapshot", &text(&now), "--json"]);
    assert_eq!(snapshot.status.code(), DATA_LOST, "{}", told(&snapshot));
    let answer: Value = serde_json::from_slice(&snapshot.stdout).unwrap();
    assert_eq!(answer["trigger"], "command");
    assert_eq!(answer["data_lost"], true);
    let verified = rig.run(["rec", "verify", &text(&now)]);
    assert_eq!(verified.status.code(), DATA_LOST, "{}", told(&verified));
    let info = json(&rig, &["rec", "info", &text(&now), "--json"]);
    let notes: Vec<_> =
        info["notes"].as_array().unwrap().iter().map(|note| &note["text"]).collect();
    for end in [": before", ": back"] {
        let found = notes.iter().any(|note| note.as_str().unwrap().ends_with(end));
        assert!(found, "{end} in {info:#}");
    }
    let stopped = rig.run(["rec", "stop"]);
    assert_eq!(stopped.status.code(), DATA_LOST, "{}", told(&stopped));
    rig.down();
}
