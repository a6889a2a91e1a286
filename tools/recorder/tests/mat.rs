//! MATLAB files: what is in them, by a small reader of the format; scipy is asked by `.ci/readers`.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;
mod mat_reader;

use std::fs;
use std::path::Path;

use ipc_types::{
    ANALOG, EMG_MAXIMUM, EmgMaximum, Event, EventKind, Light, Message, PERFORMANCE, Performance,
    Process, SAMPLE, SESSION, Sample, SessionOutcome, SessionResult, Severity, VOLUME, event_topic,
};
use recorder::{DONE, WantedSession};
use recording::mcap_write::{Start, Writer, key};

use common::experiment::volume;
use common::{Folder, fails, rec};
use mat_reader::{Value, read};

const TICK_NS: u64 = 500_000;
const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");

/// The signal of the second electrode: 100 Hz.
fn muscle(tick: u64) -> f64 {
    (std::f64::consts::TAU * tick as f64 / 20.0).sin()
}

fn sample(tick: u64) -> Sample {
    let mut sample = Sample {
        tick,
        scan_time_ns: tick * TICK_NS,
        axes: 1,
        master_present: 1,
        slave_present: 1,
        torque_present: 1,
        motor_present: 0,
        analog_present: 0xff,
        ..Sample::default()
    };
    sample.master_position[0] = tick as f64 * 1e-3;
    sample.slave_torque[0] = -0.25;
    sample.analog_v[1] = 0.5 + tick as f64;
    sample.analog_v[2] = 3.0 + muscle(tick);
    sample.stamp(11, 22, tick, tick * TICK_NS + 80_000);
    sample
}

/// 3 s at 2 kHz, with sessions of these numbers and of a second each, from 1 s and from 2 s on.
fn write(path: &Path, numbers: &[u32]) {
    write_ended(path, numbers, SessionOutcome::Whole);
}

/// The same with sessions that ended so.
fn write_ended(path: &Path, numbers: &[u32], outcome: SessionOutcome) {
    let rig = RIG.replacen("per_v = 1.0 ", "per_v = 2.0 ", 1);
    let start = Start { realtime_offset_ns: 1_700_000_000_000_000_000, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::RIG_FILE, &rig)
        .with(key::SUBJECT, "Jürgen Ø 7 𝄞")
        .with(key::VERSION, "0.1.0");
    let mut writer = Writer::create(path, &start, 0).unwrap();
    for tick in 0..6000 {
        writer.write_message(&SAMPLE, &sample(tick)).unwrap();
    }
    let event = event_topic(Process::Experiment).unwrap();
    for (segment, number) in (1..).zip(numbers.iter().copied()) {
        let begun_ns = u64::from(segment) * 2000 * TICK_NS;
        let kind = EventKind::SegmentStarted;
        let label = format!("session {number} of 2");
        let mut started = Event::new(Process::Experiment, kind, Severity::Info, &label);
        (started.segment, started.a) = (segment, f64::from(segment));
        started.stamp(11, 44, u64::from(segment), begun_ns + 1);
        writer.write_message(&event, &started).unwrap();
        for update in 0..=2u32 {
            let mut shown = Performance {
                at_ns: begun_ns + u64::from(update) * 500_000_000,
                begun_ns,
                number,
                update,
                bars: 1,
                value: [0.1 * f64::from(update), 0.0],
                target: [0.2, 0.0],
                height: [5.0 * f64::from(update), 0.0],
                light: Light::Green.code(),
                ..Performance::default()
            };
            shown.stamp(11, 44, u64::from(3 * segment + update), shown.at_ns + 1);
            writer.write_message(&PERFORMANCE, &shown).unwrap();
        }
        let mut result = SessionResult {
            begun_ns,
            ended_ns: begun_ns + 2000 * TICK_NS,
            planned_s: 1.0,
            samples: 2000,
            number,
            segment,
            sessions: 2,
            bars: 1,
            value: [0.25, 0.0],
            target: [0.2, 0.0],
            outcome: outcome.code(),
            ..SessionResult::default()
        };
        result.stamp(11, 44, u64::from(segment), result.ended_ns);
        writer.write_message(&SESSION, &result).unwrap();
    }
    writer.finish(&[]).unwrap();
}

