//! `docs/schemas/*.msg`, `docs/topics.md` and `docs/processes.md` are generated from the code; here
//! they are held true.
//!
//! After a change of a message or of the table of topics: `UPDATE_SCHEMAS=1 cargo test -p ipc-types
//! --test schemas`.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use ipc_types::{COMMAND_SERVICES, PROCESSES, Rate, TOPICS};

const HOW: &str = "regenerate with `UPDATE_SCHEMAS=1 cargo test -p ipc-types --test schemas`";

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("docs")
}

fn updating() -> bool {
    std::env::var_os("UPDATE_SCHEMAS").is_some_and(|value| value == "1")
}

/// Writes `expected` when asked to, else holds the file against it. A changed schema must be read
/// by whoever commits it.
fn hold(path: &Path, expected: &str) {
    if updating() {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, expected).unwrap();
        return;
    }
    let found = fs::read_to_string(path)
        .unwrap_or_else(|error| panic!("{}: {error}; {HOW}", path.display()));
    let difference = found
        .lines()
        .map(Some)
        .chain(std::iter::repeat(None))
        .zip(expected.lines().map(Some).chain(std::iter::repeat(None)))
        .take(found.lines().count().max(expected.lines().count()))
        .enumerate()
        .find(|(_, (found, expected))| found != expected);
    if let Some((line, (found, expected))) = difference {
        panic!(
            "{}, line {}: expected {:?}, found {:?}; {HOW}",
            path.display(),
            line + 1,
            expected.unwrap_or("the end of the file"),
            found.unwrap_or("the end of the file"),
        );
    }
    assert_eq!(found, expected, "{}: line endings differ; {HOW}", path.display());
}

/// Message name to the text of its schema file.
fn schemas() -> BTreeMap<&'static str, String> {
    let mut all: BTreeMap<&str, String> = BTreeMap::new();
    for topic in TOPICS {
        let name = topic.ros_name.rsplit('/').next().unwrap();
        let text = format!(
            "{}\n{}",
            ipc_types::schema_comment(&format!(
                "{}: {} bytes, {} in shared memory. Generated from ipc-types; do not edit.",
                topic.ros_name, topic.size, topic.type_name
            )),
            (topic.schema)()
        );
        if let Some(other) = all.insert(name, text.clone()) {
            assert_eq!(other, text, "two schemas of the name {name}");
        }
    }
    all
}

#[test]
fn schema_files_are_those_of_the_code() {
    for (name, text) in schemas() {
        hold(&docs().join("schemas").join(format!("{name}.msg")), &text);
    }
}

#[test]
fn every_schema_file_belongs_to_a_message() {
    let known: BTreeSet<String> = schemas().into_keys().map(|name| format!("{name}.msg")).collect();
    for entry in fs::read_dir(docs().join("schemas")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(known.contains(&name), "docs/schemas/{name} is of no message; remove it");
    }
}

#[test]
fn the_table_of_topics_is_that_of_the_code() {
    let mut text = String::from(
        "# Topics\n\n\
         Generated from `ipc-types/src/topics.rs`; do not edit. Fields and units of each message:\n\
         [schemas](schemas/).\n\n\
         Each topic has one owner, the only process that may publish it. *Buffer* is how many\n\
         messages may wait for a subscriber before the oldest is overwritten (the loss shows in\n\
         the sequence and is counted). *History* is how many a late subscriber still gets.\n\n\
         | topic | owner | message | bytes | rate | buffer | history |\n\
         |---|---|---|---|---|---|---|\n",
    );
    for topic in TOPICS {
        let rate = match topic.rate {
            Rate::Loop(process) => format!("each cycle of {process} (rig file)"),
            Rate::Hertz(rate) => format!("{rate} Hz"),
            Rate::Sporadic => "when something happens".to_owned(),
        };
        let message = topic.ros_name.rsplit('/').next().unwrap();
        writeln!(
            text,
            "| `{}` | {} | [{message}](schemas/{message}.msg) | {} | {rate} | {} | {} |",
            topic.name, topic.owner, topic.size, topic.buffer, topic.history
        )
        .unwrap();
    }
    text.push_str(
        "\nThe logger records all of them.\n\n## Command plane\n\n\
         Request and answer, off the real-time path.\n\n| service | answered by |\n|---|---|\n",
    );
    for service in COMMAND_SERVICES {
        writeln!(text, "| `{}` | {} |", service.name, service.owner).unwrap();
    }
    hold(&docs().join("topics.md"), &text);
}

#[test]
fn the_page_of_processes_is_that_of_the_code() {
    let mut text = String::from(
        "# Processes\n\n\
         Generated from `ipc-types/src/process.rs`; do not edit. [Topics](topics.md) says what\n\
         each publishes, and the unit files in `launch/units/` how it is started.\n\n\
         *Priority* is that of the loop in `SCHED_FIFO`; the rig file may give other rates and\n\
         phases. Processes stop in the reverse order of their start. One that is *silent* for the\n\
         time given is killed and started again.\n\n\
         | process | what it does | starts after | priority | rate | phase | silent | stops in |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for entry in PROCESSES {
        let after: Vec<_> = entry.after.iter().map(|process| process.text()).collect();
        let [priority, rate, phase] = match entry.real_time {
            Some(own) => [
                format!("{}", own.priority),
                format!("{} Hz", own.rate_hz),
                format!("{} µs", own.phase_us),
            ],
            None => Default::default(),
        };
        let only = match (entry.card, entry.optional) {
            (Some(card), _) => Some(format!(" Only with the {card} card.")),
            (None, true) => Some(" Only where it is asked for.".to_owned()),
            (None, false) => None,
        };
        writeln!(
            text,
            "| {} | {}{} | {} | {priority} | {rate} | {phase} | {} s | {} s |",
            entry.name(),
            entry.process.about(),
            only.unwrap_or_default(),
            after.join(", "),
            entry.silence_s,
            entry.stop_s
        )
        .unwrap();
    }
    hold(&docs().join("processes.md"), &text);
}
