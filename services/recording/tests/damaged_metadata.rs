//! Rig files and protocols in recordings whose bits have changed.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use common::{fill, sample, start};
use recording::mcap_edit::rewrite;
use recording::mcap_read::{ReadError, Recording};
use recording::mcap_write::{DAMAGED_RECORD, RUN_RECORD, START_RECORD, Writer, key};

const RIG: &str = "[rig]\nname = \"hydrostatic\" # ä µ\n";
const PROTOCOL: &str = "[[segments]]\nkind = \"hold\"\nduration_s = 2.5\n";

fn write(path: &Path) -> Vec<u8> {
    let mut writer = Writer::create(path, &start(), sample(0).time_ns).unwrap();
    let run = [(key::PROTOCOL, "hold"), (key::PROTOCOL_FILE, PROTOCOL)];
    writer.write_run(&run.map(|(key, value)| (key.to_owned(), value.to_owned())).into()).unwrap();
    fill(&mut writer, 20);
    writer.finish(&[]).unwrap();
    fs::read(path).unwrap()
}

fn find(bytes: &[u8], text: &str) -> usize {
    bytes.windows(text.len()).position(|window| window == text.as_bytes()).unwrap()
}

/// Flips each bit of these bytes in turn.
fn flips(whole: &[u8], at: std::ops::Range<usize>) -> impl Iterator<Item = (usize, Vec<u8>)> {
    at.flat_map(|byte| (0..8).map(move |bit| (byte, bit))).map(move |(byte, bit)| {
        let mut bytes = whole.to_vec();
        bytes[byte] ^= 1 << bit;
        (byte, bytes)
    })
}

#[test]
fn each_flipped_bit_in_rig_file_and_protocol_is_noticed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let whole = write(&path);
    for (text, record) in [(RIG, START_RECORD), (PROTOCOL, RUN_RECORD)] {
        let at = find(&whole, text);
        let mut flipped = 0;
        for (byte, bytes) in flips(&whole, at..at + text.len()) {
            fs::write(&path, bytes).unwrap();
            let error = Recording::open(&path).unwrap_err();
            let ReadError::Metadata { damaged, .. } = &error else { panic!("{byte}: {error}") };
            // A byte that makes no UTF-8 is noticed even before the checksum.
            assert!(damaged.record == record || damaged.record == "metadata", "{byte}: {error}");
            assert!(Recording::open_damaged(&path).unwrap().check().unwrap().data_lost());
            flipped += 1;
        }
        assert_eq!(flipped, 8 * text.len());
    }
}

/// Also where the bit belongs to a key, a length or the record's name, no other rig file is read.
#[test]
fn a_flipped_bit_anywhere_before_it_gives_no_other_rig_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let whole = write(&path);
    let end = find(&whole, RIG) + RIG.len();
    let (mut refused, mut absent, mut same) = (0, 0, 0);
    for (byte, bytes) in flips(&whole, 0..end) {
        fs::write(&path, bytes).unwrap();
        let Ok(recording) = Recording::open(&path) else {
            refused += 1;
            continue;
        };
        match recording.metadata(key::RIG_FILE) {
            None => absent += 1,
            Some(text) => {
                assert_eq!(text, RIG, "byte {byte}");
                same += 1;
            }
        }
    }
    println!("{refused} refused, {absent} without a rig file, {same} with the right one");
    assert!(refused > 10 * absent, "{refused} {absent} {same}");
}

#[test]
fn the_error_says_what_is_wrong_where_and_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut bytes = write(&path);
    let at = find(&bytes, RIG);
    bytes[at + 2] ^= 1;
    fs::write(&path, &bytes).unwrap();
    let text = Recording::open(&path).unwrap_err().to_string();
    for part in ["run.mcap: metadata record farreach at byte", "expected checksum", "rec recover"] {
        assert!(text.contains(part), "{part}: {text}");
    }

    // What is recovered has the messages, and no rig file that anybody takes for the right one.
    let mended = dir.path().join("mended.mcap");
    let damaged = Recording::open_damaged(&path).unwrap();
    let report = rewrite(&[&damaged], None, None, &BTreeMap::new(), &mended).unwrap();
    assert_eq!(report.messages, 20 + 5 + 1);
    let mended = Recording::open(&mended).unwrap();
    assert_eq!(mended.metadata(key::RIG_FILE), None);
    let kept = mended.metadata_records.iter().find(|(name, _)| name == DAMAGED_RECORD).unwrap();
    assert_eq!((kept.1["record"].as_str(), kept.1[key::RIG_FILE].len()), (START_RECORD, RIG.len()));
    assert!(mended.check().unwrap().data_lost());
}

#[test]
fn a_recording_of_an_older_build_is_read_and_is_told_apart() {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/v0.1.0.mcap");
    let old = Recording::open(&fixture).unwrap();
    assert!(old.metadata(key::RIG_FILE).is_some() && !old.start_is_guarded());
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(&path);
    let new = Recording::open(&path).unwrap();
    assert!(new.start_is_guarded());
    assert_eq!(new.metadata(key::RIG_FILE), Some(RIG));
    assert_eq!(new.runs().next().unwrap()[key::PROTOCOL_FILE], PROTOCOL);
}
