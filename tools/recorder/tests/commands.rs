//! The commands on real files.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::fs;
use std::path::Path;

use ipc_types::{
    Event, EventKind, MODEL_STATE, Message, ModelSite, ModelState, MonitorState, Process, SAMPLE,
    SCANNER, Sample, ScannerPulse, Severity, VOLUME, Volume, VolumeSource, event_topic,
};
use recorder::{DATA_LOST, DONE};
use recording::mcap_write::{Start, Writer, key};
use recording::record::{Options, from_csv};

use clap::Parser;
use common::short::{sample, write};
use common::{Folder, Line, fails, rec};

#[test]
fn cat_prints_every_field() {
    let dir = Folder::new();
    write(&dir.path("run.mcap"), 0..20, true);
    let (code, text) = rec(&["cat", &dir.text("run.mcap"), "--topic", "sample", "--json"]);
    assert_eq!(code, DONE);
    let lines: Vec<serde_json::Value> =
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 20);
    for (i, line) in lines.iter().enumerate() {
        let s = sample(i as u64);
        assert_eq!(
            line["fields"]["master_position"][0].as_f64().unwrap().to_bits(),
            s.master_position[0].to_bits()
        );
        assert_eq!(line["fields"]["tick"], s.tick);
        assert_eq!(line["fields"]["analog_v"][3], "NaN");
        assert_eq!(line["fields"].as_object().unwrap().len(), Sample::FIELDS.len());
    }
    let (_, text) = rec(&["cat", &dir.text("run.mcap")]);
    assert_eq!(text.lines().count(), 25);
    assert!(text.lines().next().unwrap().contains(" sample session=11"), "{text}");
    assert!(
        fails(&["cat", &dir.text("run.mcap"), "--topic", "smaple"]).contains("no topic `smaple`")
    );
}

#[test]
fn cut_and_merge_give_the_whole_again() {
    let dir = Folder::new();
    write(&dir.path("run.mcap"), 0..2000, true);
    let cut = |from: &str, to: &str, name: &str| {
        let (code, text) = rec(&[
            "cut",
            &dir.text("run.mcap"),
            "--from",
            from,
            "--to",
            to,
            "-o",
            &dir.text(name),
            "--json",
        ]);
        assert_eq!(code, DONE);
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["messages"].as_u64().unwrap()
    };
    assert_eq!(cut("0", "0.25", "a.mcap") + cut("0.25", "9", "b.mcap"), 2500);
    let (code, _) =
        rec(&["merge", &dir.text("b.mcap"), &dir.text("a.mcap"), "-o", &dir.text("whole.mcap")]);
    assert_eq!(code, DONE);
    let cat = |name: &str| rec(&["cat", &dir.text(name), "--json"]).1;
    assert_eq!(cat("whole.mcap"), cat("run.mcap"));
    assert_eq!(rec(&["verify", &dir.text("whole.mcap")]).0, DONE);
    for (words, expected) in [
        (["--from", "5", "--to", "6"], "ends 0.9995"),
        (["--from", "0.5", "--to", "0.25"], "an end after the beginning"),
        (["--from", "nan", "--to", "1"], "--from NaN"),
    ] {
        let mut line = vec!["cut", "RUN"];
        let (run, out) = (dir.text("run.mcap"), dir.text("never.mcap"));
        line[1] = &run;
        line.extend(words);
        line.extend(["-o", &out]);
        let error = fails(&line);
        assert!(error.contains(expected), "{error}");
    }
    assert!(!dir.path("never.mcap").exists());
}

#[test]
fn export_gives_back_the_record_and_whole_topics() {
    let dir = Folder::new();
    write(&dir.path("run.mcap"), 0..200, true);
    let (code, _) =
        rec(&["export", &dir.text("run.mcap"), "--to", "csv", "-o", &dir.text("run.csv")]);
    assert_eq!(code, DONE);
    let record =
        from_csv(&dir.path("run.csv"), &Options::default().requiring(&["motor_v", "master_rad"]))
            .unwrap();
    assert_eq!(record.len(), 200);
    for i in 0..200 {
        assert_eq!(
            record.column("master_rad").unwrap()[i].to_bits(),
            sample(i as u64).master_position[0].to_bits()
        );
    }
    let (_, text) = rec(&["export", &dir.text("run.mcap"), "--to", "csv", "--topic", "command"]);
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    assert!(header.contains(&"volts_2") && header[0] == "log_time_ns", "{header:?}");
    assert!(text.lines().all(|line| line.split(',').count() == header.len()));
    assert_eq!(text.lines().count(), 51);
    let (_, text) = rec(&["export", &dir.text("run.mcap"), "--to", "csv", "--topic", "token"]);
    assert_eq!(text.lines().count(), 1, "no messages: the header alone");
    assert!(
        fails(&["export", &dir.text("run.mcap"), "--to", "csv", "--axis", "1"]).contains("1 axes")
    );
    assert!(Line::try_parse_from(["rec", "export", "x", "--to", "mat"]).is_err());
    fs::write(dir.path("no.mcap"), "nothing").unwrap();
    assert!(fails(&["info", &dir.text("no.mcap")]).contains("not an MCAP file"));
}

