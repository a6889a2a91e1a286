//! What is in a recording by its summary is what reading all of it finds; and reading on several
//! threads finds what one finds.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::Path;

use common::{command, fill, sample, start, write_file};
use ipc_types::{COMMAND, Event, EventKind, Message, Process, SAMPLE, Severity, event_topic};
use mcap::records::{MessageHeader, op};
use proptest::prelude::*;
use recording::mcap_edit::rewrite;
use recording::mcap_read::Recording;
use recording::mcap_write::Writer;

/// Writes messages of three topics, at times that need not rise, in chunks that end anywhere.
fn write_drawn(path: &Path, messages: &[(u8, u64, bool)], begun_ns: u64) {
    let topic = event_topic(Process::Control).unwrap();
    let mut writer = Writer::create(path, &start(), begun_ns).unwrap();
    for (number, (kind, time_ns, flush)) in (0..).zip(messages) {
        match kind % 3 {
            0 => {
                let mut message = sample(number);
                message.stamp(11, 22, number, *time_ns);
                writer.write_message(&SAMPLE, &message).unwrap();
            }
            1 => {
                let mut message = command(number);
                message.stamp(11, 33, number, *time_ns);
                writer.write_message(&COMMAND, &message).unwrap();
            }
            _ => {
                let (kind, severity) = (EventKind::Note, Severity::Info);
                let mut message = Event::new(Process::Control, kind, severity, "drawn");
                message.stamp(11, 44, number, *time_ns);
                writer.write_message(&topic, &message).unwrap();
            }
        }
        if *flush {
            writer.flush().unwrap();
        }
    }
    writer.finish(&[]).unwrap();
}

/// Kind, time (ns) and whether the chunk ends, of each message.
fn drawn() -> impl Strategy<Value = Vec<(u8, u64, bool)>> {
    prop::collection::vec((any::<u8>(), 0..3_000_000_000_u64, any::<bool>()), 0..120)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn contents_by_the_summary_are_those_of_the_whole_file(
        messages in drawn(),
        begun_ns in 0..2_000_000_000_u64,
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.mcap");
        write_drawn(&path, &messages, begun_ns);
        let recording = Recording::open(&path).unwrap();
        let check = recording.check().unwrap();
        prop_assert_eq!(recording.contents().unwrap(), Some(check.contents()));
        // Also of a copy in which channels have other numbers.
        let copy = dir.path().join("copy.mcap");
        rewrite(&[&recording], None, None, &Default::default(), &copy).unwrap();
        let copy = Recording::open(&copy).unwrap();
        prop_assert_eq!(copy.contents().unwrap(), Some(copy.check().unwrap().contents()));
    }
}

#[test]
fn only_a_whole_file_tells_its_contents_without_being_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 4000);
    let whole = fs::read(&path).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert!(recording.contents().unwrap().is_some());
    let open = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        Recording::open(&path).unwrap()
    };
    // A torn one, and one whose summary was altered.
    assert_eq!(open(&whole[..whole.len() - 1]).contents().unwrap(), None);
    let mut altered = whole.clone();
    altered[whole.len() - 60] ^= 1;
    assert_eq!(open(&altered).contents().unwrap(), None);
    // The first chunk with messages holds the first of them: where it is damaged, nothing is said.
    let chunks = mcap::Summary::read(&whole).unwrap().unwrap().chunk_indexes;
    let first = chunks.iter().find(|chunk| chunk.message_start_time > 0).unwrap();
    let mut damaged = whole.clone();
    damaged[(first.chunk_start_offset + first.chunk_length / 2) as usize] ^= 1;
    assert_eq!(open(&damaged).contents().unwrap(), None);
}

/// Where the footer begins, which is followed by the end mark. Behind its opcode and its length it
/// has where the summary begins, where the offsets of its groups begin, and the summary's checksum.
fn footer_of(bytes: &[u8]) -> usize {
    bytes.len() - mcap::MAGIC.len() - 29
}

