//! A rig brought up and down through the real command line: what is refused, and what may be
//! attached meanwhile.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Duration;

use serde_json::Value;

use common::{Signal, TestRig, assert_refused, assert_told, kill, told, wait_for};

const RIG: &str = include_str!("../launch/rigs/hydrostatic.toml");

#[test]
fn wrong_protocols_and_rigs_that_are_not_up_are_refused_without_a_rig() {
    let rig = TestRig::patient("verbs");
    let path = rig.path("p.toml");
    std::fs::write(
        &path,
        "[protocol]\nname = \"test\"\n\n[[segments]]\nkind = \"hold\"\nduration = 1.0\n",
    )
    .unwrap();
    let output = rig.farreach(["run"]).arg(&path).output().unwrap();
    assert_refused(
        &rig,
        &output,
        1,
        &["p.toml:6: segments.0.duration: ", "did you mean `duration_s`?"],
    );
    for verb in ["reset", "arm", "enable", "disarm", "estop"] {
        assert_refused(&rig, &rig.run([verb]), 1, &["is not up", "farreach up"]);
    }
    let output = rig.run(["run", "guided-1hz"]);
    assert_refused(&rig, &output, 1, &["is not up", "farreach up"]);
    let output = rig.run(["status", "--json"]);
    assert_eq!(output.status.code(), Some(1), "{}", told(&output));
    let status: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(status["up"], false);
    // Bringing down a rig that is not up is no failure.
    rig.down();
}

#[test]
fn a_service_without_a_keeper_reports_that() {
    let rig = TestRig::patient("lone");
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("launch/rigs/hydrostatic.toml");
    for service in ["simulator", "control", "watchdog", "logger", "experiment"] {
        let output = rig.farreach(["service", service, "--rig"]).arg(&file).output().unwrap();
        assert_refused(&rig, &output, 1, &["has no keeper", "farreach up"]);
    }
    let output = rig
        .farreach(["service", "acquisition", "--card", "null", "--rig"])
        .arg(&file)
        .output()
        .unwrap();
    assert_refused(&rig, &output, 1, &["has no keeper", "farreach up"]);
}

#[test]
fn a_second_launch_is_refused_and_does_not_disturb_the_first() {
    let rig = TestRig::patient("twice");
    rig.up_simulated();
    let before = rig.launcher_status();
    let changed = rig.path("changed.toml");
    std::fs::write(&changed, RIG.replace("experiment_hz = 500", "experiment_hz = 250")).unwrap();
    let settings: [&[&str]; 3] = [
        &["up", "--simulate"],
        &["up", "--simulate", "--rig", changed.to_str().unwrap()],
        &["up", "--simulate", "--foreground"],
    ];
    for arguments in settings {
        let output = rig.run(arguments);
        assert_eq!(output.status.code(), Some(1), "{}", told(&output));
        assert_told(&output, &["is already up", "launcher", "farreach down"]);
    }
    // A second keeper is refused too, and so is a further process that the launcher does not know.
    let output = rig.run(["service", "keeper"]);
    assert_eq!(output.status.code(), Some(1), "{}", told(&output));
    assert_told(&output, &["has a keeper already"]);
    let after = rig.launcher_status();
    assert_eq!(before.launcher, after.launcher);
    let identities =
        |status: &launch::Status| status.units.iter().map(|unit| unit.process).collect::<Vec<_>>();
    assert_eq!(identities(&before), identities(&after), "the first launch keeps running");
    assert!(after.units.iter().all(|unit| unit.restarts == 0), "{after:?}");
    rig.down();
}

#[test]
fn a_recording_that_cannot_begin_undoes_the_start() {
    let rig = TestRig::patient("norec");
    let kept = rig.path("kept.mcap");
    std::fs::write(&kept, "somebody's data").unwrap();
    let output = rig.farreach(["up", "--simulate", "--record"]).arg(&kept).output().unwrap();
    assert_refused(&rig, &output, 1, &["kept.mcap", "never overwritten"]);
    assert_eq!(std::fs::read_to_string(&kept).unwrap(), "somebody's data");
    let nowhere = rig.path("nowhere/run.mcap");
    let output = rig.farreach(["up", "--simulate", "--record"]).arg(&nowhere).output().unwrap();
    assert_refused(&rig, &output, 1, &["nowhere/run.mcap", "No such file"]);
    assert!(!nowhere.parent().unwrap().exists());
}

/// A probe that runs until its rig goes down; its output goes to files beside the rig's.
fn open_probe(rig: &TestRig) -> Child {
    let probe = rig
        .farreach(["probe", "echo", "sample", "--field", "tick"])
        .stdout(std::fs::File::create(rig.path("probe.out")).unwrap())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let attached = || std::fs::metadata(rig.path("probe.out")).unwrap().len() > 0;
    assert!(wait_for(Duration::from_secs(20), attached), "the probe receives nothing");
    probe
}

/// All recordings beside the rig.
fn recordings(rig: &TestRig) -> Vec<PathBuf> {
    let files = std::fs::read_dir(rig.path("")).unwrap().map(|entry| entry.unwrap().path());
    files.filter(|path| path.extension().is_some_and(|kind| kind == "mcap")).collect()
}

#[test]
fn an_open_probe_ends_with_its_rig() {
    let rig = TestRig::patient("open");
    rig.up_simulated();
    let probe = open_probe(&rig);
    rig.ok(["down"]);
    let output = probe.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", told(&output));
    assert_told(&output, &["went down"]);
    rig.down();
}

#[test]
fn a_frozen_probe_does_not_keep_the_previous_session_alive() {
    let rig = TestRig::patient("hang");
    let (first, second) = (rig.path("first.mcap"), rig.path("second.mcap"));
    rig.ok(["up", "--simulate", "--record", first.to_str().unwrap()]);
    let mut probe = open_probe(&rig);
    let pid = i32::try_from(probe.id()).unwrap();
    kill(pid, Signal::STOP);
    let down = rig.run(["down"]);
    assert!(down.status.success(), "{}", told(&down));
    assert!(!String::from_utf8_lossy(&down.stderr).contains("in use"), "{}", told(&down));
    let session = || -> Value { serde_json::from_str(&rig.ok(["status", "--json"])).unwrap() };
    rig.ok(["up", "--simulate", "--record", second.to_str().unwrap()]);
    assert_eq!(session()["recording"]["file"], second.to_str().unwrap());
    // The probe continues beside a rig of another session, and ends.
    kill(pid, Signal::CONT);
    assert!(wait_for(Duration::from_secs(20), || probe.try_wait().unwrap().is_some()));
    rig.ok(["down"]);
    let mut found = recordings(&rig);
    found.sort();
    assert_eq!(found, [first, second], "a part was begun");
    rig.down();
}