/// A pipe whose reader is gone.
struct Closed;

impl std::io::Write for Closed {
    fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
        Err(std::io::ErrorKind::BrokenPipe.into())
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn the_exit_code_does_not_depend_on_the_reader() {
    let dir = Folder::new();
    write(&dir.path("run.mcap"), 0..2000, true);
    write(&dir.path("holes.mcap"), (0..500).chain(510..1000), true);
    write(&dir.path("killed.mcap"), 0..2000, false);
    for name in ["run.mcap", "holes.mcap", "killed.mcap"] {
        let file = dir.text(name);
        for words in [
            &["cat", &file][..],
            &["cat", &file, "--json"],
            &["export", &file, "--to", "csv"],
            &["export", &file, "--to", "csv", "--topic", "sample"],
            &["info", &file],
            &["verify", &file],
            &["verify", &file, "--json"],
        ] {
            let line =
                Line::try_parse_from(std::iter::once("rec").chain(words.iter().copied())).unwrap();
            let code = recorder::run_to(&line.command, &mut Closed).unwrap();
            assert_eq!(code, rec(words).0, "{words:?}");
        }
    }
    assert_eq!(rec(&["verify", &dir.text("holes.mcap")]).0, DATA_LOST);
}

#[test]
fn codes_have_names_and_a_text_has_one_column() {
    let dir = Folder::new();
    let mut writer = Writer::create(&dir.path("run.mcap"), &Start::default(), 0).unwrap();
    let (kind, severity) = (EventKind::StateChanged, Severity::Warning);
    let mut event = Event::new(Process::Watchdog, kind, severity, "why, \"said\" who");
    event.stamp(1, 2, 0, 5);
    writer.write_message(&event_topic(Process::Watchdog).unwrap(), &event).unwrap();
    let mut sample = Sample { gate_state: 1, ..sample(0) };
    sample.profile = 77;
    writer.write_message(&SAMPLE, &sample).unwrap();
    writer.finish(&[]).unwrap();
    let run = dir.text("run.mcap");
    let (_, text) = rec(&["cat", &run]);
    for expected in
        ["kind=state_changed severity=warning source=watchdog", "gate_state=open", "profile=77"]
    {
        assert!(text.contains(expected), "{expected}: {text}");
    }
    let (_, text) = rec(&["cat", &run, "--topic", "event/watchdog", "--json"]);
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(value["fields"]["kind"], kind.code());
    assert_eq!(value["names"]["kind"], "state changed");
    let (_, text) = rec(&["export", &run, "--to", "csv", "--topic", "event/watchdog"]);
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[0].ends_with(",segment,text"), "{}", lines[0]);
    assert!(lines[1].ends_with(",0,\"why, \"\"said\"\" who\""), "{}", lines[1]);
    assert_eq!(lines.len(), 2);
}

#[test]
fn info_says_when_who_and_what() {
    let dir = Folder::new();
    let path = dir.path("run.mcap");
    let start = Start { realtime_offset_ns: 1_700_000_000_000_000_000, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::RIG_FILE, "name = \"hydrostatic\"\n")
        .with("axis.0.name", "handle")
        .with("axis.0.unit", "rad")
        .with("analog.3.name", "torque")
        .with("analog.3.unit", "N·m");
    let mut writer = Writer::create(&path, &start, 0).unwrap();
    let run = [(key::PROTOCOL, "guided"), (key::SUBJECT, "S07"), (key::PROTOCOL_FILE, "text")];
    writer.write_run(&run.map(|(key, value)| (key.to_owned(), value.to_owned())).into()).unwrap();
    for i in 0..2001 {
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
        writer.tick(sample(i).time_ns).unwrap();
    }
    let (code, text) = rec(&["info", path.to_str().unwrap()]);
    assert_eq!(code, DONE);
    for expected in [
        "still being written",
        "from 2023-11-14T22:13:20Z, ",
        "rig hydrostatic",
        "run guided, subject S07",
        "axis 0 handle (rad), analog 3 torque (N·m)",
    ] {
        assert!(text.contains(expected), "{expected}: {text}");
    }
    let (code, text) = rec(&["verify", path.to_str().unwrap()]);
    assert!(code == DONE && text.contains("still being written; so far nothing lost"), "{text}");
    writer.finish(&[]).unwrap();
    let (_, text) = rec(&["info", path.to_str().unwrap()]);
    assert!(text.contains("from 2023-11-14T22:13:20Z, 1.000 s"), "{text}");
    let entry = |key: &str| rec(&["info", path.to_str().unwrap(), "--text", key]).1;
    assert_eq!(
        (entry("rig_file").as_str(), entry("protocol_file").as_str()),
        ("name = \"hydrostatic\"\n", "text\n")
    );
    assert!(
        fails(&["info", path.to_str().unwrap(), "--text", "x"]).contains("it has analog.3.name")
    );
}

