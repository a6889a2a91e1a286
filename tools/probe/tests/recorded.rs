//! The probes on a small recording: exact output for people and scripts.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::PathBuf;

use clap::Parser;
use ipc_types::{
    COMMAND, Event, EventKind, Message, MotorCommand, Process, SAMPLE, Sample, Severity,
    event_topic,
};
use recorder::{DATA_LOST, DONE};
use recording::mcap_read::Recording;
use recording::mcap_write::{Start, Writer, key};

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
/// ns since 1970 at which CLOCK_MONOTONIC was 0.
const OFFSET_NS: i64 = 1_700_000_000_000_000_000;

#[derive(Debug, Parser)]
struct Line {
    #[command(subcommand)]
    command: probe::Command,
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn text(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }
}

/// Two seconds of samples at 100 Hz, a command for every second one, 200 µs after it. The torque is
/// 0, and 1 N·m from 1 s to 1.1 s. The samples 120 to 122 are missing, and three commands.
fn recording() -> Folder {
    let folder = Folder(tempfile::tempdir().unwrap());
    let start = Start { realtime_offset_ns: OFFSET_NS, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::RIG_FILE, RIG);
    let mut writer = Writer::create(&folder.path("run.mcap"), &start, 0).unwrap();
    let mut note = Event::new(Process::Logger, EventKind::Note, Severity::Info, "sat up, \"fine\"");
    note.stamp(11, 44, 0, 500_000_000);
    writer.write_message(&event_topic(Process::Logger).unwrap(), &note).unwrap();
    for at in (0..200u64).filter(|at| !(120..123).contains(at)) {
        let scan_time_ns = 1_000_000_000 + at * 10_000_000;
        let mut sample = Sample {
            tick: 100 + at,
            scan_time_ns,
            axes: 1,
            master_present: 1,
            torque_present: 1,
            ..Sample::default()
        };
        sample.master_position[0] = at as f64 * 0.25;
        sample.slave_torque[0] = f64::from(u8::from((100..110).contains(&at)));
        sample.stamp(11, 22, at, scan_time_ns + 80_000);
        writer.write_message(&SAMPLE, &sample).unwrap();
        if at % 2 == 0 && at != 50 {
            let mut command = MotorCommand {
                sample_tick: 100 + at,
                sample_time_ns: scan_time_ns,
                volts: [0.5, f64::NAN, 0.0],
                ..MotorCommand::default()
            };
            command.stamp(11, 33, at / 2, scan_time_ns + 280_000);
            writer.write_message(&COMMAND, &command).unwrap();
        }
    }
    writer.finish(&[]).unwrap();
    folder
}

fn parsed(words: &[&str]) -> probe::Command {
    Line::try_parse_from(std::iter::once("probe").chain(words.iter().copied())).unwrap().command
}

/// Runs a probe without a rig: exit code and output.
fn probe(words: &[&str]) -> (i32, String) {
    let mut out = Vec::new();
    let code = probe::run_to(&parsed(words), &"absent".parse().unwrap(), &mut out).unwrap();
    (code, String::from_utf8(out).unwrap())
}

fn fails(words: &[&str]) -> String {
    let error = probe::run_to(&parsed(words), &"absent".parse().unwrap(), &mut Vec::new());
    format!("{:#}", error.unwrap_err())
}

