//! Faults put into a rig of real processes under power, by the command line: both ends of each
//! stand in the recording with their ticks, and what is promised to trip takes the volts away.
//!
//! `cargo test --test faults -- --ignored --nocapture` tries every kind on both transmissions and
//! prints what became of it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use common::monitor::off_bound;
use common::playing::messages;
use common::{TestRig, assert_told, told, wait_for};
use ipc_types::{CARD_SCAN, CardScan, Event, EventKind, Process, Profile, event_topic};
use recording::mcap_read::Recording;
use serde_json::Value;
use simulator::faults::{Action, LIST};

/// How often a fault is tried again: on a loaded host the rig may trip before it, rightly.
const ATTEMPTS: usize = 10;
/// For so long a rig is watched for a trip.
const WATCHED: Duration = Duration::from_secs(4);

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

fn status(rig: &TestRig) -> Value {
    json(&rig.ok(["status", "--json"]))
}

fn tripped(rig: &TestRig) -> bool {
    status(rig)["watchdog"]["state"] == "tripped"
}

/// What became of a fault in the middle of a movement.
#[derive(Debug)]
struct Outcome {
    /// Cause of the trip; `None` where nothing tripped.
    trip: Option<String>,
    /// Card ticks from the first scan with the fault to the first from which on no volts are at the
    /// motor.
    to_zero: Option<u64>,
    begun: u64,
    ended: u64,
}

/// Puts a fault into a rig that moves, for a time or until it is cleared; `None` where the rig
/// tripped before.
fn attempt(rig: &TestRig, text: &str, more: &[&str], file: &Path) -> Option<Outcome> {
    let _disarmed = rig.run(["disarm"]);
    rig.power_up();
    rig.ok(["rec", "start", file.to_str().unwrap()]);
    let arguments = ["run", "guided-1hz", "--set", "segments.0.duration_s=30"];
    let mut run = rig.farreach(arguments);
    let run = run.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let moves = wait_for(Duration::from_secs(20), || {
        let now = status(rig);
        now["watchdog"]["state"] != "enabled" || now["protocol"]["elapsed_s"].as_f64() > Some(2.0)
    });
    assert!(moves, "{}", rig.ok(["status"]));
    let begun = json(&rig.ok([&["fault", text, "--json"], more].concat()));
    let trips = wait_for(WATCHED, || tripped(rig));
    let now = status(rig);
    let in_force = now["injected_faults"].as_array().unwrap().len();
    let lasts = more.is_empty() && !text.starts_with("fifo_overflow");
    assert_eq!(in_force, usize::from(lasts), "{now}");
    let cleared = rig.ok(["fault", "clear"]);
    assert!(cleared.contains(if lasts { "over at tick" } else { "no fault" }), "{cleared}");
    let _stopped = rig.run(["stop"]);
    let output = run.wait_with_output().unwrap();
    rig.run(["rec", "stop"]);

    let recording = Recording::open(file).unwrap();
    let topic = event_topic(Process::Simulator).unwrap().topic.name;
    let events: Vec<Event> = messages(&recording, topic);
    let tick_of = |kind: EventKind| {
        let event = events.iter().find(|event| event.kind == kind.code());
        let event = event.unwrap_or_else(|| panic!("{text}: {kind:?}"));
        assert!(event.text().starts_with(text), "{}", event.text());
        event.a as u64
    };
    let (begun_tick, ended) = (tick_of(EventKind::FaultBegun), tick_of(EventKind::FaultEnded));
    assert_eq!(begun["faults"][0]["begun_tick"], begun_tick, "the answer is that of the recording");
    let scans: Vec<CardScan> = messages(&recording, CARD_SCAN.topic.name);
    let before = scans.iter().rfind(|scan| scan.tick < begun_tick).unwrap();
    if before.motor_power != 1 {
        println!("{text}: tripped before: {}", told(&output));
        return None;
    }
    // Behind the read-back an amplifier at its rail drives the motor for as long as it has power.
    let rail = text.starts_with("amplifier_rail");
    let acts = |scan: &&CardScan| scan.motor_v[0] != 0.0 || (rail && scan.motor_power == 1);
    // Until the fault was cleared: what came after it is the end of the protocol.
    let during = scans.iter().filter(|scan| scan.tick < ended || trips);
    let last = during.clone().filter(acts).map(|scan| scan.tick).max().unwrap();
    let newest = during.map(|scan| scan.tick).max().unwrap();
    Some(Outcome {
        trip: trips.then(|| now["watchdog"]["cause"].as_str().unwrap().to_owned()),
        to_zero: (last < newest).then(|| (last + 1).saturating_sub(begun_tick)),
        begun: begun_tick,
        ended,
    })
}