#[test]
fn info_tells_what_the_monitor_said() {
    let dir = Folder::new();
    let path = dir.path("run.mcap");
    let mut writer = Writer::create(&path, &Start::default(), 0).unwrap();
    writer.write_message(&SAMPLE, &sample(0)).unwrap();
    let events = event_topic(Process::Monitor).unwrap();
    let mut say = |at, kind, state: MonitorState, site: ModelSite, text| {
        let (state, site, time_ns) = (state.code(), site.code(), at * 1_000_000_000);
        let mut of = ModelState { learnt: 1.0, state, site, cusum: 4.0, ..ModelState::default() };
        of.stamp(11, 44, at, time_ns);
        writer.write_message(&MODEL_STATE, &of).unwrap();
        let mut event = Event::new(Process::Monitor, kind, Severity::Info, text);
        event.stamp(11, 44, at, time_ns + 1);
        writer.write_message(&events, &event).unwrap();
    };
    say(0, EventKind::ProcessStarted, MonitorState::Learning, ModelSite::None, "");
    say(20, EventKind::BaselineLearnt, MonitorState::Steady, ModelSite::None, "handle");
    let text = "handle: as no listed effect";
    say(31, EventKind::ModelDeparted, MonitorState::Departed, ModelSite::Line, text);
    writer.finish(&[]).unwrap();
    let (_, info) = rec(&["info", path.to_str().unwrap()]);
    let said = "20.000 s  axis 0: baseline learnt: handle
     31.000 s  axis 0: model departed at the line: handle: as no listed effect
    at the end: axis 0: DEPARTED at the line: handle: as no listed effect (";
    assert!(info.contains(said) && !info.contains("process started"), "{info}");
    let (_, info) = rec(&["info", path.to_str().unwrap(), "--json"]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    let departed = &info["model"]["events"][1];
    assert_eq!((&departed["event"], &departed["site"]), (&"model departed".into(), &"line".into()));
}

#[test]
fn merge_refuses_different_rigs_unless_forced() {
    let dir = Folder::new();
    write(&dir.path("a.mcap"), 0..100, true);
    let start = Start::default().with(key::RIG, "emps");
    Writer::create(&dir.path("b.mcap"), &start, 0).unwrap().finish(&[]).unwrap();
    let (a, b, out) = (dir.text("a.mcap"), dir.text("b.mcap"), dir.text("out.mcap"));
    let words = ["merge", &a, &b, "-o", &out];
    let error = fails(&words);
    let expected = "rig (`rig` in the metadata): expected hydrostatic as in ";
    assert!(error.contains(expected) && error.contains("a.mcap, found emps"), "{error}");
    assert!(!dir.path("out.mcap").exists());
    assert_eq!(rec(&[&words[..], &["--force"]].concat()).0, DONE);
}

/// A recording of pulses every 2 s, without those of volumes 3 and 4, and of the volumes that a
/// protocol counted of them.
fn scan(path: &Path, counted: bool) {
    let start = Start { realtime_offset_ns: 1_700_000_000_000_000_000, ..Start::default() };
    let mut writer = Writer::create(path, &start, 1_000_000_000).unwrap();
    let (mut sequence, mut volumes, mut missed) = (0, 0, 0);
    for index in 0..10 {
        let at_ns = 2_000_000_000 * (1 + index);
        let pulse = !(3..=4).contains(&index);
        if pulse {
            volumes += 1;
            let mut message = ScannerPulse { at_ns, pulses: volumes, ..ScannerPulse::default() };
            message.stamp(11, 22, volumes - 1, at_ns + 1_000_000);
            writer.write_message(&SCANNER, &message).unwrap();
        } else {
            missed += 1;
        }
        // Of two volumes in a row without a pulse the second has no message.
        if counted && index != 4 {
            let source = if pulse { VolumeSource::Pulse } else { VolumeSource::Interpolated };
            let mut message = Volume {
                index,
                at_ns,
                expected: 12,
                volumes,
                missed: if pulse { missed } else { 2 },
                repetition_s: 2.0,
                source: source.code(),
                ..Volume::default()
            };
            message.stamp(11, 33, sequence, at_ns + 2_000_000);
            sequence += 1;
            writer.write_message(&VOLUME, &message).unwrap();
        }
    }
    writer.finish(&[]).unwrap();
}

#[test]
fn volumes_are_listed_with_those_that_had_no_pulse() {
    let folder = Folder::new();
    let file = folder.path("scan.mcap");
    scan(&file, true);
    let (table, figure) = (folder.text("volumes.csv"), folder.text("volumes.svg"));
    let name = folder.text("scan.mcap");
    let (code, text) = rec(&["volumes", &name, "-o", &table, "--figure", &figure]);
    assert_eq!(code, DATA_LOST);
    let expected = format!(
        "{name}: scan 1: 10 of 12 volumes\n  from 1.0000 s to 19.0000 s\n  repetition time \
         2.000000 s, jitter 0.000 ms rms\n  2 volumes had no pulse, times interpolated: 3, 4\n  2 \
         at the end were not seen\n"
    );
    assert_eq!(text, expected);
    let rows = fs::read_to_string(&table).unwrap();
    assert_eq!(rows.lines().count(), 11);
    assert_eq!(rows.lines().nth(5).unwrap(), "1,4,9.000000000,0.000000000,interpolated");
    assert!(fs::read_to_string(&figure).unwrap().contains("deviation"));
    assert!(fails(&["volumes", &name, "-o", &table]).contains("never overwritten"));
    let (code, text) = rec(&["volumes", &name, "--json"]);
    assert_eq!(code, DATA_LOST);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json[0]["rows"].as_array().unwrap().len(), 10);
    assert_eq!((&json[0]["missed"], &json[0]["expected"]), (&2.into(), &12.into()));
}

#[test]
fn recorded_pulses_are_numbered_with_a_repetition_time() {
    let folder = Folder::new();
    let file = folder.path("pulses.mcap");
    scan(&file, false);
    let name = folder.text("pulses.mcap");
    assert!(fails(&["volumes", &name]).contains("8 pulses of the scanner were recorded"));
    assert!(fails(&["volumes", &name, "--repetition", "0"]).contains("0.02 to 60 s"));
    let (code, text) = rec(&["volumes", &name, "--repetition", "2", "--volumes", "10"]);
    assert_eq!(code, DATA_LOST);
    assert!(text.contains("10 of 10 volumes"), "{text}");
    assert!(text.contains("2 volumes had no pulse, times interpolated: 3, 4"), "{text}");
}

#[test]
fn several_scans_are_told_apart_and_what_was_counted_twice_is_listed_once() {
    let folder = Folder::new();
    let file = folder.path("scans.mcap");
    let mut writer = Writer::create(&file, &Start::default(), 1_000_000_000).unwrap();
    let mut sequence = 0;
    let mut write = |index: u64, at_s: u64, volumes: u64, surplus: u64| {
        let at_ns = 1_000_000_000 * at_s;
        let mut message = Volume { index, at_ns, volumes, surplus, ..Volume::default() };
        message.stamp(11, 33, sequence, at_ns + 2_000_000);
        sequence += 1;
        writer.write_message(&VOLUME, &message).unwrap();
    };
    for index in 0..3 {
        write(index, 2 + 2 * index, index + 1, 0);
    }
    // A process that is started again counts from the segment's beginning.
    for index in 0..5 {
        write(index, 2 + 2 * index, index + 1, 0);
    }
    // A pulse after the last volume changes a count of that volume.
    write(4, 10, 5, 1);
    for index in 0..4 {
        write(index, 101 + 3 * index, index + 1, 0);
    }
    writer.finish(&[]).unwrap();
    let (code, text) = rec(&["volumes", &folder.text("scans.mcap")]);
    assert_eq!(code, DONE);
    for part in ["scan 1: 5 volumes", "1 pulse after the last volume", "scan 2: 4 volumes"] {
        assert!(text.contains(part), "{text}");
    }
    assert!(text.contains("repetition time 3.000000 s"), "{text}");
    assert!(!text.contains("scan 3"), "{text}");
}
