//! Measured data through the whole rig: a record replayed in place of the card, at its own pace,
//! through shared memory to the disk, and from there into `farreach identify`, which must give the
//! same result as for the record itself.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ipc_types::{CardKind, Event, EventKind, GateState, Process, SAMPLE, Sample, event_topic};
use recording::mcap_read::Recording;
use serde_json::Value;

use common::{TestRig, told, wait_for};

fn emps_rig() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("launch/rigs/emps.toml")
}

/// Rows of a record, by a reader of the test's own: time, position, motor volts.
fn rows_of(csv: &Path) -> Vec<[f64; 3]> {
    let text = std::fs::read_to_string(csv).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let at = ["t_s", "position_m", "motor_v"]
        .map(|name| names.iter().position(|found| *found == name).unwrap());
    lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            at.map(|column| cells[column].trim().parse().unwrap())
        })
        .collect()
}

/// Whether the recording, which is still being written, contains the end of the replay.
fn replay_done(path: &Path) -> bool {
    let topic = event_topic(Process::Acquisition).unwrap().topic.name;
    let Ok(recording) = Recording::open(path) else { return false };
    let Ok(events) = recording.messages::<Event>(topic) else { return false };
    events.flatten().any(|event| event.message.kind == EventKind::ReplayDone.code())
}

/// Replays a record through a rig that records it, and compares the recording with the record row
/// by row, bit by bit.
fn replay(rig: &TestRig, csv: &Path) -> PathBuf {
    let recording = rig.path("replayed.mcap");
    let rows = rows_of(csv);
    rig.ok([
        "up".as_ref(),
        "--rig".as_ref(),
        emps_rig().as_os_str(),
        "--replay".as_ref(),
        csv.as_os_str(),
        "--record".as_ref(),
        recording.as_os_str(),
    ]);
    let done = wait_for(Duration::from_secs(120), || {
        std::thread::sleep(Duration::from_millis(200));
        replay_done(&recording)
    });
    assert!(done, "the replay did not reach the record's end: {}", told(&rig.run(["status"])));
    // A replay has no motor, so `arm` is refused.
    let refused = rig.run(["arm"]);
    assert!(!refused.status.success(), "{}", told(&refused));
    rig.down();

    let verified = rig.run(["rec".as_ref(), "verify".as_ref(), recording.as_os_str()]);
    assert!(verified.status.success(), "{}", told(&verified));
    let read = Recording::open(&recording).unwrap();
    let samples: Vec<Sample> = read
        .messages::<Sample>(SAMPLE.topic.name)
        .unwrap()
        .map(|sample| sample.unwrap().message)
        .collect();
    assert_eq!(samples.len(), rows.len(), "rows");
    let first = samples[0];
    for (index, (sample, [time, position, volts])) in samples.iter().zip(&rows).enumerate() {
        let row = index + 2;
        assert_eq!(
            sample.master_position[0].to_bits(),
            position.to_bits(),
            "row {row}: position {position}"
        );
        assert_eq!(sample.motor_v[0].to_bits(), volts.to_bits(), "row {row}: motor volts {volts}");
        assert_eq!(sample.record_time_s.to_bits(), time.to_bits(), "row {row}: time {time}");
        assert_eq!((sample.master_present, sample.motor_present), (1, 1), "row {row}");
        assert_eq!(
            (sample.sequence, sample.tick),
            (index as u64, first.tick + index as u64),
            "row {row}"
        );
        assert_eq!(
            sample.scan_time_ns,
            sample.tick * 1_000_000,
            "row {row}: the record's own kilohertz"
        );
        assert!(sample.time_ns >= sample.scan_time_ns, "row {row} came before it was due");
        assert_eq!(
            (sample.session, sample.incarnation),
            (first.session, first.incarnation),
            "row {row}"
        );
        assert_eq!(sample.backend, CardKind::Replay.code(), "row {row}");
        assert_eq!(
            (sample.gate_state, sample.output_v[0]),
            (GateState::Closed.code(), 0.0),
            "row {row}"
        );
    }
    recording
}

/// Replays a record, and identifies it meanwhile; then identifies the recording. The results for
/// the record and for the recording.
fn identified(rig: &TestRig, csv: &Path) -> [Value; 2] {
    std::thread::scope(|scope| {
        let from_record = scope.spawn(|| identify(rig, csv, "record.json"));
        let recording = replay(rig, csv);
        [from_record.join().unwrap(), identify(rig, &recording, "recording.json")]
    })
}

/// The result of `farreach identify` for a record.
fn identify(rig: &TestRig, record: &Path, json: &str) -> Value {
    let json = rig.path(json);
    let output = rig
        .farreach(["identify", "--rig"])
        .arg(emps_rig())
        .arg(record)
        .args(["--limit-s", "3600", "--json"])
        .arg(&json)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", told(&output));
    println!("{}:\n{}", record.display(), String::from_utf8_lossy(&output.stdout));
    serde_json::from_slice(&std::fs::read(json).unwrap()).unwrap()
}