#[test]
fn echo_prints_text_json_and_tables() {
    let folder = recording();
    let file = folder.text("run.mcap");
    let echo = |words: &[&str]| {
        let mut line = vec!["echo", "command", "--file", file.as_str(), "--count", "2"];
        line.extend(["--field", "sample_tick", "--field", "volts"]);
        line.extend(words);
        let (code, text) = probe(&line);
        assert_eq!(code, DONE);
        text
    };
    assert_eq!(echo(&[]), "sample_tick=100 volts=[0.5,NaN,0]\nsample_tick=102 volts=[0.5,NaN,0]\n");
    let json = "\
{\"fields\":{\"sample_tick\":100,\"volts\":[0.5,\"NaN\",0.0]},\"log_time_ns\":1700000001000280000,\
\"topic\":\"command\"}
{\"fields\":{\"sample_tick\":102,\"volts\":[0.5,\"NaN\",0.0]},\"log_time_ns\":1700000001020280000,\
\"topic\":\"command\"}
";
    assert_eq!(echo(&["--format", "json"]), json);
    assert_eq!(echo(&["--json"]), json);
    let table = "\
log_time_ns,sample_tick,volts_0,volts_1,volts_2
1700000001000280000,100,0.5,NaN,0
1700000001020280000,102,0.5,NaN,0
";
    assert_eq!(echo(&["--format", "csv"]), table);
    let (_, once) = probe(&["echo", "sample", "--once", "--field", "tick", "--file", &file]);
    assert_eq!(once, "tick=100\n");
    let note = ["echo", "event/logger", "--format", "csv", "--field", "text", "--file", &file];
    let expected = "log_time_ns,text\n1700000000500000000,\"sat up, \"\"fine\"\"\"\n";
    assert_eq!(probe(&note).1, expected);
}

#[test]
fn every_thins_out_by_time_and_a_loss_is_no_reason() {
    let folder = recording();
    let file = folder.text("run.mcap");
    let words = ["echo", "sample", "--every", "0.4", "--field", "tick", "--file", &file];
    // 120 to 122 are missing: the first one from 1.2 s on is the next.
    assert_eq!(probe(&words).1, "tick=100\ntick=140\ntick=180\ntick=223\ntick=260\n");
}

#[test]
fn list_counts_the_messages_of_a_recording() {
    let folder = recording();
    let file = folder.text("run.mcap");
    let (code, text) = probe(&["list", "--file", &file]);
    assert_eq!(code, DONE);
    let row = |name: &str| text.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
    let head = "topic                 from          messages   lost  bytes  type";
    assert_eq!(text.lines().next(), Some(head));
    let sample = "sample                acquisition        197      3    496  farreach/msg/Sample";
    assert_eq!(row("sample "), sample);
    assert!(row("command ").contains(" 97      3 "), "{text}");
    assert!(row("token ").contains(" 0      0 "), "{text}");
    let (_, json) = probe(&["list", "--json", "--file", &file]);
    let rows: Vec<serde_json::Value> = serde_json::from_str(&json).unwrap();
    let command = rows.iter().find(|row| row["topic"] == "command").unwrap();
    assert_eq!((&command["messages"], &command["lost"]), (&97.into(), &3.into()));
    let (_, fields) = probe(&["list", "command", "--file", &file]);
    assert!(fields.contains("volts                  float64[3]   motor volts (V)\n"), "{fields}");
}

#[test]
fn rates_and_delays_are_those_of_the_messages() {
    let folder = recording();
    let file = folder.text("run.mcap");
    let (code, text) = probe(&["hz", "sample", "command", "--file", &file]);
    assert_eq!(code, DONE);
    let expected = "\
topic                rate Hz  mean ms      min      max      std messages  lost
sample                  98.5   10.153   10.000   40.000    2.137      197     3
command                 48.5   20.625   20.000   60.000    4.521       97     3
";
    assert_eq!(text, expected);
    let (_, json) = probe(&["hz", "sample", "--seconds", "0.5", "--json", "--file", &file]);
    let rows: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&rows[0]["messages"], &rows[0]["lost"]), (&50.into(), &0.into()));
    let (_, text) = probe(&["delay", "command", "--file", &file]);
    let lines: Vec<_> = text.lines().collect();
    let cells: Vec<_> = lines[1].split_whitespace().collect();
    assert_eq!(cells[..5], ["command", "scan", "to", "published", "97"]);
    let times: Vec<f64> = cells[5..].iter().map(|us| us.parse().unwrap()).collect();
    // The histogram has two digits.
    assert!(times.len() == 4 && times.iter().all(|us| (us - 280.0).abs() <= 2.0), "{text}");
    assert_eq!(lines[2..], ["scan to published: within the rig"]);
}

#[test]
fn what_a_recording_cannot_tell_is_an_error() {
    let folder = recording();
    let file = folder.text("run.mcap");
    let error = fails(&["delay", "event/logger", "--file", &file]);
    assert!(error.contains("topic event/logger does not name the scan"), "{error}");
    assert!(error.contains("on a rig that is up"), "{error}");
    let error = fails(&["echo", "sampel", "--file", &file]);
    assert!(error.contains("no topic `sampel`; it has card_output,"), "{error}");
    let error = fails(&["echo", "sample", "--field", "tik", "--file", &file]);
    assert!(error.contains("field tik: topic sample has session, "), "{error}");
    let error = fails(&["hz", "--file", &folder.text("absent.mcap")]);
    assert!(error.contains("absent.mcap"), "{error}");
    assert!(Line::try_parse_from(["probe", "top", "--file", "x.mcap"]).is_err());
    for wrong in [["--once", "--count", "2"].as_slice(), &["--json", "--format", "csv"]] {
        let words = ["probe", "echo", "sample"].into_iter().chain(wrong.iter().copied());
        assert!(Line::try_parse_from(words).is_err(), "{wrong:?}");
    }
}