fn load(folder: &Folder, name: &str) -> Value {
    read(&fs::read(folder.path(name)).unwrap())
}

#[test]
fn each_session_has_a_file_with_every_signal() {
    let folder = Folder::new();
    write(&folder.path("run.mcap"), &[1, 2]);
    let (code, text) =
        rec(&["export", &folder.text("run.mcap"), "--to", "mat", "-o", &folder.text("S7_")]);
    assert_eq!(code, DONE);
    let expected = format!(
        "{}: 2000 samples\n{}: 2000 samples\n",
        folder.text("S7_1.mat"),
        folder.text("S7_2.mat")
    );
    assert_eq!(text, expected);
    let mat = load(&folder, "S7_2.mat");
    let names = [
        "handle_master",
        "handle_slave",
        "handle_torque",
        "handle_motor",
        "emg_1",
        "emg_2",
        "emg_3",
        "emg_4",
        "emg_5",
        "emg_6",
        "scanner_trigger",
    ];
    assert_eq!(mat.at("names").texts(), names);
    let units = mat.at("units").texts();
    assert_eq!([0, 2, 3, 4].map(|at| units[at].as_str()), ["rad", "N·m", "V", "mV"]);
    assert_eq!(mat.at("output").size(), [2000, 11]);
    let (time, output) = (mat.at("time").numbers(), mat.at("output").numbers());
    for at in 0..2000 {
        // The second session begins with tick 4000.
        let of = sample(4000 + at as u64);
        assert!((time[at] - at as f64 * 5e-4).abs() < 1e-12);
        let value = |signal: usize| output[2000 * signal + at];
        assert_eq!(value(0), of.master_position[0]);
        assert_eq!(value(2), -0.25);
        assert!(value(3).is_nan(), "the card told no motor volts");
        assert_eq!(value(4), 2.0 * of.analog_v[1], "in mV");
    }
    let info = mat.at("info");
    assert_eq!(info.at("subject").text(), "Jürgen Ø 7 \u{fffd}");
    assert_eq!((info.at("label").text(), info.at("outcome").text()), ("session 2 of 2", "whole"));
    assert!(info.at("rig_file").text().contains("per_v = 2.0"));
    assert_eq!(info.at("began").text(), "2023-11-14T22:13:22.000Z");
    assert_eq!(info.at("protocol").text(), "");
    assert_eq!(info.at("session").numbers(), [2.0]);
    assert_eq!(info.at("target").numbers(), [0.2]);
    let bar = mat.at("bar");
    assert_eq!(bar.at("time").numbers(), [0.5, 1.0]);
    assert_eq!(bar.at("height").numbers(), [5.0, 10.0]);
    assert_eq!(bar.at("value").size(), [2, 1]);
    let emg = mat.at("emg");
    assert_eq!(emg.at("names").texts()[1], "emg_2");
    assert_eq!(emg.at("groups").texts()[0], "agonist");
    assert_eq!([emg.at("filtered").size(), emg.at("envelope").size()], [[2000, 6]; 2]);
    // Of the second electrode the offset is gone, and 100 Hz pass without delay.
    for at in 200..1800 {
        let error = emg.at("filtered").numbers()[2000 + at] - muscle(4000 + at as u64);
        assert!(error.abs() < 0.05, "{error} at {at}");
        let envelope = emg.at("envelope").numbers()[2000 + at] - 2.0 / std::f64::consts::PI;
        assert!(envelope.abs() < 0.05, "{envelope} at {at}");
    }
    assert_eq!(mat.at("events").at("a").numbers(), [2.0]);
    assert_eq!(mat.at("events").at("kind").texts(), ["segment started"]);
}

