//! A force-matching experiment with an emulated scanner: real processes, kills of the one that
//! plays it, and sums, targets and bars that are computed again from the recorded samples.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::PathBuf;

use emg::MuscleActivity;
use ipc_types::{
    Event, EventKind, Light, PERFORMANCE, Performance, Process, SAMPLE, SESSION, Sample,
    SessionOutcome, SessionResult, event_topic,
};
use recording::mcap_read::Recording;
use rig::RigFile;
use serde_json::Value;

use common::TestRig;
use common::playing::{messages, play_with_kills};

const REST_1: u32 = 3;
const SESSION_2: u32 = 4;
const SECOND_NS: u64 = 1_000_000_000;

/// Mean magnitude of the torque over the samples of an interval, as a person would compute it.
fn mean_torque(samples: &[Sample], from_ns: u64, to_ns: u64) -> f64 {
    let begin = samples.partition_point(|sample| sample.scan_time_ns < from_ns);
    let end = samples.partition_point(|sample| sample.scan_time_ns < to_ns);
    let torques = samples[begin..end].iter().map(|sample| sample.slave_torque[0].abs());
    torques.sum::<f64>() / (end - begin) as f64
}

fn close(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= 1e-9, "{what}: {found} instead of {expected}");
}

/// Height of a bar (appendix): 10 for the target, at most 19.
fn bar(value: f64, target: f64) -> f64 {
    (10.0 * value / target).min(19.0)
}

/// Records a matching experiment of one set with the shortest sessions, played with kills of the
/// experiment process in these segments; returns the recording and the outcome.
fn record(rig: &TestRig, arguments: &[&str], kills: &[u32]) -> (PathBuf, Value) {
    let file = rig.path("sessions.mcap");
    let rig_file = rig.absolute_rig("hydrostatic");
    rig.ok(["up", "--simulate", "--rig", &rig_file, "--record", file.to_str().unwrap()]);
    let short = [
        "--set=matching.sets=1",
        "--set=matching.session_s=5",
        "--set=matching.rest_s=10",
        "--emulate-scanner=1",
    ];
    let outcome = play_with_kills(rig, &[arguments, &short].concat(), kills);
    rig.ok(["rec", "stop"]);
    rig.down();
    (file, outcome)
}

#[test]
fn sessions_targets_and_bars_are_those_of_the_samples_though_the_process_is_killed() {
    let rig = TestRig::patient("sessions");
    let (file, outcome) = record(&rig, &["force-matching"], &[REST_1, SESSION_2]);
    let file_text = file.to_str().unwrap();
    assert_eq!(
        (&outcome["sessions"]["over"], &outcome["sessions"]["sessions"]),
        (&2.into(), &2.into())
    );

    let recording = Recording::open(&file).unwrap();
    let samples: Vec<Sample> = messages(&recording, SAMPLE.topic.name);
    let results: Vec<SessionResult> = messages(&recording, SESSION.topic.name);
    let shown: Vec<Performance> = messages(&recording, PERFORMANCE.topic.name);
    let topic = event_topic(Process::Experiment).unwrap().topic.name;
    let events: Vec<Event> = messages(&recording, topic);
    // A protocol that was begun again after a trip has sessions of its own before these.
    let whole = SessionOutcome::Whole.code();
    let last = |number| {
        let of = |result: &&SessionResult| (result.number, result.outcome) == (number, whole);
        *results.iter().rev().find(of).unwrap()
    };
    let (first, second) = (last(1), last(2));
    for result in [first, second] {
        assert_eq!(result.ended_ns - result.begun_ns, 5 * SECOND_NS);
        assert_eq!((result.samples_missed, result.sessions, result.bars), (0, 2, 1));
        let mean = mean_torque(&samples, result.begun_ns, result.ended_ns);
        close(result.value[0], mean, "the session's mean");
        close(result.torque_sum[0] / result.samples as f64, mean, "the sum");
        assert!(mean > 0.01, "the simulated hand does nothing: {mean}");
    }
    close(second.target[0], first.value[0], "the target is the session before");
    assert_eq!(first.target[0], 0.0);

    check_bars(&samples, &shown, first, second);
    check_rest(&samples, &shown, first, second);

    let has = |kind: EventKind, number: f64| {
        events.iter().any(|event| event.kind == kind.code() && event.a == number)
    };
    assert!(has(EventKind::SessionStarted, 1.0) && has(EventKind::SessionOver, 2.0));
    let listed = rig.run(["rec", "sessions", file_text, "--json"]);
    let sessions: Value = serde_json::from_slice(&listed.stdout).unwrap();
    let newest = sessions.as_array().unwrap().last().unwrap();
    assert_eq!((&newest["number"], &newest["outcome"]), (&2.into(), &"whole".into()));
    assert_eq!(newest["value"][0].as_f64().unwrap(), second.value[0]);
    assert!(newest["sums_differ_by"].as_f64().unwrap() <= 1e-9, "{newest}");
    assert!(newest["tracking_error"][0].as_f64().unwrap() > 0.0, "{newest}");
}

