//! The monitor of a whole rig: an effect put into the simulated machine while it moves is noticed
//! and placed, the recording gives the same once more, and nobody else notices when it dies.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use ipc_types::{Event, EventKind, MODEL_STATE, ModelState, Process, event_topic};
use recording::mcap_read::Recording;
use serde_json::Value;

use common::playing::messages;
use common::{Signal, TestRig, assert_told, kill, told, wait_for};

fn status(rig: &TestRig) -> Value {
    serde_json::from_str(&rig.ok(["status", "--json"])).unwrap()
}

fn state(rig: &TestRig) -> String {
    status(rig)["model"][0]["state"].as_str().unwrap_or_default().to_owned()
}

fn pid(rig: &TestRig) -> i32 {
    let launched = rig.launcher_status();
    launched.unit("monitor").and_then(|unit| unit.process).expect("the monitor runs").pid
}

/// Plays the guided movement, and meanwhile does something; tells whether it ran to its end, which
/// a trip of the best-effort rig may prevent.
fn play(rig: &TestRig, meanwhile: impl FnOnce(&TestRig)) -> bool {
    let _disarmed = rig.run(["disarm"]);
    rig.power_up();
    let arguments = ["run", "guided-1hz", "--set", "segments.0.duration_s=45"];
    let mut run = rig.farreach(arguments);
    // A trip is told on stderr.
    let run = run.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    meanwhile(rig);
    let output = run.wait_with_output().unwrap();
    let text = told(&output);
    assert!(text.contains("completed") || text.contains("tripped"), "{text}");
    text.contains("completed")
}

#[test]
fn an_effect_in_mid_movement_is_noticed_and_the_recording_gives_the_same() {
    let rig = TestRig::patient("monitor");
    let rig_file = rig.absolute_rig("hydrostatic");
    let file = rig.path("run.mcap").to_str().unwrap().to_owned();
    rig.ok(["up", "--simulate", "--rig", &rig_file, "--monitor", "--record", &file]);
    let refused = rig.run(["fault", "effect", "rust@slave"]);
    assert_told(&refused, &["rust"]);
    let steady = |rig: &TestRig| wait_for(Duration::from_secs(60), || state(rig) == "steady");
    let departed = |rig: &TestRig| wait_for(Duration::from_secs(20), || state(rig) == "departed");
    let noticed = (0..10).any(|_| {
        rig.ok(["fault", "effect", "none"]);
        let mut noticed = false;
        let whole = play(&rig, |rig| {
            if steady(rig) {
                rig.ok(["fault", "effect", "backlash@slave=0.03"]);
                noticed = departed(rig);
            }
        });
        noticed && whole
    });
    assert!(noticed, "{}", rig.ok(["status"]));
    assert_eq!(status(&rig)["model"][0]["site"], "slave");
    assert!(rig.ok(["status"]).contains("DEPARTED"), "{}", rig.ok(["status"]));

    // Stopped, then killed: the others go on, and the launcher starts it again.
    let before = pid(&rig);
    kill(before, Signal::STOP);
    std::thread::sleep(Duration::from_secs(1));
    kill(before, Signal::CONT);
    kill(before, Signal::KILL);
    let restarted = wait_for(Duration::from_secs(30), || {
        let unit = rig.launcher_status();
        unit.unit("monitor").and_then(|unit| unit.process).is_some_and(|own| own.pid != before)
    });
    assert!(restarted && wait_for(Duration::from_secs(30), || state(&rig) == "learning"));
    for process in ["acquisition", "control", "watchdog", "simulator", "experiment"] {
        let restarts = rig.launcher_status().unit(process).unwrap().restarts;
        assert_eq!(restarts, 0, "{process}");
    }
    rig.run(["rec", "stop"]);
    rig.down();
    check_recording(&rig, &file);
}

fn check_recording(rig: &TestRig, file: &str) {
    let recording = Recording::open(Path::new(file)).unwrap();
    let topic = event_topic(Process::Monitor).unwrap().topic.name;
    let events: Vec<Event> = messages(&recording, topic);
    let departed: Vec<&Event> =
        events.iter().filter(|event| event.kind == EventKind::ModelDeparted.code()).collect();
    assert!(departed.last().unwrap().text().contains("backlash"), "{departed:?}");
    let changes: Vec<Event> =
        messages(&recording, event_topic(Process::Simulator).unwrap().topic.name);
    let put = |event: &&Event| {
        event.kind == EventKind::EffectsChanged.code() && event.text() == "backlash@slave=0.03"
    };
    let (put_ns, told_ns) =
        (changes.iter().rfind(put).unwrap().time_ns, departed.last().unwrap().time_ns);
    let states: Vec<ModelState> = messages(&recording, MODEL_STATE.topic.name);
    let blocks = |at_ns: u64| states.iter().rfind(|state| state.time_ns <= at_ns).unwrap().blocks;
    // Half seconds of movement: by the samples, not by the clock of a host that stalls.
    assert!(blocks(told_ns) - blocks(put_ns) <= 10, "{put_ns} to {told_ns}");

    let info = rig.ok(["rec", "info", file]);
    for told in ["axis 0: baseline learnt", "axis 0: model departed at the "] {
        assert!(info.contains(told), "{told}: {info}");
    }
    assert!(info.contains("at the end: axis 0: learning"), "the monitor was killed: {info}");
    let again = rig.run(["rec", "innovations", file, "--json"]);
    let again: Value = serde_json::from_slice(&again.stdout).unwrap();
    let live = again["live"].as_u64().unwrap();
    assert!(live > 5000 && again["same"] == live, "{} of {live}", again["same"]);
    let found = again["events"].as_array().unwrap().iter().filter(|event| {
        event["event"] == "model departed" && event["text"].as_str().unwrap().contains("backlash")
    });
    assert!(found.count() >= 1, "{again}");
}
