//! A recording in parts: nothing is lost at a seam, and nothing is there twice.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ipc_types::{Message, MotorCommand, Sample, Split, TOPICS};
use logger::recorder_front_end::{Outcome, RecorderError, RecorderFrontEnd, StartRequest};
use logger::{Opener, QUEUE_BYTES, QUEUE_HEADER_BYTES, state};
use recording::mcap_edit::{check_one_session, rewrite};
use recording::mcap_read::Recording;
use recording::mcap_write::{Output, Start, WriteError, Writer, key};
use recording::part_path;

/// Far beyond anything that a working machine needs; it only keeps a broken test from hanging.
const LONG: Duration = Duration::from_secs(60);
const SECOND_NS: u64 = 1_000_000_000;
const SAMPLE_NS: u64 = 500_000;
/// Bytes for about a hundred samples and commands.
const ROOM: usize = 100 * (QUEUE_HEADER_BYTES + size_of::<Sample>());

fn topic(name: &str) -> usize {
    TOPICS.iter().position(|topic| topic.name == name).unwrap()
}

/// Samples, and a command for every fourth one.
fn push(recorder: &mut RecorderFrontEnd, sequences: std::ops::Range<u64>) {
    let (samples, commands) = (topic("sample"), topic("command"));
    for sequence in sequences {
        let mut sample = Sample { tick: sequence, axes: 1, ..Sample::default() };
        sample.stamp(5, 1, sequence, sequence * SAMPLE_NS);
        recorder.push(samples, sample.as_bytes());
        if sequence.is_multiple_of(4) {
            let mut command = MotorCommand { sample_tick: sequence, ..MotorCommand::default() };
            command.stamp(5, 2, sequence / 4, sequence * SAMPLE_NS + 1);
            recorder.push(commands, command.as_bytes());
        }
    }
}

fn request(path: &Path, split: Split) -> StartRequest {
    StartRequest {
        path: path.to_owned(),
        session: 5,
        realtime_offset_ns: 1_000,
        metadata: BTreeMap::from([(key::RIG.to_owned(), "cable".to_owned())]),
        split,
        ..StartRequest::default()
    }
}

fn outcome(recorder: &mut RecorderFrontEnd) -> Outcome {
    recorder.wait(LONG).unwrap()
}

fn sequences(path: &Path) -> Vec<u64> {
    let recording = Recording::open(path).unwrap();
    let samples = recording.messages::<Sample>("sample").unwrap();
    samples.map(|sample| sample.unwrap().message.sequence).collect()
}

fn command_sequences(path: &Path) -> Vec<u64> {
    let recording = Recording::open(path).unwrap();
    let commands = recording.messages::<MotorCommand>("command").unwrap();
    commands.map(|command| command.unwrap().message.sequence).collect()
}

fn end_of(path: &Path, key: &str) -> u64 {
    Recording::open(path).unwrap().end_record().unwrap()[key].parse().unwrap()
}