fn ids(outcome: &Value) -> Vec<&str> {
    outcome["effects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|effect| effect["id"].as_str().unwrap())
        .collect()
}

/// Every number of a result by name: errors of each step, declared parameters, parameters of the
/// effects.
fn figures(outcome: &Value) -> Vec<(String, f64)> {
    let mut figures = Vec::new();
    for step in outcome["steps"].as_array().unwrap() {
        for share in ["fit_percent", "select_percent", "report_percent", "all_rows_percent"] {
            figures.push((format!("{}: {share}", step["model"]), step[share].as_f64().unwrap()));
        }
    }
    for parameter in outcome["parameters"].as_array().unwrap() {
        figures.push((parameter["name"].to_string(), parameter["fitted"].as_f64().unwrap()));
    }
    for effect in outcome["effects"].as_array().unwrap() {
        for parameter in effect["parameters"].as_array().unwrap() {
            let name = format!("{}: {}", effect["id"], parameter["name"]);
            figures.push((name, parameter["value"].as_f64().unwrap()));
        }
    }
    figures
}

/// Asserts that two results name the same effects and agree to `tolerance` in each number.
fn assert_agree(record: &Value, recording: &Value, tolerance: f64) {
    assert_eq!(record["verdict"], recording["verdict"]);
    assert_eq!(record["remains"], recording["remains"]);
    assert_eq!(ids(record), ids(recording));
    let (expected, found) = (figures(record), figures(recording));
    assert_eq!(expected.len(), found.len(), "{expected:?} {found:?}");
    for ((name, expected), (other, found)) in expected.iter().zip(&found) {
        assert_eq!(name, other);
        assert!(
            (expected - found).abs() <= tolerance * expected.abs(),
            "{name}: {expected} from the record, {found} from the recording"
        );
    }
}

/// A record with known truth: a carriage of 95 kg with 205 N·s/m and 20 N of Coulomb friction
/// follows sums of sines for 10 s at 1 kHz. Semi-implicit Euler at 20 kHz, dry friction as an
/// impulse that stops the mass exactly; position in counts of 5e-8 m, every number written so that
/// it reads back to the last bit.
fn synthetic() -> String {
    const FORCE_PER_VOLT: f64 = 35.15065;
    let (mass, viscous, coulomb) = (95.0, 205.0, 20.0);
    let wave = |t: f64, f: f64, a: f64, phase: f64| {
        a * ((std::f64::consts::TAU * f * t + phase).sin() - phase.sin())
    };
    let reference = |t: f64| {
        wave(t, 0.31, 0.04, 0.3)
            + wave(t, 0.83, 0.02, 1.7)
            + wave(t, 2.1, 0.004, 4.0)
            + wave(t, 4.3, 0.001, 5.1)
    };
    let mut text = "t_s,position_m,motor_v\n".to_owned();
    let (h, mut x, mut v) = (5e-5, 0.0f64, 0.0f64);
    for step in 0..200_000 {
        let t = f64::from(step) * h;
        let speed = (reference(t + 1e-4) - reference(t - 1e-4)) / 2e-4;
        let force = 3e5 * (reference(t) - x) + 8e3 * (speed - v);
        if step % 20 == 0 {
            let position = 0.1 + (x / 5e-8).round() * 5e-8;
            writeln!(text, "{},{position},{}", f64::from(step / 20) * 1e-3, force / FORCE_PER_VOLT)
                .unwrap();
        }
        let free = v + h / mass * (force - viscous * v);
        v = free.signum() * (free.abs() - h * coulomb / mass).max(0.0);
        x += h * v;
    }
    text
}

#[test]
fn a_record_of_known_truth_goes_through_the_rig_unchanged_and_its_friction_is_named() {
    let rig = TestRig::new("chain");
    let csv = rig.path("carriage.csv");
    std::fs::write(&csv, synthetic()).unwrap();
    assert_eq!(rows_of(&csv).len(), 10_000);
    let [from_record, from_recording] = identified(&rig, &csv);
    assert_eq!(ids(&from_record), ["coulomb_friction"]);
    let coulomb = &from_record["effects"][0]["parameters"][0];
    let (value, std) = (coulomb["value"].as_f64().unwrap(), coulomb["std"].as_f64().unwrap());
    println!("Coulomb friction {value:.2} ± {std:.2} N, true 20 N");
    assert!((value - 20.0).abs() < 0.5, "{coulomb}");
    // The same bits in give the same result.
    assert_agree(&from_record, &from_recording, 1e-12);
}

#[test]
fn the_measured_emps_record_goes_through_the_rig_unchanged_and_its_friction_is_named() {
    let Some(csv) = common::measured("emps_train.csv") else { return };
    let rig = TestRig::new("emps");
    let [from_record, from_recording] = identified(&rig, &csv);
    // The record's force has seven digits after the point; the recording's is the declared 35.15065
    // N/V of the volts.
    assert_agree(&from_record, &from_recording, 1e-4);
    for outcome in [&from_record, &from_recording] {
        assert_eq!(ids(outcome), ["coulomb_friction", "asymmetric_friction"]);
        let steps = outcome["steps"].as_array().unwrap();
        let all: Vec<f64> =
            steps.iter().map(|step| step["all_rows_percent"].as_f64().unwrap()).collect();
        let held_out: Vec<f64> =
            steps.iter().map(|step| step["report_percent"].as_f64().unwrap()).collect();
        println!(
            "force residual, all rows {all:.2?} %, held out {held_out:.2?} %; \
             published 4.08 % and 3.11 %"
        );
        assert_eq!(all.len(), 3);
        // Found: 16.95 %, 3.93 %, 2.91 %; held out 16.90 %, 3.90 %, 2.68 %.
        assert!((all[0] - 16.95).abs() < 0.4, "declared: {all:?}");
        assert!((all[1] - 3.93).abs() < 0.15, "Coulomb friction: {all:?}");
        assert!((all[2] - 2.91).abs() < 0.15, "asymmetric friction: {all:?}");
        assert!(
            held_out[2] < 0.85 * held_out[1] && held_out[1] < 0.35 * held_out[0],
            "held out: {held_out:?}"
        );
    }
}
