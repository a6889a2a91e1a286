//! Recordings recovered, cut and merged.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use common::{OFFSET, command, sample, samples, start, write_file};
use ipc_types::{COMMAND, Event, EventKind, Message, Process, SAMPLE, Severity, event_topic};
use recording::mcap_edit::{EditError, check_one_session, check_related, rewrite};
use recording::mcap_read::{RawMessage, ReadError, Recording, Selection, in_order_of_time};
use recording::mcap_write::{FLUSH_NS, Position, Start, Writer, key};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

fn log_times(recording: &Recording) -> Vec<u64> {
    recording.raw(Selection::default()).map(|message| message.unwrap().log_time_ns()).collect()
}

#[test]
fn a_damaged_chunk_costs_that_chunk_only_and_recover_keeps_the_rest() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 6000);
    let mut bytes = fs::read(&path).unwrap();
    // In the middle of a chunk's messages: behind them lies an index, whose loss costs none.
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    let chunk = &chunks[chunks.len() / 2];
    let middle = (chunk.chunk_start_offset + chunk.chunk_length / 2) as usize;
    bytes[middle] ^= 0x55;
    fs::write(&path, &bytes).unwrap();
    let recording = Recording::open(&path).unwrap();
    let check = recording.check().unwrap();
    assert_eq!(check.damage.len(), 1, "{:?}", check.damage);
    let left = samples(&recording);
    assert!(left.len() > 4000 && left.len() < 6000, "{}", left.len());
    let of = check.topics.iter().find(|t| t.topic == "sample").unwrap();
    assert_eq!((of.count + of.gaps, of.gap_places), (6000, 1));
    assert_eq!(check.ticks.unwrap().missing, of.gaps);
    assert!(check.data_lost());

    let out = dir.path().join("recovered.mcap");
    let report = rewrite(&[&recording], None, None, &BTreeMap::new(), &out).unwrap();
    assert_eq!(report.damaged_chunks, 1);
    let recovered = Recording::open(&out).unwrap();
    assert!(recovered.tail.complete && recovered.check().unwrap().damage.is_empty());
    assert_eq!(samples(&recovered), left);
    assert_eq!(recovered.metadata(key::RIG), Some("hydrostatic"));
    assert!(
        rewrite(&[&recording], None, None, &BTreeMap::new(), &out).is_err(),
        "never overwrites"
    );
}

#[test]
fn cut_and_merge_are_inverse() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 4000);
    let recording = Recording::open(&path).unwrap();
    let middle = sample(2500).time_ns + OFFSET as u64;
    let (a, b) = (dir.path().join("a.mcap"), dir.path().join("b.mcap"));
    let first = rewrite(&[&recording], None, Some(middle), &BTreeMap::new(), &a).unwrap();
    let second = rewrite(&[&recording], Some(middle), None, &BTreeMap::new(), &b).unwrap();
    let total = recording.check().unwrap().messages();
    assert_eq!(first.messages + second.messages, total);
    let (a, b) = (Recording::open(&a).unwrap(), Recording::open(&b).unwrap());
    assert_eq!(samples(&a), (0..2500).map(sample).collect::<Vec<_>>());
    let merged = dir.path().join("merged.mcap");
    // the order of the arguments must not matter
    rewrite(&[&b, &a], None, None, &BTreeMap::new(), &merged).unwrap();
    let merged = Recording::open(&merged).unwrap();
    assert_eq!(samples(&merged), (0..4000).map(sample).collect::<Vec<_>>());
    let check = merged.check().unwrap();
    assert!(!check.data_lost(), "{check:?}");
    assert_eq!(merged.channels_of("sample").unwrap().len(), 1);
}

/// A part of a recording in which commands were written before the samples of the same time.
fn part(path: &Path, start: &Start, ticks: std::ops::Range<u64>, history: &[Event]) {
    let mut writer = Writer::create(path, start, sample(ticks.start).time_ns).unwrap();
    for event in history {
        writer.write_message(&event_topic(Process::Control).unwrap(), event).unwrap();
    }
    for i in ticks.clone() {
        if i % 4 == 0 && i + 8 < ticks.end {
            writer.write_message(&COMMAND, &command((i + 8) / 4)).unwrap();
        }
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
        writer.tick(sample(i).time_ns).unwrap();
    }
    writer.finish(&[]).unwrap();
}