#[test]
fn parts_are_whole_and_merged_give_every_message_once() {
    let (folder, states) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let path = folder.path().join("run.mcap");
    let mut recorder = RecorderFrontEnd::new(Some(states.path().to_owned())).unwrap();
    recorder.start(request(&path, Split::default())).unwrap();
    // One part without a message, and one that is asked for before the first file is there.
    let seams = [700, 2_000, 2_000, 2_003, 5_000];
    let mut from = 0;
    for (number, seam) in seams.into_iter().enumerate() {
        push(&mut recorder, from..seam);
        from = seam;
        recorder.tick(seam * SAMPLE_NS);
        let replaced = (key::REPLACED.to_owned(), format!("by the {number}"));
        recorder.split(BTreeMap::from([replaced])).unwrap();
        assert!(
            matches!(recorder.split(BTreeMap::new()), Err(RecorderError::NotRecording)),
            "one at a time"
        );
        if number == 0 {
            assert!(matches!(outcome(&mut recorder), Outcome::Started { .. }));
        }
        if number == 1 {
            let run = (key::PROTOCOL.to_owned(), "guided".to_owned());
            recorder.note_run(BTreeMap::from([run])).unwrap();
        }
        let Outcome::NextPart { path: next, ended, .. } = outcome(&mut recorder) else { panic!() };
        assert_eq!(next, part_path(&path, number as u32 + 2));
        assert_eq!(ended.unwrap().path, part_path(&path, number as u32 + 1));
        let kept = state::load(states.path(), 5).unwrap().unwrap();
        assert_eq!(kept.part, number as u32 + 2);
    }
    push(&mut recorder, from..6_000);
    recorder.stop().unwrap();
    let Outcome::Stopped(last) = outcome(&mut recorder) else { panic!() };
    assert_eq!(last.written, 1_000 + 250);
    let status = recorder.status();
    assert_eq!((status.written, status.lost), (6_000 + 1_500, 0), "those of all parts");

    let parts: Vec<PathBuf> = (1..=6).map(|part| part_path(&path, part)).collect();
    assert!(!part_path(&path, 7).exists());
    let bounds: Vec<u64> = [0].into_iter().chain(seams).chain([6_000]).collect();
    for (at, part) in parts.iter().enumerate() {
        let own = bounds[at]..bounds[at + 1];
        assert_eq!(sequences(part), own.clone().collect::<Vec<_>>(), "part {}", at + 1);
        let recording = Recording::open(part).unwrap();
        assert!(recording.ended_cleanly());
        assert!(recording.contents().unwrap().is_some(), "it has a summary of its own");
        assert_eq!(recording.metadata(key::PART), Some((at + 1).to_string().as_str()));
        assert_eq!(recording.metadata(key::RIG), Some("cable"));
        assert_eq!(recording.runs().count(), usize::from(at > 1), "a protocol goes on");
        let by = at.checked_sub(1).map(|number| format!("by the {number}"));
        assert_eq!(recording.metadata(key::REPLACED), by.as_deref());
        let samples = own.end - own.start;
        assert_eq!(end_of(part, "sample.received"), samples);
        assert_eq!(end_of(part, "sample.written"), samples);
        assert_eq!((end_of(part, "sample.gaps"), end_of(part, "sample.dropped")), (0, 0));
        let check = recording.check().unwrap();
        assert!(!check.data_lost(), "part {}: {check:?}", at + 1);
        if at > 0 {
            assert_eq!(recording.continues()["sample"].next, own.start);
            assert_eq!(
                recording.metadata(key::STARTED_NS).unwrap(),
                (own.start * SAMPLE_NS).to_string()
            );
        }
    }

    let recordings: Vec<Recording> =
        parts.iter().map(|part| Recording::open(part).unwrap()).collect();
    // In any order.
    let sources: Vec<&Recording> = recordings.iter().rev().collect();
    check_one_session(&sources).unwrap();
    let whole = folder.path().join("whole.mcap");
    let report = rewrite(&sources, None, None, &BTreeMap::new(), &whole).unwrap();
    assert_eq!((report.messages, report.repeated), (7_500, 0));
    assert_eq!(sequences(&whole), (0..6_000).collect::<Vec<_>>());
    assert_eq!(command_sequences(&whole), (0..1_500).collect::<Vec<_>>());
    let whole = Recording::open(&whole).unwrap();
    assert_eq!(whole.runs().count(), 1);
    assert!(whole.ended_cleanly() && !whole.check().unwrap().data_lost());
}

/// Opens real files, once it may.
fn waiting(may: &Arc<AtomicBool>) -> Opener {
    let may = Arc::clone(may);
    Box::new(move |path: &Path, start: &Start, now_ns| {
        while !may.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(1));
        }
        Writer::create(path, start, now_ns)
    })
}