#[test]
fn a_recording_without_sessions_is_one_file() {
    let folder = Folder::new();
    write(&folder.path("run.mcap"), &[]);
    let run = folder.text("run.mcap");
    let (code, _) = rec(&["export", &run, "--to", "mat", "-o", &folder.text("whole.mat")]);
    assert_eq!(code, DONE);
    let mat = load(&folder, "whole.mat");
    assert_eq!(mat.at("output").size(), [6000, 11]);
    assert_eq!(mat.at("time").numbers()[0], 0.0);
    assert!(!mat.at("info").has("session"));
}

#[test]
fn several_runs_have_files_of_their_own() {
    let folder = Folder::new();
    write(&folder.path("run.mcap"), &[1, 1]);
    let run = folder.text("run.mcap");
    let (code, text) = rec(&["export", &run, "--to", "mat", "-o", &folder.text("S")]);
    assert_eq!(code, DONE, "{text}");
    let first = |name: &str| load(&folder, name).at("output").numbers()[0];
    assert_eq!([first("S1_1.mat"), first("S2_1.mat")], [2000, 4000].map(|t| f64::from(t) * 1e-3));
}

#[test]
fn nothing_is_overwritten_or_half_written() {
    let folder = Folder::new();
    write(&folder.path("run.mcap"), &[1, 2]);
    let run = folder.text("run.mcap");
    fs::write(folder.path("S2.mat"), "precious").unwrap();
    let error = fails(&["export", &run, "--to", "mat", "-o", &folder.text("S")]);
    assert!(error.contains("S2.mat: it is there already"), "{error}");
    assert!(!folder.path("S1.mat").exists());
    assert_eq!(fs::read_to_string(folder.path("S2.mat")).unwrap(), "precious");
    let nowhere = folder.text("none/S");
    assert!(!fails(&["export", &run, "--to", "mat", "-o", &nowhere]).is_empty());
    let error = fails(&["export", &run, "--to", "mat", "--topic", "session", "-o", &nowhere]);
    assert!(error.contains("--topic"), "{error}");
    let left = fs::read_dir(folder.path("")).unwrap().count();
    assert_eq!(left, 2, "no unfinished file is left");
}

#[test]
fn one_session_at_a_time_as_soon_as_it_is_there() {
    let folder = Folder::new();
    write(&folder.path("run.mcap"), &[1, 2]);
    let (run, name) = (folder.path("run.mcap"), folder.path("live"));
    let wanted = |number, since_ns| WantedSession { number, since_ns, whole: true };
    // Not one of an earlier run, none that is not there, none whose last samples are not yet there.
    let later_ns = 1_500_000_000;
    for missing in [wanted(1, later_ns), wanted(3, 0), wanted(2, 0)] {
        assert_eq!(recorder::write_session(&run, missing, &name).unwrap(), None, "{missing:?}");
    }
    let written = recorder::write_session(&run, wanted(1, 0), &name).unwrap();
    assert_eq!(written, Some(folder.path("live1.mat")));
    assert!(recorder::write_session(&run, wanted(1, 0), &name).is_err(), "never overwritten");
}

/// The whole session, once it has been played again, can stand beside it.
#[test]
fn a_session_that_was_stopped_has_a_file_of_its_own_name() {
    let folder = Folder::new();
    write_ended(&folder.path("run.mcap"), &[1, 2], SessionOutcome::Stopped);
    let (run, name) = (folder.path("run.mcap"), folder.path("live"));
    let wanted = |whole| WantedSession { number: 1, since_ns: 0, whole };
    assert_eq!(recorder::write_session(&run, wanted(true), &name).unwrap(), None);
    for file in ["live1_stopped.mat", "live1_stopped2.mat"] {
        let written = recorder::write_session(&run, wanted(false), &name).unwrap();
        assert_eq!(written, Some(folder.path(file)));
    }
    let exported = folder.text("all");
    rec(&["export", &folder.text("run.mcap"), "--to", "mat", "-o", &exported]);
    assert!(folder.path("all2_stopped.mat").exists() && !folder.path("all2.mat").exists());
}

/// The artefact of a scanner, 0.25 s after each volume's beginning: 200 Hz, ten times the muscle's.
fn artefact(since_s: f64) -> f64 {
    let burst = (-((since_s - 0.25) / 0.05).powi(2)).exp();
    10.0 * burst * (std::f64::consts::TAU * 200.0 * since_s).sin()
}

