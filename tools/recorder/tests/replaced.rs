//! Processes in whose place programs of others ran, as the commands tell them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use ipc_types::{Event, EventKind, Message, Process, SAMPLE, Sample, Severity, event_topic};
use recorder::DONE;
use recording::mcap_read::Recording;
use recording::mcap_write::{Start, Writer, key};
use serde_json::Value;

use common::{Folder, rec};

const SECOND_NS: u64 = 1_000_000_000;
/// What the logger told, and when (s since the recording began).
const EVENTS: [(u64, EventKind, &str); 5] = [
    // As a logger that goes on with a recording repeats it.
    (5, EventKind::ProcessReplaced, "control: /usr/bin/python3 control.py"),
    (10, EventKind::ProcessReplaced, "control: /bin/other -x: 1"),
    (20, EventKind::ProcessRestored, "control"),
    (25, EventKind::RecordingStarted, "control"),
    (30, EventKind::ProcessReplaced, "monitor: /bin/m"),
];

/// Writes a recording of 40 s with a sample each second, which says `replaced` where it begins.
fn write(folder: &Folder, replaced: Option<&str>, events: &[(u64, EventKind, &str)]) -> String {
    let path = folder.path("run.mcap");
    let start = Start::default();
    let start = match replaced {
        Some(replaced) => start.with(key::REPLACED, replaced),
        None => start,
    };
    let mut writer = Writer::create(&path, &start, SECOND_NS).unwrap();
    let topic = event_topic(Process::Logger).unwrap();
    let mut told = (0..).zip(events).peekable();
    for tick in 0..=40 {
        let time_ns = (1 + tick) * SECOND_NS;
        let mut sample = Sample { tick, axes: 1, ..Sample::default() };
        sample.stamp(11, 22, tick, time_ns);
        writer.write_message(&SAMPLE, &sample).unwrap();
        while let Some((sequence, (_, kind, text))) = told.next_if(|(_, (at, ..))| *at == tick) {
            let mut event = Event::new(Process::Logger, *kind, Severity::Info, text);
            event.stamp(11, 33, sequence, time_ns);
            writer.write_message(&topic, &event).unwrap();
        }
    }
    assert!(told.next().is_none());
    writer.finish(&[]).unwrap();
    folder.text("run.mcap")
}

/// The lines of `info` on replaced processes.
fn told(file: &str) -> Vec<String> {
    let (code, text) = rec(&["info", file]);
    assert_eq!(code, DONE);
    let lines = text.lines().filter(|line| line.contains("replaced"));
    lines.map(|line| line.trim().to_owned()).collect()
}

const WHOLE: [&str; 3] = [
    "replaced: control: /usr/bin/python3 control.py (from the start to 10.000 s)",
    "replaced: control: /bin/other -x: 1 (from 10.000 s to 20.000 s)",
    "replaced: monitor: /bin/m (from 30.000 s)",
];
const CONTROL: &str = r#"{"control":["/usr/bin/python3","control.py"]}"#;

#[test]
fn info_tells_what_ran_from_the_start_and_what_came_later() {
    let folder = Folder::new();
    let file = write(&folder, Some(CONTROL), &EVENTS);
    assert_eq!(told(&file), WHOLE);
    assert_eq!(rec(&["verify", &file]).0, DONE);
    let (_, text) = rec(&["info", &file, "--json"]);
    let info: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(info["replaced"].as_array().unwrap().len(), 3, "{info}");
    let [first, second] = [&info["replaced"][0], &info["replaced"][1]];
    assert_eq!(first["process"], "control");
    assert_eq!(first["command"], "/usr/bin/python3 control.py");
    assert!(first["from_s"].is_null() && info["replaced"][2]["until_s"].is_null(), "{info}");
    let seconds = |of: &str| second[of].as_f64().unwrap();
    assert!((seconds("from_s") - 10.0).abs() < 1e-9 && (seconds("until_s") - 20.0).abs() < 1e-9);
    assert!(info["replaced_not_known"].is_null(), "{info}");
    assert_eq!(recorder::replaced_lines(&Recording::open(file.as_ref()).unwrap()).unwrap(), WHOLE);
}

#[test]
fn info_is_silent_where_nothing_was_replaced_and_says_where_it_is_not_known() {
    for none in [None, Some("{}")] {
        let folder = Folder::new();
        let file = write(&folder, none, &[]);
        assert_eq!(told(&file), Vec::<String>::new(), "{none:?}");
        let (_, text) = rec(&["info", &file, "--json"]);
        let info: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(info["replaced"], Value::Array(Vec::new()));
    }
    let folder = Folder::new();
    let file = write(&folder, Some("not known: no launcher"), &[]);
    assert_eq!(told(&file), ["replaced: not known: no launcher"]);
    let (_, text) = rec(&["info", &file, "--json"]);
    let info: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(info["replaced_not_known"], "no launcher");
}

#[test]
fn a_copy_knows_what_ran_where_it_begins() {
    let folder = Folder::new();
    let file = write(&folder, Some(CONTROL), &EVENTS);
    let cut = |file: &str, from: &str, name: &str| {
        let out = folder.text(name);
        assert_eq!(rec(&["cut", file, "--from", from, "-o", &out]).0, DONE);
        out
    };
    let middle = cut(&file, "15", "middle.mcap");
    let expected = ["replaced: control: /bin/other -x: 1 (from the start to 20.000 s)", WHOLE[2]];
    assert_eq!(told(&middle), expected);
    // What is copied again still knows it.
    let (again, recovered) = (folder.text("again.mcap"), folder.text("recovered.mcap"));
    assert_eq!(rec(&["cut", &middle, "--to", "10", "-o", &again]).0, DONE);
    assert_eq!(told(&again), expected[..1]);
    assert_eq!(rec(&["recover", &middle, "-o", &recovered]).0, DONE);
    assert_eq!(told(&recovered), expected);
    // After 22 s farreach's own control ran again; after 32 s the other monitor runs.
    assert_eq!(told(&cut(&file, "22", "late.mcap")), WHOLE[2..]);
    let late = cut(&middle, "17", "later.mcap");
    assert_eq!(told(&late), ["replaced: monitor: /bin/m (from the start)"]);
}
