//! `farreach doctor` without a rig and on a running one: its report, where it goes, and what it
//! leaves alone.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::time::Duration;

use serde_json::Value;

use common::{TestRig, assert_told, told, wait_for};

const KEYS: [&str; 10] = [
    "layout",
    "taken_unix_ms",
    "host",
    "boot_id",
    "user",
    "version",
    "revision",
    "rig_name",
    "rig",
    "checks",
];

/// The report of a `doctor --json`, whose exit code must say whether something failed.
fn report(rig: &TestRig, arguments: &[&str]) -> Value {
    let folder = rig.path("");
    let mut all = vec!["doctor", "--json", "--folder", folder.to_str().unwrap()];
    all.extend(arguments);
    let output = rig.run(&all);
    let report: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", told(&output)));
    let failed = checks(&report).iter().any(|check| check["verdict"] == "fail");
    assert_eq!(output.status.code(), Some(i32::from(failed)), "{}", told(&output));
    report
}

fn checks(report: &Value) -> &Vec<Value> {
    report["checks"].as_array().unwrap()
}

fn check<'r>(report: &'r Value, id: &str) -> &'r Value {
    checks(report).iter().find(|check| check["id"] == id).unwrap_or_else(|| panic!("no {id}"))
}

/// Every key of the report is there, has its type, and stands in docs/doctor.md.
fn walk(report: &Value) {
    let page = include_str!("../docs/doctor.md");
    let found: Vec<&String> = report.as_object().unwrap().keys().collect();
    assert_eq!(found.len(), KEYS.len(), "{found:?}");
    for key in KEYS {
        assert!(report.get(key).is_some() && page.contains(&format!("`{key}`")), "{key}");
    }
    assert_eq!(report["layout"], 1);
    assert!(report["taken_unix_ms"].as_u64().unwrap() > 1_700_000_000_000);
    assert!(!checks(report).is_empty());
    for check in checks(report) {
        let keys: Vec<&String> = check.as_object().unwrap().keys().collect();
        assert_eq!(keys.len(), 6, "{keys:?}");
        let text = |key: &str| check[key].as_str().unwrap_or_else(|| panic!("{key}: {check}"));
        assert!(page.contains(&format!("\n### {}\n", text("id"))), "{check}");
        assert!(!text("title").is_empty() && !text("value").is_empty(), "{check}");
        let passed = match text("verdict") {
            "pass" => true,
            "warn" | "fail" | "skipped" => false,
            other => panic!("verdict {other}"),
        };
        assert_eq!(text("remedy").is_empty(), passed, "{check}");
    }
}

#[test]
fn without_a_rig_the_computer_is_examined_and_the_report_kept() {
    let rig = TestRig::patient("doctor");
    let found = report(&rig, &[]);
    walk(&found);
    assert!(found["rig"].is_null());
    for id in ["card", "torque-noise", "trigger", "enable-line", "encoder-directions"] {
        assert_eq!(check(&found, id)["verdict"], "skipped", "{found}");
        assert!(check(&found, id)["value"].as_str().unwrap().contains("is not up"));
    }
    // By doing: each of these measured something.
    assert!(check(&found, "wake-load")["measured"]["wakes"].as_u64().unwrap() > 0);
    assert!(check(&found, "disk-sync")["measured"]["count"].as_u64().unwrap() > 0);
    assert!(check(&found, "disk-write")["measured"]["bytes_per_s"].as_f64().unwrap() > 0.0);
    assert!(check(&found, "clock")["measured"]["cost_ns"].as_f64().unwrap() > 0.0);
    let kept = rig.path("doctor").join(format!("{}.json", rig.name()));
    let kept: Value = serde_json::from_slice(&std::fs::read(kept).unwrap()).unwrap();
    assert_eq!(kept, found);
    let left = std::fs::read_dir(rig.path("")).unwrap().count();
    assert_eq!(left, 1, "the doctor leaves its report only");
}