#[test]
fn the_bars_of_an_emg_experiment_are_the_activity_of_the_recorded_electrodes() {
    let rig = TestRig::patient("emg-sessions");
    let files = format!("--mat={}", rig.path("S07_").display());
    let (file, outcome) = record(&rig, &["emg-matching", &files], &[]);
    for number in 1..=2 {
        let file = rig.path(&format!("S07_{number}.mat"));
        let bytes = std::fs::read(&file).unwrap();
        assert!(bytes.starts_with(b"MATLAB 5.0 MAT-file"), "{file:?}: {outcome}");
        assert!(bytes.len() > 800_000, "{} bytes for 5 s", bytes.len());
    }

    let recording = Recording::open(&file).unwrap();
    let samples: Vec<Sample> = messages(&recording, SAMPLE.topic.name);
    let results: Vec<SessionResult> = messages(&recording, SESSION.topic.name);
    let shown: Vec<Performance> = messages(&recording, PERFORMANCE.topic.name);
    let rig_file = RigFile::load(rig.absolute_rig("hydrostatic")).unwrap();
    let (electrodes, rate_hz) = (rig_file.electrodes(), f64::from(rig_file.rates.acquisition_hz));
    let mut muscles = MuscleActivity::new(&electrodes, &rig_file.emg, rate_hz).unwrap();
    let activity: Vec<[f64; 2]> =
        samples.iter().map(|sample| muscles.update(&sample.analog_v, None).activity).collect();
    let mean = |group: usize, from_ns: u64, to_ns: u64| {
        let begin = samples.partition_point(|sample| sample.scan_time_ns < from_ns);
        let end = samples.partition_point(|sample| sample.scan_time_ns < to_ns);
        activity[begin..end].iter().map(|pair| pair[group]).sum::<f64>() / (end - begin) as f64
    };
    let [.., first, second] = results[..] else { panic!("{results:?}") };
    let mut updates = 0;
    for group in 0..2 {
        for result in [first, second] {
            let expected = mean(group, result.begun_ns, result.ended_ns);
            close(result.value[group], expected, "the activity of a session");
            assert!(expected > 1e-3, "{expected} mV");
        }
        for message in shown.iter().filter(|message| message.begun_ns == second.begun_ns) {
            // Two updates a second, each over the last three half seconds.
            let update = u64::from(message.update);
            if message.light == Light::Green.code() && update > 0 {
                let half = |count: u64| second.begun_ns + count * SECOND_NS / 2;
                let first_half = update.saturating_sub(3);
                let halves = (first_half..update).map(|at| mean(group, half(at), half(at + 1)));
                let expected = halves.sum::<f64>() / (update - first_half) as f64;
                close(message.value[group], expected, "a value of the bar");
                close(message.height[group], bar(expected, first.value[group]), "a height");
                assert_eq!(message.bars, 2);
                updates = updates.max(update);
            }
        }
    }
    assert_eq!(updates, 10);
}

/// Every value and height of the bar in the two sessions.
fn check_bars(
    samples: &[Sample],
    shown: &[Performance],
    first: SessionResult,
    second: SessionResult,
) {
    let mut updates = [0, 0];
    for message in shown.iter().filter(|message| message.at_ns >= first.begun_ns) {
        let in_session = message.light == Light::Green.code();
        let (result, session) = if message.number == 1 { (first, 0) } else { (second, 1) };
        // A session that a kill interrupted has begun at another time.
        if !in_session || message.begun_ns != result.begun_ns || message.update == 0 {
            continue;
        }
        let at_ns = result.begun_ns + u64::from(message.update) * SECOND_NS;
        let mean = mean_torque(samples, result.begun_ns, at_ns);
        close(message.value[0], mean, "a value of the bar");
        if message.number == 2 {
            close(message.height[0], bar(mean, first.value[0]), "a height of the bar");
            assert_eq!(message.bars, 1);
        } else {
            assert_eq!((message.bars, message.height[0]), (0, 0.0), "the first shows no bar");
        }
        updates[session] = updates[session].max(message.update);
    }
    assert_eq!(updates, [5, 5]);
}

/// The rest between them, in which the process was killed: the one after it goes on to show the
/// session's course.
fn check_rest(
    samples: &[Sample],
    shown: &[Performance],
    first: SessionResult,
    second: SessionResult,
) {
    let incarnation =
        |at_ns: u64| shown.iter().rev().find(|message| message.at_ns < at_ns).unwrap().incarnation;
    assert_ne!(incarnation(first.ended_ns), incarnation(second.begun_ns));
    let rest_begun = |message: &&Performance| {
        message.segment == REST_1 && message.at_ns < second.begun_ns && message.replay == 1
    };
    let begun_ns = shown.iter().rev().find(rest_begun).unwrap().begun_ns;
    let repeated: Vec<_> = shown
        .iter()
        .filter(|message| message.segment == REST_1 && message.begun_ns == begun_ns)
        .collect();
    assert!(repeated.len() >= 500, "{} of 10 s", repeated.len());
    for message in repeated {
        let second_of_rest = (message.at_ns - message.begun_ns) / SECOND_NS;
        assert_eq!(message.replay == 1, second_of_rest < 5, "{message:?}");
        if message.replay == 1 {
            let at_ns = first.begun_ns + (second_of_rest + 1) * SECOND_NS;
            let mean = mean_torque(samples, first.begun_ns, at_ns);
            close(message.height[0], bar(mean, first.value[0]), "a height that is repeated");
        }
    }
}
