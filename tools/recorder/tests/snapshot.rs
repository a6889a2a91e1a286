//! What a ring holds of an interval, in a file.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeMap;
use std::path::Path;

use ipc_types::{SAMPLE, Sample};
use recorder::{DONE, Part, copy_interval};
use recording::mcap_read::Recording;
use recording::mcap_write::{Start, Writer, key};
use recording::part_path;

use common::short::sample;
use common::{Folder, rec};

const OFFSET_NS: i64 = 1_700_000_000_000_000_000;
const TICK_NS: u64 = 500_000;

/// Parts of 100 samples each, the last one still being written.
fn write_parts(path: &Path, parts: u32) -> Writer {
    for part in 1.. {
        let start = Start { realtime_offset_ns: OFFSET_NS, ..Start::default() }
            .with(key::RIG, "hydrostatic")
            .with(key::PART, &part.to_string());
        let first = u64::from(part - 1) * 100;
        let began_ns = (1000 + first) * TICK_NS;
        let mut writer = Writer::create(&part_path(path, part), &start, began_ns).unwrap();
        for at in first..first + 100 {
            writer.write_message(&SAMPLE, &sample(at)).unwrap();
        }
        if part == parts {
            return writer;
        }
        writer.finish(&[]).unwrap();
    }
    unreachable!()
}

fn at_ns(number: u64) -> u64 {
    use ipc_types::Message as _;
    sample(number).time_ns()
}

#[test]
fn a_snapshot_has_every_message_of_its_interval_and_is_whole() {
    let folder = Folder::new();
    let ring = folder.path("ring.mcap");
    let _present = write_parts(&ring, 6);
    // The oldest is gone.
    std::fs::remove_file(part_path(&ring, 1)).unwrap();
    let part = |number| Part { name: part_path(&ring, number), at: part_path(&ring, number) };
    let parts: Vec<Part> = (2..6).map(part).collect();
    let out = folder.path("snapshot.mcap");
    let notes = BTreeMap::from([("trigger".to_owned(), "trip".to_owned())]);
    let (messages, found) =
        copy_interval(&parts, at_ns(250)..at_ns(430), notes.clone(), &out).unwrap();
    assert_eq!((messages, found), (180, at_ns(250)..at_ns(429)));
    let recording = Recording::open(&out).unwrap();
    let samples = recording.messages::<Sample>("sample").unwrap();
    let ticks: Vec<u64> = samples.map(|sample| sample.unwrap().message.tick - 1000).collect();
    assert_eq!(ticks, (250..430).collect::<Vec<_>>());
    assert_eq!(rec(&["verify", &folder.text("snapshot.mcap")]).0, DONE);
    let edit = recording.metadata_records.iter().find(|(name, _)| name == "farreach.edit").unwrap();
    assert_eq!((edit.1["edit"].as_str(), edit.1["trigger"].as_str()), ("snapshot", "trip"));
    assert_eq!(edit.1["sources"], "ring.part3.mcap, ring.part4.mcap, ring.part5.mcap");

    let error = copy_interval(&parts, at_ns(250)..at_ns(430), notes.clone(), &out).unwrap_err();
    assert!(error.to_string().contains("never overwritten"), "{error:#}");
    let none = folder.path("none.mcap");
    let error = copy_interval(&parts, at_ns(900)..at_ns(910), notes, &none).unwrap_err();
    assert!(error.to_string().contains("nothing of this time"), "{error:#}");
    assert!(!none.exists());
}