#[test]
fn a_torn_recording_is_read_and_told() {
    let folder = recording();
    let whole = std::fs::read(folder.path("run.mcap")).unwrap();
    std::fs::write(folder.path("torn.mcap"), &whole[..whole.len() - 40]).unwrap();
    let torn = folder.text("torn.mcap");
    let (code, text) = probe(&["echo", "sample", "--once", "--field", "tick", "--file", &torn]);
    assert_eq!((code, text.as_str()), (DATA_LOST, "tick=100\n"));
    assert_eq!(probe(&["list", "--file", &torn]).0, DATA_LOST);
}

#[test]
fn scope_writes_the_window_of_a_recording() {
    let folder = recording();
    let (file, csv) = (folder.text("run.mcap"), folder.text("w.csv"));
    let scope = |out: &str| {
        let channels = ["scope", "handle_torque", "command.sample_tick", "--file", &file];
        let window = ["--level", "0.5", "--seconds", "0.1", "--pre-trigger", "0.4", "--out", out];
        probe(&[&channels[..], &window[..]].concat())
    };
    let told = "handle_torque rises to 0.5 N·m; 100 ms, 16 messages, 0 lost\n";
    assert_eq!(scope(&csv), (DONE, format!("{csv}: {told}")));
    let table = std::fs::read_to_string(&csv).unwrap();
    let rows: Vec<&str> = table.lines().collect();
    assert_eq!(rows[0], "t_s,handle_torque [N·m],command.sample_tick,lost_before");
    assert_eq!(rows.len(), 17);
    assert_eq!(rows[1..4], ["-0.040000000,0,,0", "-0.039720000,,196,0", "-0.030000000,0,,0"]);
    assert!(rows.contains(&"0.000000000,1,,0") && rows.contains(&"0.060000000,1,,0"), "{table}");
    let svg = folder.text("w.svg");
    assert_eq!(scope(&svg), (DONE, format!("{svg}: {told}")));
    let figure = std::fs::read_to_string(&svg).unwrap();
    assert!(figure.starts_with("<svg") && figure.contains("handle_torque rises to 0.5 N·m"));
    let copy = folder.text("w.mcap");
    assert_eq!(scope(&copy), (DONE, format!("{copy}: {told}")));
    let window = Recording::open(&folder.path("w.mcap")).unwrap();
    let samples = window.messages::<Sample>("sample").unwrap();
    let ticks: Vec<u64> = samples.map(|sample| sample.unwrap().message.tick).collect();
    // By the time of publishing, 80 µs after the scan: the last one is beyond the end.
    assert_eq!(ticks, (196..206).collect::<Vec<_>>());
    assert_eq!(window.metadata(key::RIG), Some("hydrostatic"));
    assert!(fails(&["scope", "--out", &csv, "--file", &file]).contains("never overwritten"));
}

#[test]
fn scope_tells_losses_within_the_window_and_where_nothing_triggers() {
    let folder = recording();
    let (file, out) = (folder.text("run.mcap"), folder.text("w.csv"));
    let position = ["scope", "handle_master", "--file", &file, "--out", &out];
    let window = ["--level", "29.5", "--seconds", "0.2", "--pre-trigger", "0.5"];
    let (code, told) = probe(&[&position[..], &window[..]].concat());
    // It rises to 29.5 rad at sample 118.
    assert_eq!(code, DATA_LOST);
    assert!(
        told.ends_with("handle_master rises to 29.5 rad; 200 ms, 18 messages, 3 lost\n"),
        "{told}"
    );
    let table = std::fs::read_to_string(&out).unwrap();
    let after = table.lines().find(|line| line.ends_with(",3")).unwrap();
    assert_eq!(after, "0.050000000,30.75,3");
    let other = folder.text("never.csv");
    let words = ["scope", "handle_torque", "--level", "9", "--out", &other, "--file", &file];
    let error = fails(&words);
    assert!(error.contains("nothing had triggered: handle_torque rises to 9 N·m"), "{error}");
    let error = fails(&[&words[..], &["--timeout", "0.5"][..]].concat());
    assert!(error.contains("nothing triggered within 500 ms"), "{error}");
    // It rises at 1 s, and the whole of a window of 2 s is to lie before that.
    let early = ["--level", "0.5", "--seconds", "2", "--pre-trigger", "1"];
    let words = ["scope", "handle_torque", "--out", &other, "--file", &file];
    let error = fails(&[&words[..], &early[..]].concat());
    assert!(error.contains("(once too early: "), "{error}");
    assert!(!folder.path("never.csv").exists());
    let words = ["scope", "handle_force", "--out", &other, "--file", &file];
    assert!(fails(&words).contains("expected one of handle_master, "));
}
