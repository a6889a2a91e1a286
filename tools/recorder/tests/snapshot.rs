//! What a ring holds of an interval, in a file.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use ipc_types::{SAMPLE, Sample};
use recorder::{Copied, DATA_LOST, DONE, Part, copy_interval};
use recording::mcap_read::Recording;
use recording::mcap_write::{Start, Writer, key};
use recording::part_path;

use common::short::sample;
use common::{Folder, rec};

const OFFSET_NS: i64 = 1_700_000_000_000_000_000;
const TICK_NS: u64 = 500_000;

/// Begins a part with these samples.
fn write_part(path: &Path, part: u32, samples: Range<u64>) -> Writer {
    let start = Start { realtime_offset_ns: OFFSET_NS, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::PART, &part.to_string());
    let began_ns = (1000 + samples.start) * TICK_NS;
    let mut writer = Writer::create(path, &start, began_ns).unwrap();
    for at in samples {
        writer.write_message(&SAMPLE, &sample(at)).unwrap();
    }
    writer
}

/// Parts of 100 samples each, the last one still being written.
fn write_parts(path: &Path, parts: u32) -> Writer {
    for part in 1.. {
        let first = u64::from(part - 1) * 100;
        let writer = write_part(&part_path(path, part), part, first..first + 100);
        if part == parts {
            return writer;
        }
        writer.finish(&[]).unwrap();
    }
    unreachable!()
}

/// Puts a part in the place of another that ends as a killed logger leaves it: with these samples,
/// without the writer's lock.
fn tear(path: &Path, part: u32, samples: Range<u64>) {
    let growing = path.with_file_name(format!("growing-{part}"));
    let mut writer = write_part(&growing, part, samples);
    writer.flush().unwrap();
    std::fs::copy(&growing, part_path(path, part)).unwrap();
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
    let copied = copy_interval(&parts, at_ns(250)..at_ns(430), notes.clone(), &out).unwrap();
    let times_ns = at_ns(250)..at_ns(429);
    assert_eq!(copied, Copied { messages: 180, times_ns, lost: false });
    let recording = Recording::open(&out).unwrap();
    let samples = recording.messages::<Sample>("sample").unwrap();
    let ticks: Vec<u64> = samples.map(|sample| sample.unwrap().message.tick - 1000).collect();
    assert_eq!(ticks, (250..430).collect::<Vec<_>>());
    assert_eq!(rec(&["verify", &folder.text("snapshot.mcap")]).0, DONE);
    let edit = recording.metadata_records.iter().find(|(name, _)| name == "farreach.edit").unwrap();
    assert_eq!((edit.1["edit"].as_str(), edit.1["trigger"].as_str()), ("snapshot", "trip"));
    assert_eq!(edit.1["sources"], "ring.part3.mcap, ring.part4.mcap, ring.part5.mcap");

    let error = copy_interval(&parts, at_ns(250)..at_ns(430), notes.clone(), &out).unwrap_err();
    assert!(format!("{error:#}").contains("never overwritten"), "{error:#}");
    let none = folder.path("none.mcap");
    let error = copy_interval(&parts, at_ns(900)..at_ns(910), notes, &none).unwrap_err();
    assert!(error.to_string().contains("nothing of this time"), "{error:#}");
    assert!(!none.exists());
}

#[test]
fn what_a_torn_part_lacks_is_told_where_it_belongs_to_the_interval() {
    let folder = Folder::new();
    let ring = folder.path("ring.mcap");
    let _present = write_parts(&ring, 4);
    tear(&ring, 2, 100..160);
    let part = |number| Part { name: part_path(&ring, number), at: part_path(&ring, number) };
    let parts: Vec<Part> = (1..4).map(part).collect();
    let copy = |from: u64, until: u64| {
        let name = format!("{from}.mcap");
        let times_ns = at_ns(from)..at_ns(until);
        let copied = copy_interval(&parts, times_ns, BTreeMap::new(), &folder.path(&name)).unwrap();
        // Nobody else says otherwise of the file.
        let verified = rec(&["verify", &folder.text(&name)]).0;
        assert_eq!(verified, if copied.lost { DATA_LOST } else { DONE }, "{from} to {until}");
        (copied.messages, copied.lost)
    };
    assert_eq!(copy(50, 250), (50 + 60 + 50, true));
    assert_eq!(copy(120, 140), (20, true), "its end is not known to be after that");
    assert_eq!(copy(180, 250), (50, true), "what it lacks is of this time");
    assert_eq!(copy(30, 90), (60, false));
    assert_eq!(copy(210, 250), (40, false));

    // One that has no sample at all, and is the last.
    tear(&ring, 3, 200..200);
    assert_eq!(copy(40, 95), (55, false));
    assert_eq!(copy(150, 190), (10, true));
    assert_eq!(copy(130, 300), (30, true));
}

#[test]
fn a_gap_between_parts_that_are_whole_is_told() {
    let folder = Folder::new();
    let ring = folder.path("ring.mcap");
    // The logger was ended for a while.
    for (number, samples) in [(1, 0..100), (2, 120..200)] {
        write_part(&part_path(&ring, number), number, samples).finish(&[]).unwrap();
    }
    let part = |number| Part { name: part_path(&ring, number), at: part_path(&ring, number) };
    let parts: Vec<Part> = (1..3).map(part).collect();
    for (from, until, messages, lost) in [(50, 150, 50 + 30, true), (130, 180, 50, false)] {
        let out = folder.path(&format!("{from}.mcap"));
        let times_ns = at_ns(from)..at_ns(until);
        let copied = copy_interval(&parts, times_ns, BTreeMap::new(), &out).unwrap();
        assert_eq!((copied.messages, copied.lost), (messages, lost));
    }
}
