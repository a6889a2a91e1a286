//! What a campaign leaves: recordings, which must be whole up to the last flush, and shared memory,
//! which must not grow.

use std::path::{Path, PathBuf};
use std::time::Duration;

use ipc_types::{LOGGER_COMMANDS, LoggerAnswer, LoggerRequest};
use runtime::RigName;

use crate::common::monitor::{LIMIT, Monitor};
use crate::common::{Footprint, TestRig, told, wait_for};
use crate::strike::Target;

/// At most one unflushed chunk and the beginning of the next are cut off (bytes).
const LOST_TAIL: u64 = 2 << 20;

/// The logger's answer.
pub fn ask(monitor: &Monitor, request: &LoggerRequest) -> LoggerAnswer {
    runtime::call(&monitor.node(), &LOGGER_COMMANDS, request, LIMIT).unwrap()
}

/// Topics in which messages were forged, which repeat a sequence: that of their sender, or that of
/// the forgery before, where an injection was repeated.
const FORGED: [&str; 5] = ["command", "enable_line", "sample", "setpoint", "token"];

/// Ends the recording, verifies and removes every part, and begins the next one; how many parts.
pub fn verify_all_and_go_on(target: &mut Target) -> usize {
    let answer = ask(&target.monitor, &LoggerRequest::Stop);
    assert!(answer.recording.is_none(), "{answer:?}");
    let parts = parts_beside(&target.record);
    assert!(!parts.is_empty());
    let mut scans = 0;
    for part in &parts {
        scans += verify(&target.rig, part);
        std::fs::remove_file(part).unwrap();
    }
    assert!(scans > 0, "{parts:?} hold no scans");
    eprintln!("{} parts of the recording verified", parts.len());
    target.rig.ok(["rec", "start", target.record.to_str().unwrap()]);
    parts.len()
}

fn parts_beside(record: &Path) -> Vec<PathBuf> {
    let mut parts: Vec<PathBuf> = std::fs::read_dir(record.parent().unwrap())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "mcap"))
        .collect();
    parts.sort();
    parts
}

/// Messages lost while the logger was down show as gaps; there must be no other damage. Returns how
/// many scans the part holds: none where it was begun milliseconds before the end of the round, or
/// its logger killed before the first flush; then it must not hold what comes less often.
fn verify(rig: &TestRig, part: &Path) -> u64 {
    let output = rig.run(["rec", "verify", "--json", part.to_str().unwrap()]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", told(&output));
    let check: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(check["damage"].as_array().unwrap().len(), 0, "{part:?}: {}", check["damage"]);
    let lost_bytes = check["tail"]["lost_bytes"].as_u64().unwrap();
    assert!(lost_bytes <= LOST_TAIL, "{part:?}: {}", check["tail"]);
    let topics = check["topics"].as_array().unwrap();
    for topic in topics {
        let none = |key: &str| assert_eq!(topic[key].as_u64(), Some(0), "{part:?}: {key}: {topic}");
        none("undecodable");
        none("dropped");
        if !FORGED.iter().any(|name| topic["topic"] == *name) {
            none("duplicates");
        }
    }
    let count = |name: &str| {
        let topic = topics.iter().find(|topic| topic["topic"] == name);
        topic.map_or(0, |topic| topic["count"].as_u64().unwrap())
    };
    let scans = count("card_scan");
    let others = ["sample", "token", "command"].map(count);
    assert!(scans > 0 || others == [0; 3], "{part:?} holds no scans, but {others:?} others");
    scans
}

/// Asserts that the rig's shared memory returns to its size after the first round.
pub fn assert_no_growth(name: &RigName, settled: &Footprint) {
    let (files, bytes) = settled.size();
    let mut now = Footprint::default();
    let shrunk = wait_for(LIMIT, || {
        now = Footprint::of(name);
        now.size().0 <= files && now.size().1 <= bytes
    });
    eprintln!(
        "shared memory (entries, bytes) after the first round: {:?}, at the end: {:?}",
        settled.size(),
        now.size()
    );
    assert!(
        shrunk,
        "shared memory grew from {:?} {:?}\nto {:?} {:?}\n\
         of the dead, then: {:#?}\nof the dead, now: {:#?}",
        settled.size(),
        settled.kinds(),
        now.size(),
        now.kinds(),
        settled.of_the_dead(),
        now.of_the_dead()
    );
}

/// The smallest footprint seen while the keeper cleans up.
pub fn lowest_footprint(name: &RigName) -> Footprint {
    let mut lowest = Footprint::of(name);
    let _never = wait_for(Duration::from_secs(6), || {
        let now = Footprint::of(name);
        if now.size() < lowest.size() {
            lowest = now;
        }
        false
    });
    lowest
}