fn outcome(rig: &TestRig, text: &str, more: &[&str]) -> Outcome {
    let name = |attempt| rig.path(&format!("{}-{attempt}.mcap", text.replace(['@', '='], "-")));
    let files: Vec<PathBuf> = (0..ATTEMPTS).map(name).collect();
    files.iter().find_map(|file| attempt(rig, text, more, file)).expect("it always trips before")
}

#[test]
fn faults_under_power_are_recorded_and_take_the_volts_away() {
    let rig = TestRig::patient("faults");
    rig.up_homed();
    assert_told(&rig.run(["fault", "gremlins"]), &["gremlins", "encoder_stuck"]);
    assert_told(&rig.run(["fault", "cable_slip"]), &["hydrostatic", "cable"]);
    assert_told(&rig.run(["fault", "clear", "dac_stuck"]), &["dac_stuck", "in force"]);
    let bound = off_bound("control", Profile::BestEffort).unwrap();

    // For a time, at exact ticks; nothing looks for it.
    let held = outcome(&rig, "adc_stuck@torque", &["--for", "0.05"]);
    assert_eq!(held.ended - held.begun, 100, "{held:?}");
    let invalid = outcome(&rig, "adc_invalid@torque", &[]);
    assert_eq!(invalid.trip.as_deref(), Some("sensor_invalid"), "{invalid:?}");
    assert!(invalid.to_zero.is_some_and(|ticks| ticks <= bound), "{invalid:?}");
    let jump = outcome(&rig, "encoder_jump@master", &[]);
    assert_eq!(jump.trip.as_deref(), Some("encoder_jump"), "{jump:?}");
    assert!(jump.to_zero.is_some_and(|ticks| ticks <= bound), "{jump:?}");

    rig.ok(["fault", "amplifier_dead", "--axis", "handle"]);
    let listed = json(&rig.ok(["fault", "list", "--json"]));
    assert_eq!(listed["kinds"].as_array().unwrap().len(), LIST.len());
    assert_eq!(listed["in_force"][0]["fault"], "amplifier_dead");
    let shown = rig.ok(["status"]);
    assert!(shown.contains("INJECTED: amplifier_dead on handle since tick "), "{shown}");
    rig.ok(["fault", "clear", "amplifier_dead"]);
    assert!(!rig.ok(["status"]).contains("INJECTED"));
    rig.down();

    // No other card has faults.
    rig.ok(["up", "--card", "null"]);
    assert_told(&rig.run(["fault", "dac_stuck"]), &["no simulated card", "never into a real one"]);
    rig.down();
}

/// Not a test: the figures of `docs/faults.md` with real processes.
#[test]
#[ignore = "measures every kind, which takes a quarter of an hour"]
fn what_becomes_of_every_kind() {
    for name in ["hydrostatic", "cable"] {
        let rig = TestRig::new(&format!("figures-{name}"));
        let rig_file = rig.absolute_rig(name);
        for kind in LIST.iter().filter(|kind| kind.only.is_none_or(|only| only.name() == name)) {
            if kind.action == Action::TriggerLost {
                continue;
            }
            for text in kind.texts("torque") {
                // A new card: nothing is left of the fault before.
                rig.ok(["up", "--simulate", "--rig", &rig_file]);
                let Outcome { trip, to_zero, .. } = outcome(&rig, &text, &[]);
                let (trip, ticks) = (trip.unwrap_or("not noticed".to_owned()), to_zero);
                println!("FIGURE {name} {text}: {trip}, {ticks:?} ticks to 0 V");
                rig.down();
                std::fs::read_dir(rig.path("")).unwrap().flatten().for_each(|file| {
                    if file.path().extension().is_some_and(|it| it == "mcap") {
                        std::fs::remove_file(file.path()).unwrap();
                    }
                });
            }
        }
    }
}
