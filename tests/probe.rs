//! Probes on a running rig, and on the recording that it leaves.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{TestRig, told};
use ipc_types::Sample;
use recording::mcap_read::Recording;
use recording::mcap_write::key;

/// Ticks from the newest sample to the one that triggers: a second.
const AHEAD: u64 = 2000;

/// The tick of the newest sample.
fn tick(rig: &TestRig) -> u64 {
    let table = rig.ok(["probe", "echo", "sample", "--once", "--format", "csv", "--field", "tick"]);
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!((lines.len(), lines[0]), (2, "received_ns,tick"), "{table}");
    lines[1].split_once(',').unwrap().1.parse().unwrap()
}

fn value(row: &[&str], column: usize) -> f64 {
    row[column].parse().unwrap()
}

#[test]
fn a_scope_captures_a_running_rig_and_a_probe_skips_what_it_is_told_to() {
    let rig = TestRig::patient("probe");
    let run = rig.path("run.mcap");
    let run = run.to_str().unwrap();
    rig.ok(["up", "--simulate", "--record", run]);

    // Half of the samples of a window of 200 ms lie before the one that triggers.
    let window = |out: &str, level: u64, more: &[&str]| {
        let (level, out) = (level.to_string(), rig.path(out));
        let mut words = vec!["probe", "scope", "handle_master", "sample.tick"];
        words.extend(["--trigger", "sample.tick", "--level", level.as_str(), "--seconds", "0.2"]);
        words.extend(["--pre-trigger", "0.5", "--out", out.to_str().unwrap()]);
        words.extend(more);
        rig.run(words)
    };
    let level = tick(&rig) + AHEAD;
    let output = window("window.csv", level, &["--timeout", "60"]);
    // Where the host stalled, messages may be missing (exit code 3): the table then says so.
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", told(&output));
    let table = std::fs::read_to_string(rig.path("window.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows[0], ["t_s", "handle_master [rad]", "sample.tick", "lost_before"]);
    let (before, after): (Vec<_>, Vec<_>) =
        rows[1..].iter().partition(|row| value(row, 2) < level as f64);
    assert!(before.iter().all(|row| (-0.1..0.0).contains(&value(row, 0))), "{table}");
    assert_eq!(value(after[0], 0), 0.0, "the first row at the level is the one that triggered");
    assert!(after.iter().all(|row| (0.0..=0.1).contains(&value(row, 0))), "{table}");
    let missing: f64 = rows[1..].iter().map(|row| value(row, 3)).sum();
    assert!(rows.len() > 100 || missing > 0.0, "{table}");
    assert_eq!(output.status.code(), Some(if missing > 0.0 { 3 } else { 0 }), "{table}");

    // The same as messages, with the rig file.
    let level = tick(&rig) + AHEAD;
    let output = window("window.mcap", level, &["--timeout", "60"]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", told(&output));
    let copy = Recording::open(&rig.path("window.mcap")).unwrap();
    assert!(copy.ended_cleanly());
    assert_eq!(copy.metadata(key::RIG), Some("hydrostatic"));
    let samples: Vec<Sample> =
        copy.messages::<Sample>("sample").unwrap().map(|sample| sample.unwrap().message).collect();
    let first = samples.iter().find(|sample| sample.tick >= level).unwrap();
    let origin_ns = first.scan_time_ns;
    let inside = |at_ns: u64| at_ns.abs_diff(origin_ns) <= 100_000_000;
    assert!(samples.iter().all(|sample| inside(sample.scan_time_ns)));
    assert!(samples.iter().any(|sample| sample.tick < level));

    // What does not come is not waited for, and leaves no file.
    let output = window("never.svg", u64::MAX, &["--timeout", "0.3"]);
    assert_eq!(output.status.code(), Some(1), "{}", told(&output));
    assert!(String::from_utf8_lossy(&output.stderr).contains("nothing triggered"));
    assert!(!rig.path("never.svg").exists());

    // One message in 50 ms: the others are skipped, which is told, and is no loss.
    let every = ["probe", "echo", "sample", "--every", "0.05", "--count", "4", "--field", "tick"];
    let output = rig.run(every);
    assert!(output.status.success(), "{}", told(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    let ticks: Vec<u64> =
        text.lines().map(|line| line.strip_prefix("tick=").unwrap().parse().unwrap()).collect();
    assert!(ticks.len() == 4 && ticks[3] - ticks[0] >= 250, "{ticks:?}");
    let skipped = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(skipped.contains(" messages of sample were skipped by --every"), "{skipped}");

    // A screen needs a terminal; plots need a console.
    let output = rig.run(["probe", "scope", "handle"]);
    assert_eq!(output.status.code(), Some(1), "{}", told(&output));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--out"));
    let output = rig.run(["probe", "plot"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("no console"), "{}", told(&output));
    rig.down();

    // The recording answers the same probes without the rig.
    let rates = rig.run(["probe", "hz", "sample", "--json", "--file", run]);
    assert!(matches!(rates.status.code(), Some(0 | 3)), "{}", told(&rates));
    let rates: serde_json::Value = serde_json::from_slice(&rates.stdout).unwrap();
    assert!((rates[0]["rate_hz"].as_f64().unwrap() / 2000.0 - 1.0).abs() < 0.2, "{rates}");
    let echo = rig.run(["probe", "echo", "sample", "--once", "--field", "tick", "--file", run]);
    assert!(String::from_utf8(echo.stdout).unwrap().starts_with("tick="));
}