#[test]
fn a_rig_is_examined_at_rest_and_by_consent_under_power() {
    let rig = TestRig::patient("doctored");
    rig.up_homed();
    // Nobody agreed, and nothing moves.
    let output = rig.run(["doctor", "--move"]);
    assert_eq!(output.status.code(), Some(1), "{}", told(&output));
    assert_told(&output, &["--move: expected a terminal", "--yes"]);
    let still = report(&rig, &["--trigger", "0.1"]);
    walk(&still);
    assert_eq!(still["rig"]["card"], "simulated");
    assert_eq!(check(&still, "card")["measured"]["card"], "simulated");
    assert_eq!(check(&still, "torque-noise")["verdict"], "pass", "{still}");
    // No scanner runs.
    assert_eq!(check(&still, "trigger")["verdict"], "fail", "{still}");
    assert_eq!(check(&still, "enable-line")["verdict"], "skipped", "{still}");
    // Consent to a movement is none to take an emergency stop away.
    rig.ok(["estop"]);
    let stopped = report(&rig, &["--move", "--yes"]);
    for id in ["enable-line", "encoder-directions"] {
        assert_eq!(check(&stopped, id)["verdict"], "fail", "{stopped}");
        assert!(check(&stopped, id)["value"].as_str().unwrap().contains("`estop`"), "{stopped}");
    }
    assert!(rig.ok(["status"]).contains("emergency stop"), "{}", rig.ok(["status"]));
    rig.ok(["reset"]);
    // On a loaded host a best-effort rig may trip, rightly; then it is looked at again.
    let mut moved = Value::Null;
    let done = wait_for(Duration::from_secs(120), || {
        moved = report(&rig, &["--move", "--yes"]);
        check(&moved, "encoder-directions")["verdict"] == "pass"
            && check(&moved, "enable-line")["measured"]["dropped_ns"].is_u64()
    });
    assert!(done, "{moved:#}");
    let line = &check(&moved, "enable-line")["measured"];
    assert_eq!(line["powered"], true, "{line}");
    let axis = &check(&moved, "encoder-directions")["measured"][0];
    assert!(axis["master"].as_f64().unwrap() > 0.3, "{axis}");
    assert!(axis["drive"].as_f64().unwrap() > 0.0, "{axis}");
    // The simulated hand is relaxed: 0.3 N·m/rad.
    assert_eq!(check(&moved, "torque-sign")["verdict"], "pass", "{moved}");
    let status: Value = serde_json::from_str(&rig.ok(["status", "--json"])).unwrap();
    assert_eq!(status["gate"]["motor_power"], false, "{status}");
    rig.down();
}

#[test]
fn a_rig_in_use_is_left_alone_and_recordings_have_the_report() {
    let rig = TestRig::patient("doctor-used");
    rig.up_homed();
    let first = rig.path("first.mcap");
    rig.ok(["rec", "start", first.to_str().unwrap()]);
    let armed = wait_for(Duration::from_secs(60), || {
        rig.run(["reset"]);
        rig.run(["arm", "--unchecked"]).status.success()
    });
    assert!(armed);
    let found = report(&rig, &["--move", "--yes"]);
    let state = check(&found, "enable-line")["value"].as_str().unwrap().to_owned();
    // A best-effort rig may have tripped meanwhile; then it was not armed and was looked at.
    if state.contains("armed") {
        for id in ["scheduling", "wake-load", "disk-write", "encoder-directions"] {
            assert_eq!(check(&found, id)["verdict"], "skipped", "{found}");
        }
    }
    rig.ok(["rec", "stop"]);
    let second = rig.path("second.mcap");
    rig.ok(["rec", "start", second.to_str().unwrap()]);
    rig.ok(["rec", "stop"]);
    let info = |file: &std::path::Path| rig.ok(["rec", "info", file.to_str().unwrap()]);
    assert!(info(&first).contains("\n  doctor no report\n"), "{}", info(&first));
    let told = info(&second);
    assert!(told.contains("\n  doctor 0 min old, "), "{told}");
    let whole = rig.ok(["rec", "info", second.to_str().unwrap(), "--text", "doctor_report"]);
    let whole: Value = serde_json::from_str(&whole).unwrap();
    assert_eq!(whole["taken_unix_ms"], found["taken_unix_ms"]);
    assert_eq!(checks(&whole).len(), checks(&found).len());
    let events = rig.ok(["rec", "cat", first.to_str().unwrap(), "--topic", "event/watchdog"]);
    assert!(events.contains("nothing spoke against it"), "{events}");
    rig.down();
}