#[test]
fn merged_parts_are_in_the_order_of_time_and_hold_every_message_once() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (dir.path().join("a.mcap"), dir.path().join("a.part2.mcap"));
    let mut event = Event::new(Process::Control, EventKind::ProcessStarted, Severity::Info, "");
    event.stamp(11, 33, 0, sample(100).time_ns);
    let mut after = event;
    after.stamp(11, 33, 1, sample(1010).time_ns);
    let mut old = event;
    old.stamp(11, 30, 0, 1_000);
    part(&a, &start(), 0..1000, &[event]);
    let continues = [("sample".to_owned(), Position { incarnation: 22, next: 1000 })].into();
    part(&b, &Start { continues, ..start() }, 1050..2000, &[old, event, after]);
    let (a, b) = (Recording::open(&a).unwrap(), Recording::open(&b).unwrap());
    let gaps = |recording: &Recording| {
        let check = recording.check().unwrap();
        let of = check.topics.iter().find(|topic| topic.topic == "sample").unwrap();
        (of.gaps, of.gaps_before, check.data_lost())
    };
    assert_eq!((gaps(&a), gaps(&b)), ((0, 0, false), (50, 50, true)));
    let out = dir.path().join("whole.mcap");
    let report = rewrite(&[&b, &a], None, None, &BTreeMap::new(), &out).unwrap();
    assert_eq!(report.repeated, 1);
    let whole = Recording::open(&out).unwrap();
    let times = log_times(&whole);
    assert!(times.is_sorted() && times.len() as u64 == report.messages);
    assert_eq!(gaps(&whole), (50, 0, true));
    let check = whole.check().unwrap();
    assert!(check.topics.iter().all(|topic| topic.duplicates == 0), "{:?}", check.topics);
    // what happened long before does not shift the beginning
    assert_eq!(check.origin_ns, Some(sample(0).time_ns + OFFSET as u64));
}

/// What both ways of reading in the order of time yield, which must be the same: times and
/// channels, and how many chunks are damaged.
fn in_order(recording: &Recording) -> (Vec<(u64, u16)>, usize) {
    let told = |message: &RawMessage| (message.log_time_ns(), message.channel_id());
    let split = |all: Vec<Result<RawMessage, ReadError>>| {
        let damaged = all.iter().filter(|message| message.is_err()).count();
        (all.iter().flatten().map(told).collect::<Vec<_>>(), damaged)
    };
    let pulled = split(recording.sorted(Selection::default()).collect());
    let mut pushed = Vec::new();
    in_order_of_time(&[recording], &Selection::default(), |_, message| {
        pushed.push(message);
        Ok::<(), std::convert::Infallible>(())
    })
    .unwrap();
    assert_eq!(pulled, split(pushed));
    pulled
}

#[test]
fn messages_come_in_the_order_of_time_however_they_lie_in_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut writer = Writer::create(&path, &start(), 0).unwrap();
    // Chunks whose times overlap, each backward in itself.
    for part in 0..10 {
        for at in (0..200).rev() {
            writer.write_message(&SAMPLE, &sample(part * 100 + at)).unwrap();
        }
        writer.tick((part + 1) * FLUSH_NS).unwrap();
    }
    writer.finish(&[]).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert!(recording.blocks() >= 10, "{}", recording.blocks());
    let (times, damaged) = in_order(&recording);
    let mut sorted = log_times(&recording);
    assert!(!sorted.is_sorted());
    sorted.sort_unstable();
    assert_eq!(times.iter().map(|(time, _)| *time).collect::<Vec<_>>(), sorted);
    assert_eq!(damaged, 0);

    let mut bytes = fs::read(&path).unwrap();
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    let chunk = &chunks[chunks.len() / 2];
    bytes[(chunk.chunk_start_offset + chunk.chunk_length / 2) as usize] ^= 0x55;
    fs::write(&path, &bytes).unwrap();
    let (left, damaged) = in_order(&Recording::open(&path).unwrap());
    assert_eq!(damaged, 1);
    assert!(left.is_sorted_by_key(|(time, _)| *time) && left.len() < times.len());
}