/// A little-endian word.
fn word(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// Where the summary begins, as the footer says.
fn summary_of(bytes: &[u8]) -> usize {
    word(bytes, footer_of(bytes) + 9) as usize
}

/// Where the records of the summary begin.
fn summary_records(bytes: &[u8]) -> Vec<usize> {
    let behind = |at: &usize| Some(at + 9 + word(bytes, at + 1) as usize);
    let places = std::iter::successors(Some(summary_of(bytes)), behind);
    places.take_while(|at| *at < footer_of(bytes)).collect()
}

/// Says in the footer that the summary begins at `begin`, and makes its checksum right.
fn seal(bytes: &mut [u8], begin: usize) {
    let footer = footer_of(bytes);
    bytes[footer + 9..footer + 17].copy_from_slice(&(begin as u64).to_le_bytes());
    let sum = crc32fast::hash(&bytes[begin..footer + 25]);
    bytes[footer + 25..footer + 29].copy_from_slice(&sum.to_le_bytes());
}

/// The file with the records of its summary (opcode, content) changed, and the right checksum.
fn with_summary(whole: &[u8], mut change: impl FnMut(u8, &mut Vec<u8>)) -> Vec<u8> {
    let begin = summary_of(whole);
    let mut bytes = whole[..begin].to_vec();
    for at in summary_records(whole) {
        let content = at + 9..at + 9 + word(whole, at + 1) as usize;
        let (opcode, mut record) = (whole[at], whole[content].to_vec());
        change(opcode, &mut record);
        bytes.push(opcode);
        bytes.extend((record.len() as u64).to_le_bytes());
        bytes.extend(record);
    }
    bytes.extend(&whole[footer_of(whole)..]);
    seal(&mut bytes, begin);
    bytes
}

fn opened(dir: &Path, bytes: &[u8]) -> Recording {
    let path = dir.join("altered.mcap");
    fs::write(&path, bytes).unwrap();
    Recording::open(&path).unwrap()
}

/// What a check of these bytes finds damaged.
fn damage(dir: &Path, bytes: &[u8]) -> Vec<String> {
    let check = opened(dir, bytes).check().unwrap();
    check.damage.into_iter().map(|damage| damage.what).collect()
}

#[test]
fn a_summary_that_counts_wrongly_is_damage() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 400);
    // Of the last channel that is counted, one more.
    let bytes = with_summary(&fs::read(&path).unwrap(), |opcode, record| {
        if opcode == op::STATISTICS {
            let counted = record.len() - 8;
            record[counted] += 1;
        }
    });
    let told = damage(dir.path(), &bytes);
    assert!(told.len() == 1 && told[0].starts_with("the summary counts "), "{told:?}");
}

#[test]
fn a_chunk_that_is_not_where_the_summary_says_is_damage() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 400);
    let mut moved = false;
    // Behind two words comes the place of the chunk.
    let bytes = with_summary(&fs::read(&path).unwrap(), |opcode, record| {
        if opcode == op::CHUNK_INDEX && !moved {
            let elsewhere = word(record, 16) + 1;
            record[16..24].copy_from_slice(&elsewhere.to_le_bytes());
            moved = true;
        }
    });
    let told = damage(dir.path(), &bytes);
    assert_eq!(told, ["the summary lists a chunk here, and there is none"]);
}

#[test]
fn where_a_summary_does_not_say_what_is_in_a_chunk_the_file_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 4000);
    let whole = fs::read(&path).unwrap();
    // The first chunk with messages: behind four words come the length of the list of its channels
    // and the list.
    let mut emptied = 0;
    let bytes = with_summary(&whole, |opcode, record| {
        if opcode == op::CHUNK_INDEX && word(record, 0) > 0 && emptied == 0 {
            let listed = u32::from_le_bytes(record[32..36].try_into().unwrap()) as usize;
            record.splice(32..36 + listed, [0; 4]);
            emptied = listed;
        }
    });
    assert!(emptied > 0);
    let recording = opened(dir.path(), &bytes);
    assert_eq!(recording.contents().unwrap(), None);
    let contents = Recording::open(&path).unwrap().contents().unwrap();
    assert_eq!(Some(recording.contents_or_check().unwrap()), contents);
}

#[test]
fn a_footer_may_leave_the_checksum_out_and_must_say_where_the_summary_begins() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 400);
    let whole = fs::read(&path).unwrap();
    let footer = footer_of(&whole);
    let mut unchecked = whole.clone();
    unchecked[footer + 25..footer + 29].fill(0);
    assert_eq!(damage(dir.path(), &unchecked), Vec::<String>::new());
    assert_eq!(opened(dir.path(), &unchecked).contents().unwrap(), None, "nothing vouches for it");
    // An empty summary.
    let mut empty = whole.clone();
    seal(&mut empty, footer);
    assert_eq!(damage(dir.path(), &empty), Vec::<String>::new());
    // Its last record reaches into the footer.
    let last = *summary_records(&whole).last().unwrap();
    let mut long = whole.clone();
    long[last + 1..last + 9].copy_from_slice(&(word(&whole, last + 1) + 10).to_le_bytes());
    seal(&mut long, summary_of(&whole));
    assert_eq!(opened(dir.path(), &long).contents().unwrap(), None);
    let mut behind = whole.clone();
    seal(&mut behind, footer + 1);
    let told = damage(dir.path(), &behind);
    assert!(told.len() == 1 && told[0].contains("begins behind it"), "{told:?}");
}

#[test]
fn a_chunk_whose_head_was_altered_costs_that_chunk_alone() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 6000);
    let whole = fs::read(&path).unwrap();
    let chunks = mcap::Summary::read(&whole).unwrap().unwrap().chunk_indexes;
    let head = chunks[chunks.len() / 2].chunk_start_offset as usize;
    // Opcode, and length of the record: nothing else guards them.
    for byte in [head, head + 1, head + 7] {
        let mut bytes = whole.clone();
        bytes[byte] ^= 0x40;
        fs::write(&path, &bytes).unwrap();
        let recording = Recording::open(&path).unwrap();
        let check = recording.check().unwrap();
        assert_eq!(check.damage.len(), 1, "{:?}", check.damage);
        let left = common::samples(&recording);
        assert!(left.len() > 5000 && left.len() < 6000, "{}", left.len());
    }
}