#[test]
fn what_a_full_queue_drops_is_counted_in_its_part() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let may = Arc::new(AtomicBool::new(true));
    let mut recorder = RecorderFrontEnd::with(None, ROOM, waiting(&may)).unwrap();
    recorder.start(request(&path, Split::default())).unwrap();
    assert!(matches!(outcome(&mut recorder), Outcome::Started { .. }));
    let settle = |recorder: &RecorderFrontEnd| {
        while recorder.queued() > 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
    };
    push(&mut recorder, 0..40);
    settle(&recorder);
    // The disk takes its time for the next part.
    may.store(false, Ordering::SeqCst);
    recorder.split(BTreeMap::new()).unwrap();
    push(&mut recorder, 40..1_000);
    may.store(true, Ordering::SeqCst);
    assert!(matches!(outcome(&mut recorder), Outcome::NextPart { .. }));
    settle(&recorder);
    recorder.split(BTreeMap::new()).unwrap();
    assert!(matches!(outcome(&mut recorder), Outcome::NextPart { .. }));
    push(&mut recorder, 1_000..1_040);
    recorder.stop().unwrap();
    assert!(matches!(outcome(&mut recorder), Outcome::Stopped(_)));

    let dropped = recorder.counters(topic("sample")).dropped;
    assert!(dropped > 700, "{dropped}: the queue was never full, and the test says nothing");
    let [first, second, third] = [1, 2, 3].map(|part| part_path(&path, part));
    for (part, expected) in [(&first, 0), (&second, dropped), (&third, 0)] {
        assert_eq!(end_of(part, "sample.dropped"), expected);
        let lost = Recording::open(part).unwrap().check().unwrap();
        assert_eq!(lost.topics.iter().find(|of| of.topic == "sample").unwrap().dropped, expected);
    }
    assert_eq!(end_of(&second, "sample.received"), 960);
    assert_eq!(end_of(&second, "sample.written") + dropped, 960);
    assert_eq!(recorder.status().lost, dropped + recorder.counters(topic("command")).dropped);
    // What was dropped at the end of a part shows in the next one as well.
    let third = Recording::open(&third).unwrap().check().unwrap();
    let sample = third.topics.iter().find(|of| of.topic == "sample").unwrap();
    let last = *sequences(&second).last().unwrap();
    assert_eq!(sample.gaps_before, 1_000 - 1 - last);
}

#[test]
fn a_recording_goes_on_where_the_next_part_cannot_be_begun() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let full = Arc::new(AtomicBool::new(true));
    let no_room = Arc::clone(&full);
    let opener: Opener = Box::new(move |path: &Path, start: &Start, now_ns| {
        if path.ends_with("run.part2.mcap") && no_room.load(Ordering::SeqCst) {
            let source = std::io::ErrorKind::QuotaExceeded.into();
            return Err(WriteError::Create { path: path.to_owned(), source });
        }
        Writer::create(path, start, now_ns)
    });
    let mut recorder = RecorderFrontEnd::with(None, 4 * QUEUE_BYTES, opener).unwrap();
    let split = Split { every_ns: Some(2 * SECOND_NS), ..Split::default() };
    recorder.start(request(&path, split)).unwrap();
    assert!(matches!(outcome(&mut recorder), Outcome::Started { .. }));
    push(&mut recorder, 0..4_000);
    recorder.tick(2 * SECOND_NS);
    assert!(recorder.split_due());
    recorder.split(BTreeMap::new()).unwrap();
    push(&mut recorder, 4_000..5_000);
    let Outcome::NotSplit { error, .. } = outcome(&mut recorder) else { panic!() };
    assert!(error.contains("run.part2.mcap") && error.contains("goes on"), "{error}");
    assert_eq!(recorder.status().error, error);
    assert!(recorder.recording());
    // Not again and again.
    recorder.tick(11 * SECOND_NS);
    assert!(!recorder.split_due());
    push(&mut recorder, 5_000..24_000);
    recorder.tick(12 * SECOND_NS);
    assert!(recorder.split_due());
    full.store(false, Ordering::SeqCst);
    recorder.split(BTreeMap::new()).unwrap();
    assert!(matches!(outcome(&mut recorder), Outcome::NextPart { ended: Ok(_), .. }));
    assert_eq!(recorder.status().error, "", "it is over");
    push(&mut recorder, 24_000..25_000);
    recorder.stop().unwrap();
    assert!(matches!(outcome(&mut recorder), Outcome::Stopped(_)));
    assert_eq!(sequences(&path), (0..24_000).collect::<Vec<_>>());
    assert_eq!(sequences(&part_path(&path, 2)), (24_000..25_000).collect::<Vec<_>>());
    assert_eq!(end_of(&path, "sample.received"), 24_000, "of the part that went on");
    assert_eq!(recorder.status().lost, 0);
}

#[test]
fn a_recording_may_have_any_number_of_parts_and_passes_over_so_many_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    std::fs::write(part_path(&path, 20_000), "somebody's").unwrap();
    let mut recorder = RecorderFrontEnd::new(None).unwrap();
    recorder.start(StartRequest { part: 20_000, ..request(&path, Split::default()) }).unwrap();
    let Outcome::Started { path: begun, .. } = outcome(&mut recorder) else { panic!() };
    assert_eq!(begun, part_path(&path, 20_001));

    let opener: Opener = Box::new(|path: &Path, _: &Start, _: u64| {
        Err(WriteError::Exists { path: path.to_owned() })
    });
    let mut recorder = RecorderFrontEnd::with(None, ROOM, opener).unwrap();
    recorder.start(StartRequest { part: 2, ..request(&path, Split::default()) }).unwrap();
    let Outcome::NotStarted { error } = outcome(&mut recorder) else { panic!() };
    assert!(error.contains("run.part10002.mcap"), "{error}");
}

