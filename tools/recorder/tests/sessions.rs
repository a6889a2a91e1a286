//! `sessions` on real files.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::fs;
use std::path::Path;

use ipc_types::{
    COMMAND, Event, EventKind, Message, Mode, MotorCommand, Process, SAMPLE, SESSION, Sample,
    SessionOutcome, SessionResult, Severity, event_topic,
};
use recorder::{DATA_LOST, DONE};
use recording::mcap_write::{Start, Writer};

use common::{Folder, fails, rec};

const TICK_NS: u64 = 500_000;

/// A recording of two sessions of 1 s, from tick 2000 and from tick 6000: torques of 0.1 and of
/// 0.2 N·m to and fro, the second guided with an error of 0.05 rad. `leave_out` is a tick whose
/// sample is not recorded, `outcome` how the second ended.
fn write(path: &Path, leave_out: Option<u64>, outcome: SessionOutcome) {
    let mut writer = Writer::create(path, &Start::default(), 0).unwrap();
    let event = event_topic(Process::Experiment).unwrap();
    let mut commands = 0;
    for tick in 0..10_000u64 {
        let time_ns = tick * TICK_NS;
        let torque = if tick < 6000 { 0.1 } else { 0.2 };
        let mut sample =
            Sample { tick, scan_time_ns: time_ns, axes: 1, torque_present: 1, ..Sample::default() };
        sample.slave_torque[0] = if tick % 2 == 0 { torque } else { -torque };
        sample.master_position[0] = 0.3;
        sample.stamp(11, 22, tick, time_ns + 80_000);
        if leave_out != Some(tick) {
            writer.write_message(&SAMPLE, &sample).unwrap();
        }
        if tick % 4 == 0 {
            let mode = if tick < 6000 { Mode::Rhythm } else { Mode::Position };
            let mut command = MotorCommand {
                sample_tick: tick,
                sample_time_ns: time_ns,
                mode: mode.code(),
                ..MotorCommand::default()
            };
            command.reference_position[0] = 0.25;
            command.stamp(11, 33, commands, time_ns + 200_000);
            commands += 1;
            writer.write_message(&COMMAND, &command).unwrap();
        }
    }
    for (number, begin, label) in [(1, 2000, "rhythm"), (2, 6000, "guided")] {
        let segment = 2 * number - 1;
        let kind = EventKind::SegmentStarted;
        let started = Event::new(Process::Experiment, kind, Severity::Info, label);
        let mut started = Event { segment, ..started };
        started.stamp(11, 44, u64::from(number), begin * TICK_NS + 1);
        writer.write_message(&event, &started).unwrap();
        let value = 0.1 * f64::from(number);
        let mut result = SessionResult {
            begun_ns: begin * TICK_NS,
            ended_ns: (begin + 2000) * TICK_NS,
            planned_s: if outcome == SessionOutcome::Whole { 1.0 } else { 5.0 },
            samples: 2000,
            segment,
            number,
            sessions: 2,
            bars: 1,
            outcome: if number == 2 { outcome.code() } else { SessionOutcome::Whole.code() },
            ..SessionResult::default()
        };
        result.torque_sum[0] = (0..2000).map(|_| value).sum();
        result.value[0] = value;
        result.target[0] = 0.1 * f64::from(number - 1);
        result.stamp(11, 44, u64::from(number - 1), result.ended_ns + 1);
        writer.write_message(&SESSION, &result).unwrap();
    }
    writer.finish(&[]).unwrap();
}

#[test]
fn sessions_are_listed_with_their_targets_and_errors() {
    let folder = Folder::new();
    write(&folder.path("run.mcap"), None, SessionOutcome::Whole);
    let (name, table) = (folder.text("run.mcap"), folder.text("sessions.csv"));
    let (code, text) = rec(&["sessions", &name, "-o", &table]);
    let expected = format!(
        "{name}: 2 whole sessions of 2\n\
         \x20 session  begins s   takes s    mean torque       to match          value   \
         of it %  segment\n\
         \x20       1     1.000     1.000         0.1000              -         0.1000        \
         \x20-  rhythm\n\
         \x20       2     3.000     1.000         0.2000         0.1000         0.2000       \
         200  guided\n\
         \x20         0.0500 rms from the reference (rad or m)\n"
    );
    assert_eq!((code, text), (DONE, expected));
    let rows = fs::read_to_string(&table).unwrap();
    let expected = "session,of,segment,outcome,t_s,duration_s,samples,samples_missed,\
                    mean_torque_0,target_0,value_0,tracking_error_rms_0";
    assert_eq!(rows.lines().next().unwrap(), expected);
    assert_eq!(rows.lines().count(), 3);
    let figure = folder.text("sessions.svg");
    let both = ["sessions", &name, "-o", &table, "--figure", &figure];
    assert!(fails(&both).contains("never overwritten"));
    assert!(!folder.path("sessions.svg").exists(), "nothing is half done");
    assert_eq!(rec(&["sessions", &name, "--figure", &figure]).0, DONE);
    assert!(fs::read_to_string(&figure).unwrap().contains("mean torque so far"));
    let (_, text) = rec(&["sessions", &name, "--json"]);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        (&json[0]["target"], &json[1]["target"][0]),
        (&serde_json::Value::Null, &0.1.into())
    );
    assert!(json[0]["tracking_error"].is_null(), "the hand moved freely");
    assert!(json[1]["sums_differ_by"].as_f64().unwrap() < 1e-12);
}

#[test]
fn sessions_that_are_not_whole_or_differ_from_their_samples_say_so() {
    let folder = Folder::new();
    write(&folder.path("stopped.mcap"), Some(6500), SessionOutcome::Stopped);
    let (code, text) = rec(&["sessions", &folder.text("stopped.mcap")]);
    assert_eq!(code, DATA_LOST);
    for part in [
        "1 whole sessions of 2",
        "STOPPED: planned were 5.000 s",
        "its sums DIFFER from those of the recorded samples by 0.05 %",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn a_recording_without_sessions_says_what_makes_them() {
    let folder = Folder::new();
    let writer = Writer::create(&folder.path("none.mcap"), &Start::default(), 0).unwrap();
    writer.finish(&[]).unwrap();
    let error = fails(&["sessions", &folder.text("none.mcap")]);
    assert!(
        error.contains("no session has ended in it") && error.contains("[matching]"),
        "{error}"
    );
}