#[test]
fn the_scanners_artefact_is_taken_out_of_sessions_shorter_than_its_average() {
    let folder = Folder::new();
    let (path, period_s) = (folder.path("run.mcap"), 0.5 * (1.0 + 80e-6));
    let rig = RIG.replace("artefact_volumes = 0", "artefact_volumes = 6");
    assert_ne!(rig, RIG);
    let start = Start::default().with(key::RIG_FILE, &rig);
    let mut writer = Writer::create(&path, &start, 0).unwrap();
    // A tone that does not repeat with the volumes.
    let own = |tick: u64| (std::f64::consts::TAU * 97.3 * tick as f64 * 5e-4).sin();
    let begin_s = |volume: u64| 0.01 + volume as f64 * period_s;
    for tick in 0..40_000 {
        let mut polluted = sample(tick);
        let since_s = (tick as f64 * 5e-4 - 0.01).rem_euclid(period_s);
        polluted.analog_v[2] = 3.0 + own(tick) + artefact(since_s);
        writer.write_message(&SAMPLE, &polluted).unwrap();
    }
    for index in 0..39 {
        // The pulses jitter by a fifth of a millisecond.
        let at_s = begin_s(index) + 2e-4 * (index * 7 % 10) as f64 / 10.0;
        writer.write_message(&VOLUME, &volume(index, (at_s * 1e9) as u64)).unwrap();
    }
    // A session of one second, less than the three volumes that an average needs.
    let mut result = SessionResult {
        begun_ns: 10_000_000_000,
        ended_ns: 11_000_000_000,
        planned_s: 1.0,
        samples: 2000,
        number: 1,
        sessions: 1,
        outcome: SessionOutcome::Whole.code(),
        ..SessionResult::default()
    };
    result.stamp(11, 44, 0, result.ended_ns);
    writer.write_message(&SESSION, &result).unwrap();
    // A run that was measured again, in two contractions; and one after the session.
    for (number, ended_ns, inputs, value) in
        [(1, 1, 0xff << 2, 8.0), (1, 2, 0b111 << 2, 0.5), (2, 3, 1 << 3, 0.7), (3, 1 << 40, 4, 9.0)]
    {
        let (maximum, none) = ([value; ANALOG], EmgMaximum::default());
        let mut maximum = EmgMaximum { number, ended_ns, inputs, maximum, ..none };
        maximum.stamp(11, 44, ended_ns, ended_ns);
        writer.write_message(&EMG_MAXIMUM, &maximum).unwrap();
    }
    writer.finish(&[]).unwrap();
    let (run, name) = (path.to_str().unwrap().to_owned(), folder.text("S"));
    let (code, _) = rec(&["export", &run, "--to", "mat", "-o", &name]);
    assert_eq!(code, DONE);
    let mat = load(&folder, "S1.mat");
    let emg = mat.at("emg");
    assert_eq!(emg.at("filtered").size(), [2000, 6]);
    assert_eq!(emg.at("artefact_suppressed").numbers(), [1.0; 6]);
    let maximum = emg.at("maximum").numbers();
    let known: Vec<f64> = maximum.iter().copied().filter(|value| !value.is_nan()).collect();
    assert_eq!(known, [0.5, 0.7, 0.5], "{maximum:?}");
    let rms = |values: &dyn Fn(usize) -> f64| {
        ((0..2000).map(|at| values(at).powi(2)).sum::<f64>() / 2000.0).sqrt()
    };
    let filtered = emg.at("filtered").numbers();
    let raw = mat.at("output").numbers();
    let column = mat.at("names").texts().iter().position(|name| name == "emg_2").unwrap();
    let before = rms(&|at| raw[2000 * column + at] - 3.0 - own(20_000 + at as u64));
    let after = rms(&|at| filtered[2000 + at] - own(20_000 + at as u64));
    assert!(before > 2.0 && after < 0.1 * before, "{before} before, {after} after");
}
