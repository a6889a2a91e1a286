//! An experiment that is continued after the whole computer has died: every process is killed at
//! once and the shared memory is gone, as after a power cut.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::{Path, PathBuf};
use std::time::Duration;

use experiment::interrupted::InterruptedFile;
use ipc_types::{
    Event, EventKind, Process, SESSION, SessionOutcome, SessionResult, VOLUME, Volume, event_topic,
};
use recording::mcap_read::Recording;
use serde_json::Value;

use common::playing::messages;
use common::{Signal, TestRig, assert_told, kill, shared_memory_of, told, wait_for};

const REPETITION_S: f64 = 0.5;
const SECOND_SESSION: u32 = 2;

const PROTOCOL: &str = r#"[protocol]
name = "three sessions"

[scanner]
repetition_s = 0.5

[[segments]]
kind = "wait_for_scanner"
timeout_s = 5.0
start_up_s = 0.5

[[segments]]
kind = "rhythm"
label = "session"
frequency_hz = 1.0
amplitude_deg = 20.0
duration_s = 4.0
spring = 0.5
session = true
repeat = 3
"#;

/// Kills all of the rig's processes at once, and removes what a start of the computer removes.
fn cut_power(rig: &TestRig) {
    for pid in rig.processes() {
        kill(pid, Signal::KILL);
    }
    assert!(wait_for(Duration::from_secs(20), || rig.processes().is_empty()));
    for path in shared_memory_of(rig.name()) {
        let removed = match path.is_dir() {
            true => std::fs::remove_dir_all(&path),
            false => std::fs::remove_file(&path),
        };
        removed.unwrap();
    }
}

fn up(rig: &TestRig, rig_file: &str, recording: &Path) {
    rig.ok(["up", "--simulate", "--rig", rig_file, "--record", recording.to_str().unwrap()]);
}

/// Runs the protocol until its second session, and cuts the power there.
fn interrupt(rig: &TestRig, rig_file: &str, protocol: &Path) -> PathBuf {
    let file = InterruptedFile::new(&rig.learnt(), rig.name().as_str());
    for attempt in 0..20 {
        let recording = rig.path(&format!("before{attempt}.mcap"));
        up(rig, rig_file, &recording);
        rig.power_up();
        let arguments = ["run", protocol.to_str().unwrap(), "--emulate-scanner", "0.5"];
        let mut run = rig.farreach([&arguments[..], &["--subject", "S07"]].concat());
        let mut run = run.spawn().unwrap();
        let in_second = || {
            let kept = file.read().unwrap();
            kept.is_some_and(|kept| kept.state.running && kept.state.segment == SECOND_SESSION)
        };
        wait_for(Duration::from_secs(60), || run.try_wait().unwrap().is_some() || in_second());
        let reached = run.try_wait().unwrap().is_none();
        if reached {
            // In the middle of it, and some volumes later.
            std::thread::sleep(Duration::from_secs(2));
        }
        cut_power(rig);
        let _ended = run.wait().unwrap();
        if reached && in_second() {
            return recording;
        }
    }
    panic!("never in the second session");
}

/// Continues, again after a trip; the outcome, and the name of the last run's session files.
fn continue_to_the_end(rig: &TestRig) -> (Value, String) {
    let mut last = String::new();
    for _attempt in 0..20 {
        let _disarmed = rig.run(["disarm"]);
        rig.power_up();
        // The file of a session that a trip ended has a name of its own.
        let name = "C_".to_owned();
        let files = format!("--mat={}", rig.path(&name).display());
        let ended = rig.run(["run", "--continue", "--json", &files]);
        if ended.status.success() {
            return (serde_json::from_slice(&ended.stdout).unwrap(), name);
        }
        last = told(&ended);
        assert!(last.contains("tripped"), "{last}");
    }
    panic!("never continued to its end: {last}");
}

#[test]
fn an_experiment_is_continued_after_a_power_cut() {
    let rig = TestRig::patient("interrupted");
    let rig_file = rig.absolute_rig("hydrostatic");
    let protocol = rig.path("three.toml");
    std::fs::write(&protocol, PROTOCOL).unwrap();
    let before = interrupt(&rig, &rig_file, &protocol);
    std::fs::remove_file(&protocol).unwrap();

    let after = rig.path("after.mcap");
    up(&rig, &rig_file, &after);
    let (outcome, files) = continue_to_the_end(&rig);
    assert_eq!(outcome["sessions"]["over"], 3, "{outcome}");
    let there = [1, 2, 3].map(|number| rig.path(&format!("{files}{number}.mat")).exists());
    assert_eq!(there, [false, true, true], "{outcome}");
    let nothing = rig.run(["run", "--continue"]);
    assert_told(&nothing, &["no protocol with sessions was interrupted"]);
    rig.ok(["rec", "stop"]);
    rig.down();

    // What was recorded before the cut can be read as far as it goes.
    let recovered = rig.path("recovered.mcap");
    let (before, recovered) = (before.to_str().unwrap(), recovered.to_str().unwrap());
    rig.run(["rec", "recover", before, "-o", recovered]);
    let first = Recording::open(Path::new(recovered)).unwrap();
    let second = Recording::open(&after).unwrap();
    let results: Vec<SessionResult> = messages(&second, SESSION.topic.name);
    let whole: Vec<u32> = results
        .iter()
        .filter(|result| result.outcome == SessionOutcome::Whole.code())
        .map(|result| result.number)
        .collect();
    assert!(whole.ends_with(&[2, 3]), "{whole:?}");
    let run = second.runs().find(|run| run.contains_key("continued_after_session")).unwrap();
    assert_eq!(run.get("subject").map(String::as_str), Some("S07"), "{run:?}");
    assert_eq!(run.get("continued_after_session").map(String::as_str), Some("1"));
    let topic = event_topic(Process::Experiment).unwrap().topic.name;
    let events: Vec<Event> = messages(&second, topic);
    let resumed = EventKind::ProtocolResumed.code();
    assert!(events.iter().any(|event| event.kind == resumed && event.segment == SECOND_SESSION));
    // The scanner's volumes are counted on.
    let [earlier, later]: [Vec<Volume>; 2] =
        [&first, &second].map(|recording| messages(recording, VOLUME.topic.name));
    let (first, last) = (earlier.first().unwrap(), later.last().unwrap());
    // Two sessions have 16, of which one may lie on the edge; the cut has some more.
    assert!(last.index >= earlier.last().unwrap().index + 15);
    let passed_s = last.at_ns.saturating_sub(first.at_ns) as f64 * 1e-9;
    let expected_s = (last.index - first.index) as f64 * REPETITION_S;
    assert!((passed_s - expected_s).abs() < 1e-3, "{passed_s} s, expected {expected_s} s");
}