#[test]
fn recordings_of_different_rigs_and_sessions_are_not_related() {
    let dir = tempfile::tempdir().unwrap();
    let open = |name: &str, start: Start| {
        let path = dir.path().join(name);
        part(&path, &start, 0..20, &[]);
        Recording::open(&path).unwrap()
    };
    let of = |rig: &str, session: &str| start().with(key::RIG, rig).with(key::SESSION, session);
    let one = open("one.mcap", of("hydrostatic", "1"));
    let part = open("part.mcap", of("hydrostatic", "1"));
    let later = open("later.mcap", of("hydrostatic", "2"));
    let other = open("other.mcap", of("emps", "1"));
    check_related(&[&one, &part]).unwrap();
    for (second, what) in [(&later, "session"), (&other, "rig")] {
        let error = check_related(&[&one, &part, second]).unwrap_err();
        assert!(matches!(&error, EditError::Unrelated(found) if found.what == what));
        let text = error.to_string();
        let name = second.path().file_name().unwrap().to_str().unwrap();
        assert!(text.contains("one.mcap") && text.contains(name), "{text}");
    }
}

/// What is merged without --force is of one session in all that the files say.
#[test]
fn only_what_follows_each_other_in_one_session_becomes_one_recording() {
    let dir = tempfile::tempdir().unwrap();
    let of = || start().with(key::SESSION, "1").with(key::RIG_NAME, "left");
    let open = |name: &str, start: Start, ticks: std::ops::Range<u64>| {
        let path = dir.path().join(name);
        part(&path, &start, ticks, &[]);
        Recording::open(&path).unwrap()
    };
    let first = open("first.mcap", of(), 0..10_000);
    let second = open("second.mcap", of().with(key::PART, "2"), 10_100..12_000);
    check_one_session(&[&second, &first]).unwrap();
    // A correction of the clock is none of its being set.
    let corrected = Start { realtime_offset_ns: OFFSET - 50_000_000, ..of() };
    check_one_session(&[&first, &open("corrected.mcap", corrected, 10_100..12_000)]).unwrap();
    // Two cuts of one recording may have messages in common.
    let cuts = [(None, Some(6000)), (Some(4000), None)].map(|(from, until)| {
        let at = |tick: u64| sample(tick).time_ns + OFFSET as u64;
        let path = dir.path().join(format!("cut{from:?}.mcap"));
        rewrite(&[&first], from.map(at), until.map(at), &BTreeMap::new(), &path).unwrap();
        Recording::open(&path).unwrap()
    });
    check_one_session(&[&cuts[0], &cuts[1]]).unwrap();

    let rig = "[rig]\nname = \"other\"\n";
    let set = Start { realtime_offset_ns: OFFSET + 3_600_000_000_000, ..of() };
    let cases = [
        (
            open("rig.mcap", of().with(key::RIG_FILE, rig), 10_100..12_000),
            "line 2 `name = \"other\"`",
        ),
        (open("clock.mcap", set, 10_100..12_000), "`realtime_offset_ns` in the metadata"),
        (open("name.mcap", of().with(key::RIG_NAME, "right"), 10_100..12_000), "found right"),
        (open("same.mcap", of(), 5_000..12_000), "parts that follow each other"),
    ];
    for (other, expected) in cases {
        let text = check_one_session(&[&first, &other]).unwrap_err().to_string();
        let name = other.path().file_name().unwrap().to_str().unwrap();
        for part in [expected, name, "first.mcap", "--force"] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}

/// Two parts that version 0.1.0 wrote, round a logger that was killed.
#[test]
fn recordings_of_version_0_1_0_are_read_and_merged() {
    let parts =
        ["v0.1.0.mcap", "v0.1.0.part2.mcap"].map(|name| Recording::open(&fixture(name)).unwrap());
    let [first, second] = &parts;
    assert_eq!(first.metadata("subject"), Some("S07"));
    assert!(first.metadata(key::RIG_FILE).unwrap().contains("name = \"hydrostatic\""));
    assert!(!first.tail.complete && second.ended_cleanly());
    check_one_session(&[first, second]).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("whole.mcap");
    rewrite(&[first, second], None, None, &BTreeMap::new(), &out).unwrap();
    let whole = Recording::open(&out).unwrap();
    assert!(log_times(&whole).is_sorted());
    assert_eq!(samples(&whole).len(), samples(first).len() + samples(second).len());
    let check = whole.check().unwrap();
    assert!(check.data_lost() && check.ticks.unwrap().missing > 0);
    // the second part begins with events from minutes before
    assert!(check.origin_ns.unwrap() > check.span_ns().unwrap().0);
}
