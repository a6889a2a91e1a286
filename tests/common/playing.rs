//! Protocols that are played by a rig of real processes, through kills of the process that plays
//! them, and what its recording shows.

use std::process::{Child, Output, Stdio};
use std::time::Duration;

use experiment::state::PlayerState;
use recording::mcap_read::Recording;
use serde_json::Value;

use super::{Signal, TestRig, kill, told, wait_for};

/// How often a protocol is begun again: on a loaded host the rig may trip, rightly.
const ATTEMPTS: usize = 20;

/// Starts `farreach run` in the background.
fn start(rig: &TestRig, arguments: &[&str]) -> Child {
    rig.power_up();
    let mut run = rig.farreach([&["run", "--json"], arguments].concat());
    run.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Whether a segment is played, or the protocol has ended, rightly or not.
fn is_in(child: &mut Child, rig: &TestRig, segment: u32) -> bool {
    child.try_wait().unwrap().is_some() || {
        let file = rig.run_directory().join("experiment.state");
        std::fs::read(file).is_ok_and(|bytes| {
            PlayerState::decode(&bytes).is_ok_and(|state| state.running && state.segment == segment)
        })
    }
}

/// Plays to the end, as `farreach run` with these arguments does, and kills the experiment process
/// once in each of the segments; returns the outcome.
pub fn play_with_kills(rig: &TestRig, arguments: &[&str], segments: &[u32]) -> Value {
    let mut last = String::new();
    for attempt in 1..=ATTEMPTS {
        let _disarmed = rig.run(["disarm"]);
        remove_session_files(rig);
        let mut run = start(rig, arguments);
        for segment in segments {
            let reached = || is_in(&mut run, rig, *segment);
            assert!(wait_for(Duration::from_secs(90), reached), "never in segment {segment}");
            kill_experiment(rig);
        }
        let output: Output = run.wait_with_output().unwrap();
        last = told(&output);
        if output.status.success() {
            return serde_json::from_slice(&output.stdout).unwrap();
        }
        println!("attempt {attempt}: {last}");
        assert!(last.contains("tripped"), "{last}");
    }
    panic!("never played to its end: {last}");
}

/// Kills the experiment process, where it runs.
pub fn kill_experiment(rig: &TestRig) {
    if let Some(process) = rig.launcher_status().unit("experiment").and_then(|unit| unit.process) {
        kill(process.pid, Signal::KILL);
    }
}

/// Removes what an attempt that tripped has written: a file that is there is never overwritten.
fn remove_session_files(rig: &TestRig) {
    for entry in std::fs::read_dir(rig.path("")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "mat") {
            std::fs::remove_file(path).unwrap();
        }
    }
}

/// Runs until the output has a text; again after a trip of the rig.
pub fn play_until(rig: &TestRig, arguments: &[&str], expected: &str) -> Output {
    let mut last = String::new();
    for _ in 0..ATTEMPTS {
        let _disarmed = rig.run(["disarm"]);
        rig.power_up();
        let output = rig.run(arguments);
        last = told(&output);
        if last.contains(expected) {
            return output;
        }
        assert!(last.contains("tripped"), "{last}");
    }
    panic!("`{expected}` never came: {last}");
}

/// The messages of a topic.
pub fn messages<T: ipc_types::Message>(recording: &Recording, topic: &str) -> Vec<T> {
    recording.messages::<T>(topic).unwrap().map(|message| message.unwrap().message).collect()
}