/// A recording of these samples that began at a time (ns, CLOCK_MONOTONIC).
fn samples_since(dir: &Path, begun_ns: u64, ticks: Range<u64>) -> Recording {
    let path = dir.join("run.mcap");
    let mut writer = Writer::create(&path, &start(), begun_ns).unwrap();
    for i in ticks {
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
    }
    writer.finish(&[]).unwrap();
    Recording::open(&path).unwrap()
}

/// As of a topic with a history that was all there before the recording began.
#[test]
fn where_all_is_older_than_the_recording_times_count_from_the_oldest_message() {
    let dir = tempfile::tempdir().unwrap();
    let check = samples_since(dir.path(), sample(100).time_ns, 0..50).check().unwrap();
    let samples = check.topics.iter().find(|topic| topic.topic == SAMPLE.topic.name).unwrap();
    assert!(check.topics.iter().any(|topic| topic.count == 0), "a topic without messages");
    assert!(samples.first_ns > 0);
    assert_eq!(check.origin_ns, Some(samples.first_ns));
}

#[test]
fn a_message_of_the_very_time_at_which_a_recording_begins_is_its_first() {
    let dir = tempfile::tempdir().unwrap();
    let recording = samples_since(dir.path(), sample(50).time_ns, 0..51);
    let check = recording.check().unwrap();
    let samples = check.topics.iter().find(|topic| topic.topic == SAMPLE.topic.name).unwrap();
    assert!(samples.first_ns < samples.last_ns);
    assert_eq!(check.origin_ns, Some(samples.last_ns));
    assert_eq!(recording.contents().unwrap(), Some(check.contents()));
}

#[test]
fn a_message_that_cannot_be_decoded_is_counted_and_the_first_reason_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("pairs.mcap");
    let mut mcap = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    let schema = b"float64 a\nfloat64 b\n";
    let schema = mcap.add_schema("lab_msgs/msg/Pair", "ros2msg", schema).unwrap();
    let channel_id = mcap.add_channel(schema, "/pair", "cdr", &BTreeMap::new()).unwrap();
    let whole = [[0, 1, 0, 0].as_slice(), &[0; 16]].concat();
    for (sequence, length) in [(0, 20), (1, 12), (2, 20), (3, 11)] {
        let log_time = 1_000 + u64::from(sequence);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        mcap.write_to_known_channel(&header, &whole[..length]).unwrap();
    }
    mcap.finish().unwrap();
    let check = Recording::open(&path).unwrap().check().unwrap();
    let pair = &check.topics[0];
    assert_eq!((pair.count, pair.gaps, pair.undecodable), (4, 0, 2), "{pair:?}");
    assert!(pair.problem.contains("20 bytes, found 12 bytes"), "{pair:?}");
    assert!(check.data_lost());
}

/// A file, and what was done to it.
fn spoilt(dir: &Path) -> Vec<(String, Vec<u8>)> {
    let path = dir.join("sound.mcap");
    write_file(&path, 5000);
    let sound = fs::read(&path).unwrap();
    let gapped = dir.join("gapped.mcap");
    let mut writer = Writer::create(&gapped, &start(), sample(0).time_ns).unwrap();
    for i in (0..700).chain(720..2000).chain(1990..2600).chain(2700..4000) {
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
        writer.tick(sample(i).time_ns).unwrap();
    }
    writer.finish(&[]).unwrap();
    let mut growing = Writer::create(&dir.join("growing.mcap"), &start(), 0).unwrap();
    fill(&mut growing, 3000);
    let killed = fs::read(dir.join("growing.mcap")).unwrap();
    let mut files = vec![
        ("sound".to_owned(), sound.clone()),
        ("gapped".to_owned(), fs::read(&gapped).unwrap()),
        ("killed".to_owned(), killed),
    ];
    for part in 1..40 {
        let at = sound.len() * part / 40;
        let mut flipped = sound.clone();
        flipped[at] ^= 0x10;
        flipped[sound.len() - at] ^= 0x04;
        files.push((format!("flipped at {at}"), flipped));
        files.push((format!("cut at {at}"), sound[..at].to_vec()));
    }
    files
}

#[test]
fn several_threads_find_what_one_finds() {
    let dir = tempfile::tempdir().unwrap();
    let (mut lost, mut read) = (0, 0);
    for (what, bytes) in spoilt(dir.path()) {
        let path = dir.path().join("run.mcap");
        fs::write(&path, bytes).unwrap();
        let Ok(recording) = Recording::open_damaged(&path) else { continue };
        let one = recording.check_on(1).unwrap();
        for threads in [2, 3, 7] {
            let several = recording.check_on(threads).unwrap();
            assert_eq!(format!("{several:?}"), format!("{one:?}"), "{what}, {threads} threads");
        }
        read += 1;
        lost += usize::from(one.data_lost());
    }
    // All but the sound one, and those in which a bit was flipped that nobody reads.
    assert!(read > 60 && lost > 60, "{lost} of {read}");
}