/// A ring of 2 s in parts of 1 s.
fn ring() -> Split {
    Split { every_ns: Some(SECOND_NS), keep_ns: Some(2 * SECOND_NS), every_bytes: None }
}

#[test]
fn a_ring_that_fills_its_disk_goes_on_as_its_oldest_parts_go() {
    let (folder, states) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let path = folder.path().join("ring.mcap");
    let parts = |folder: &Path| folder.read_dir().unwrap().count();
    // Room for what a ring holds between two parts, and the next one.
    let opener: Opener =
        Box::new(move |path: &Path, start: &Start, now_ns| match parts(path.parent().unwrap()) {
            0..5 => Writer::create(path, start, now_ns),
            _ => Err(WriteError::DiskFull { path: path.to_owned(), refused: 0 }),
        });
    let keep = Some(states.path().to_owned());
    let mut recorder = RecorderFrontEnd::with(keep, QUEUE_BYTES, opener).unwrap();
    recorder.tick(SECOND_NS);
    recorder.start(request(&path, ring())).unwrap();
    assert!(matches!(outcome(&mut recorder), Outcome::Started { .. }));
    for second in 2..20 {
        recorder.tick(second * SECOND_NS);
        recorder.split(BTreeMap::new()).unwrap();
        let next = outcome(&mut recorder);
        assert!(matches!(next, Outcome::NextPart { ended: Ok(_), .. }), "{second} s: {next:?}");
    }
    let kept = state::load(states.path(), 5).unwrap().unwrap();
    let ended = [15_u64, 16, 17, 18].map(|part| (part as u32, (part + 1) * SECOND_NS));
    assert_eq!(kept.ring_parts, ended);

    // Somebody else's data fill it: the oldest go still, and what is kept of the ring is told.
    for number in 0..5 {
        std::fs::write(folder.path().join(number.to_string()), "somebody's").unwrap();
    }
    recorder.tick(30 * SECOND_NS);
    recorder.split(BTreeMap::new()).unwrap();
    let Outcome::NotSplit { error, ring } = outcome(&mut recorder) else { panic!() };
    assert!(error.contains("ring.part20.mcap") && error.contains("the disk is full"), "{error}");
    assert_eq!((ring.numbers, ring.removed), (vec![19], 18));
    assert_eq!(recorder.status().ring.unwrap().parts, [19]);
    let kept = state::load(states.path(), 5).unwrap().unwrap();
    assert_eq!((kept.part, kept.ring_parts), (19, vec![]));
}

/// A disk with room for so many bytes.
struct Small(usize);

