//! Recordings that say what cannot be: found by the fuzzers of `tests/fuzz`.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::Compression;
use mcap::records::{MessageHeader, Metadata};
use recording::mcap_read::{ReadError, Recording, Selection};

/// Opcode and length, times, size, checksum: what is in front of a chunk's compression (bytes).
const CHUNK_HEAD: usize = 9 + 8 + 8 + 8 + 4;

/// A file with one message in one chunk, and where the chunk begins.
fn one_message(compression: Option<Compression>) -> (Vec<u8>, usize) {
    let options = mcap::WriteOptions::new().compression(compression);
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let channel = writer.add_channel(0, "topic", "json", &BTreeMap::new()).unwrap();
    let header = MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, b"{\"a\":1,\"b\":2,\"c\":3}").unwrap();
    writer.finish().unwrap();
    let bytes = writer.into_inner().into_inner();
    let mut at = mcap::MAGIC.len();
    while bytes[at] != mcap::records::op::CHUNK {
        at += 9 + length_at(&bytes, at + 1);
    }
    (bytes, at)
}

fn length_at(bytes: &[u8], at: usize) -> usize {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize
}

/// What reading the messages of these bytes comes to.
fn refusal(bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hostile.mcap");
    std::fs::write(&path, bytes).unwrap();
    let recording = Recording::open(&path).unwrap();
    let check = recording.check().unwrap();
    assert!(check.data_lost() && check.messages() == 0, "{check:?}");
    let first = recording.raw(Selection::default()).next().unwrap();
    let Err(error @ ReadError::Damaged { .. }) = first else { panic!("{first:?}") };
    error.to_string()
}

#[test]
fn a_record_that_reaches_beyond_its_chunk_is_damage() {
    let (mut bytes, at) = one_message(None);
    let front = CHUNK_HEAD + 4 + 8;
    let within = at + front..at + 9 + length_at(&bytes, at + 1);
    // Of the last record, the message: one byte more than is there; and the right checksum.
    let mut record = within.start;
    while record + 9 + length_at(&bytes, record + 1) < within.end {
        record += 9 + length_at(&bytes, record + 1);
    }
    bytes[record + 1] += 1;
    let sum = crc32fast::hash(&bytes[within]).to_le_bytes();
    bytes[at + CHUNK_HEAD - 4..at + CHUNK_HEAD].copy_from_slice(&sum);
    let told = refusal(&bytes);
    assert!(told.contains("middle of a record"), "{told}");
}

#[test]
fn a_chunk_claims_no_more_memory_than_its_bytes_can_fill() {
    let (mut bytes, at) = one_message(Some(Compression::Lz4));
    let size = at + 9 + 16;
    bytes[size..size + 8].copy_from_slice(&(500_u64 << 20).to_le_bytes());
    let told = refusal(&bytes);
    assert!(told.contains("exceeds limit: `524288000`"), "{told}");
}

#[test]
fn a_clock_offset_without_a_negative_is_read() {
    let mut writer = mcap::WriteOptions::new().create(Cursor::new(Vec::new())).unwrap();
    let entries =
        [("realtime_offset_ns", i64::MIN.to_string()), ("started_ns", u64::MAX.to_string())];
    let metadata = entries.map(|(key, value)| (key.to_owned(), value)).into();
    writer.write_metadata(&Metadata { name: "farreach".to_owned(), metadata }).unwrap();
    writer.finish().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("offset.mcap");
    std::fs::write(&path, writer.into_inner().into_inner()).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.began_ns(), Some(i64::MAX as u64));
    assert_eq!(recording.began_monotonic_ns(), u64::MAX);
}