impl Write for Small {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        self.0 = self.0.checked_sub(data.len()).ok_or(io::ErrorKind::StorageFull)?;
        Ok(data.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Output for Small {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_part_that_failed_is_told_and_the_next_one_takes_messages_again() {
    let full = Arc::new(AtomicBool::new(true));
    let no_room = Arc::clone(&full);
    let opener: Opener = Box::new(move |path: &Path, start: &Start, now_ns| {
        if path.ends_with("ring.mcap") {
            return Writer::to_output(Box::new(Small(60_000)), path, start, now_ns);
        }
        if no_room.load(Ordering::SeqCst) {
            return Err(WriteError::DiskFull { path: path.to_owned(), refused: 0 });
        }
        Writer::to_output(Box::new(Small(usize::MAX)), path, start, now_ns)
    });
    let mut recorder = RecorderFrontEnd::with(None, QUEUE_BYTES, opener).unwrap();
    let every = Some(1_000 * SECOND_NS);
    let ring = Split { every_ns: every, keep_ns: every, every_bytes: None };
    assert!(!recorder.writing());
    recorder.start(request(Path::new("/x/ring.mcap"), ring)).unwrap();
    assert!(matches!(outcome(&mut recorder), Outcome::Started { .. }));
    assert!(recorder.writing());
    let mut sent = 0;
    let failed = loop {
        push(&mut recorder, sent..sent + 500);
        sent += 500;
        recorder.tick(sent * SAMPLE_NS);
        if let Some(outcome) = recorder.wait(Duration::from_millis(20)) {
            break outcome;
        }
        assert!(sent < 90_000, "the disk never was full");
    };
    assert!(matches!(failed, Outcome::Failed { .. }), "{failed:?}");
    recorder.split(BTreeMap::new()).unwrap();
    let Outcome::NotSplit { error, .. } = outcome(&mut recorder) else { panic!() };
    assert!(error.contains("this one takes nothing any more (the disk is full)"), "{error}");
    assert!(!recorder.writing());
    full.store(false, Ordering::SeqCst);
    recorder.split(BTreeMap::new()).unwrap();
    let Outcome::NextPart { ended, ring, .. } = outcome(&mut recorder) else { panic!() };
    assert!(ended.unwrap_err().contains("the disk is full"));
    assert!(recorder.writing());
    assert_eq!(ring.numbers, [1, 2]);
    assert!(ring.bytes > 10_000, "{ring:?}: what it holds of its first part counts");
    let lost = recorder.status().lost;
    push(&mut recorder, sent..sent + 100);
    recorder.stop().unwrap();
    assert!(!recorder.writing());
    let Outcome::Stopped(last) = outcome(&mut recorder) else { panic!() };
    assert_eq!((last.written, recorder.status().lost), (125, lost));
}

#[test]
fn a_part_is_due_by_time_or_by_size_and_a_restart_keeps_to_it() {
    let (folder, states) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let path = folder.path().join("run.mcap");
    let new = || RecorderFrontEnd::new(Some(states.path().to_owned())).unwrap();
    let mut recorder = new();
    let refused = Split { every_ns: Some(SECOND_NS / 2), ..Split::default() };
    let error = recorder.start(request(&path, refused)).unwrap_err().to_string();
    assert!(error.contains("at least 1 s") && error.contains("found 500ms"), "{error}");
    let refused = Split { every_bytes: Some(999_999), ..Split::default() };
    let error = recorder.start(request(&path, refused)).unwrap_err().to_string();
    assert!(error.contains("found 999999 bytes"), "{error}");

    let split =
        Split { every_ns: Some(1_000 * SECOND_NS), every_bytes: Some(1_000_000), keep_ns: None };
    recorder.tick(SECOND_NS);
    recorder.start(request(&path, split)).unwrap();
    assert!(matches!(outcome(&mut recorder), Outcome::Started { .. }));
    // By size: numbers that do not compress.
    let mut number = 0.5_f64;
    let mut sequence = 0;
    let mut turns = 0;
    while !recorder.split_due() {
        for _ in 0..100 {
            let mut sample = Sample { tick: sequence, ..Sample::default() };
            for volts in &mut sample.analog_v {
                number = (number * 3.99 * (1.0 - number)).clamp(1e-3, 0.999);
                *volts = number;
            }
            sample.stamp(5, 1, sequence, SECOND_NS + sequence * SAMPLE_NS);
            recorder.push(topic("sample"), sample.as_bytes());
            sequence += 1;
        }
        turns += 1;
        // Flushed every 300 ms.
        recorder.tick(SECOND_NS + turns * 400_000_000);
        std::thread::sleep(Duration::from_millis(5));
        assert!(turns < 2_000, "never as large as that");
    }
    recorder.split(BTreeMap::new()).unwrap();
    assert!(!recorder.split_due());
    let Outcome::NextPart { ended, .. } = outcome(&mut recorder) else { panic!() };
    assert!(ended.unwrap().bytes >= 1_000_000);
    assert!(!recorder.split_due(), "the next part is small");
    // By time, since this part began.
    let began_ns = SECOND_NS + turns * 400_000_000;
    recorder.tick(began_ns + 1_000 * SECOND_NS - 1);
    assert!(!recorder.split_due());
    recorder.tick(began_ns + 1_000 * SECOND_NS);
    assert!(recorder.split_due());
    drop(recorder);

    let kept = state::load(states.path(), 5).unwrap().unwrap();
    assert_eq!((kept.part, kept.split), (2, split));
    let mut recorder = new();
    recorder.tick(5_000 * SECOND_NS);
    recorder.start(kept.next_part(BTreeMap::new())).unwrap();
    let Outcome::Started { path: third, .. } = outcome(&mut recorder) else { panic!() };
    assert_eq!(third, part_path(&path, 3));
    recorder.tick(5_999 * SECOND_NS);
    assert!(!recorder.split_due());
    recorder.tick(6_000 * SECOND_NS);
    assert!(recorder.split_due());
}
