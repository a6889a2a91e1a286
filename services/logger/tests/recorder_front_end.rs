//! The logger's core without shared memory: nothing is lost that is not counted.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ipc_types::{Message, Sample};
use logger::recorder_front_end::{Outcome, RecorderError, RecorderFrontEnd, StartRequest};
use logger::{QUEUE_HEADER_BYTES, state};
use recording::mcap_read::Recording;
use recording::mcap_write::{FLUSH_NS, Output, Positions, SYNC_NS, Start, Writer, key};

/// Far beyond anything that a working machine needs; it only keeps a broken test from hanging.
const LONG: Duration = Duration::from_secs(60);

fn sample(incarnation: u64, sequence: u64) -> Sample {
    let mut s = Sample { tick: sequence, axes: 1, ..Sample::default() };
    s.stamp(5, incarnation, sequence, sequence * 500_000);
    s
}

fn push(
    recorder: &mut RecorderFrontEnd,
    incarnation: u64,
    sequences: impl IntoIterator<Item = u64>,
) {
    for sequence in sequences {
        recorder.push(0, sample(incarnation, sequence).as_bytes());
    }
}

fn request(path: &Path) -> StartRequest {
    StartRequest {
        path: path.to_owned(),
        session: 5,
        realtime_offset_ns: 1_000,
        ..StartRequest::default()
    }
}

fn started(recorder: &mut RecorderFrontEnd) -> PathBuf {
    match recorder.wait(LONG).unwrap() {
        Outcome::Started { path, .. } => path,
        other => panic!("{other:?}"),
    }
}

fn sequences(path: &Path) -> Vec<u64> {
    let recording = Recording::open(path).unwrap();
    recording.messages::<Sample>("sample").unwrap().map(|r| r.unwrap().message.sequence).collect()
}

#[test]
fn what_is_pushed_between_start_and_stop_is_in_the_file_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut recorder = RecorderFrontEnd::new(None).unwrap();
    push(&mut recorder, 1, 0..100);
    recorder.start(request(&path)).unwrap();
    // at once, before the file is there
    push(&mut recorder, 1, 100..5000);
    recorder.stop().unwrap();
    push(&mut recorder, 1, 5000..5100);
    assert_eq!(started(&mut recorder), path);
    let Some(Outcome::Stopped(summary)) = recorder.wait(LONG) else { panic!("not stopped") };
    assert_eq!((summary.written, summary.refused), (4900, 0));
    assert_eq!(sequences(&path), (100..5000).collect::<Vec<_>>());
    let counters = recorder.counters(0);
    assert_eq!(
        (counters.received, counters.gaps, counters.dropped, counters.written),
        (5100, 0, 0, 4900)
    );
    let recording = Recording::open(&path).unwrap();
    assert!(recording.ended_cleanly());
    assert_eq!(recording.end_record().unwrap()["sample.received"], "4900");
    assert!(!recorder.recording());
}

#[test]
fn one_recording_after_another_and_never_two() {
    let dir = tempfile::tempdir().unwrap();
    let mut recorder = RecorderFrontEnd::new(None).unwrap();
    assert!(matches!(recorder.stop(), Err(RecorderError::NotRecording)));
    assert!(matches!(
        recorder.start(request(Path::new("run.mcap"))),
        Err(RecorderError::RelativePath { .. })
    ));
    for round in 0..3u64 {
        let path = dir.path().join(format!("{round}.mcap"));
        recorder.start(request(&path)).unwrap();
        assert!(matches!(recorder.start(request(&path)), Err(RecorderError::Recording { .. })));
        push(&mut recorder, 1, round * 50..round * 50 + 50);
        recorder.stop().unwrap();
        started(&mut recorder);
        assert!(matches!(recorder.wait(LONG), Some(Outcome::Stopped(_))));
        assert_eq!(sequences(&path), (round * 50..round * 50 + 50).collect::<Vec<_>>());
        assert_eq!(recorder.status().written, 50);
    }
    recorder.start(request(&dir.path().join("1.mcap"))).unwrap();
    assert!(matches!(recorder.wait(LONG), Some(Outcome::NotStarted { .. })));
    assert!(!recorder.recording());
    assert!(recorder.status().error.contains("never overwritten"), "{}", recorder.status().error);
}

#[test]
fn gaps_duplicates_and_new_incarnations_are_told_apart() {
    let mut recorder = RecorderFrontEnd::new(None).unwrap();
    push(&mut recorder, 1, (10..20).chain(25..30).chain([29]));
    push(&mut recorder, 2, 0..10);
    push(&mut recorder, 3, 2..4);
    recorder.push(9_999, &[0; 40]);
    let counters = recorder.counters(0);
    assert_eq!((counters.received, counters.gaps, counters.topic), (28, 7, 0));
    assert_eq!(recorder.unknown(), 1);
}

/// An output that stands still while told to, and is full after so many bytes.
#[derive(Clone, Default)]
struct Gate {
    blocked: Arc<AtomicBool>,
    room: Option<usize>,
    bytes: Arc<Mutex<Vec<u8>>>,
    syncs: Arc<AtomicU64>,
}

impl Write for Gate {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        while self.blocked.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(1));
        }
        let mut bytes = self.bytes.lock().unwrap();
        if self.room.is_some_and(|room| bytes.len() + data.len() > room) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        bytes.extend_from_slice(data);
        Ok(data.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Output for Gate {
    fn sync(&mut self) -> io::Result<()> {
        self.syncs.fetch_add(1, Ordering::SeqCst);
        Ok(())
    }
}

/// With room for so many samples on their way.
fn gated(gate: &Gate, samples: usize) -> RecorderFrontEnd {
    let gate = gate.clone();
    let opener = move |path: &Path, start: &Start, now: u64| {
        Writer::to_output(Box::new(gate.clone()), path, start, now)
    };
    let queue_bytes = samples * (size_of::<Sample>() + QUEUE_HEADER_BYTES);
    RecorderFrontEnd::with(None, queue_bytes, Box::new(opener)).unwrap()
}

#[test]
fn a_disk_that_stands_still_costs_what_the_queue_cannot_hold_and_that_is_counted() {
    let gate = Gate::default();
    let mut recorder = gated(&gate, 64);
    gate.blocked.store(true, Ordering::SeqCst);
    recorder.start(request(Path::new("/x/run.mcap"))).unwrap();
    push(&mut recorder, 1, 0..1000);
    let lost = recorder.counters(0).dropped;
    assert!((936 - 64..=936).contains(&lost), "{lost}");
    gate.blocked.store(false, Ordering::SeqCst);
    recorder.stop().unwrap();
    started(&mut recorder);
    let Some(Outcome::Stopped(summary)) = recorder.wait(LONG) else { panic!("not stopped") };
    assert_eq!(summary.written + lost, 1000);
    assert_eq!(recorder.status().lost, lost);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.mcap");
    std::fs::write(&path, &*gate.bytes.lock().unwrap()).unwrap();
    let check = Recording::open(&path).unwrap().check().unwrap();
    assert!(check.data_lost(), "the file itself says that messages were dropped");
}

#[test]
fn a_full_disk_is_reported_once_and_what_it_refuses_is_counted() {
    let gate = Gate { room: Some(60_000), ..Gate::default() };
    let mut recorder = gated(&gate, 100_000);
    recorder.start(request(Path::new("/x/run.mcap"))).unwrap();
    started(&mut recorder);
    let mut sent = 0;
    let outcome = loop {
        push(&mut recorder, 1, sent..sent + 500);
        sent += 500;
        recorder.tick(sent * 500_000);
        if let Some(outcome) = recorder.wait(Duration::from_millis(20)) {
            break outcome;
        }
        assert!(sent < 90_000, "the disk never was full");
    };
    assert!(matches!(outcome, Outcome::Failed { .. }), "{outcome:?}");
    assert!(recorder.status().error.contains("disk is full"));
    assert!(recorder.recording() && !recorder.writing(), "it takes nothing");
    push(&mut recorder, 1, sent..sent + 100);
    sent += 100;
    recorder.stop().unwrap();
    let Some(Outcome::StoppedWithError { refused, .. }) = recorder.wait(LONG) else {
        panic!("no error")
    };
    assert_eq!(recorder.status().written + refused, sent, "every message is written or refused");
    assert!(!recorder.recording());
}

#[test]
fn flush_and_sync_follow_the_loops_time() {
    let gate = Gate::default();
    let mut recorder = gated(&gate, 1000);
    recorder.start(request(Path::new("/x/run.mcap"))).unwrap();
    started(&mut recorder);
    let begun = gate.bytes.lock().unwrap().len();
    push(&mut recorder, 1, 0..10);
    let wait_for = |what: &dyn Fn() -> bool| {
        let mut left = 10_000;
        while !what() && left > 0 {
            std::thread::sleep(Duration::from_millis(1));
            left -= 1;
        }
        assert!(what());
    };
    wait_for(&|| recorder.queued() == 0);
    recorder.tick(FLUSH_NS);
    wait_for(&|| gate.bytes.lock().unwrap().len() > begun);
    assert_eq!(gate.syncs.load(Ordering::SeqCst), 0);
    recorder.tick(SYNC_NS);
    wait_for(&|| gate.syncs.load(Ordering::SeqCst) == 1);
}

#[test]
fn a_restarted_logger_continues_with_the_next_part() {
    let dir = tempfile::tempdir().unwrap();
    let states = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let keep = || Some(states.path().to_owned());
    let mut recorder = RecorderFrontEnd::new(keep()).unwrap();
    let mut first = request(&path);
    first.metadata.insert(key::RIG.to_owned(), "cable".to_owned());
    recorder.start(first).unwrap();
    push(&mut recorder, 1, 0..100);
    started(&mut recorder);
    // the process ends without a stop: systemd, an upgrade
    drop(recorder);
    assert_eq!(state::load(states.path(), 6).unwrap(), None, "another session does not go on");
    for part in 2..4u64 {
        let kept = state::load(states.path(), 5).unwrap().unwrap();
        assert_eq!(kept.part as u64, part - 1);
        let mut recorder = RecorderFrontEnd::new(keep()).unwrap();
        recorder.start(StartRequest::next_part(kept, Positions::new())).unwrap();
        push(&mut recorder, 1, part * 100..part * 100 + 100);
        assert_eq!(started(&mut recorder), dir.path().join(format!("run.part{part}.mcap")));
        if part == 3 {
            recorder.stop().unwrap();
            assert!(matches!(recorder.wait(LONG), Some(Outcome::Stopped(_))));
        }
    }
    assert_eq!(state::load(states.path(), 5).unwrap(), None, "a stopped recording is over");
    let second = Recording::open(&dir.path().join("run.part2.mcap")).unwrap();
    assert_eq!((second.metadata(key::PART), second.metadata(key::RIG)), (Some("2"), Some("cable")));
    assert_eq!(second.realtime_offset_ns(), Some(1_000));
    assert_eq!(sequences(&path), (0..100).collect::<Vec<_>>());
}

/// A recording whose logger is killed after the messages 0 to 99, continued by another logger that
/// gets `received`; its second part.
fn continued(
    received: impl IntoIterator<Item = u64>,
) -> (tempfile::TempDir, RecorderFrontEnd, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut recorder = RecorderFrontEnd::new(Some(dir.path().to_owned())).unwrap();
    recorder.tick(10);
    recorder.start(request(&path)).unwrap();
    push(&mut recorder, 1, 0..100);
    started(&mut recorder);
    drop(recorder);
    let kept = state::load(dir.path(), 5).unwrap().unwrap();
    let positions = Recording::open(&path).unwrap().end_positions().unwrap();
    let mut recorder = RecorderFrontEnd::new(Some(dir.path().to_owned())).unwrap();
    recorder.tick(200 * 500_000);
    recorder.start(StartRequest::next_part(kept, positions)).unwrap();
    push(&mut recorder, 1, received);
    let part = started(&mut recorder);
    (dir, recorder, part)
}

#[test]
fn messages_lost_over_a_restart_count_live_and_in_the_file() {
    let (_dir, mut recorder, part) = continued(150..400);
    assert_eq!((recorder.counters(0).gaps, recorder.status().lost), (50, 50));
    recorder.stop().unwrap();
    assert!(matches!(recorder.wait(LONG), Some(Outcome::Stopped(_))));
    assert_eq!(recorder.status().lost, 50);
    let part = Recording::open(&part).unwrap();
    assert_eq!(part.end_record().unwrap()["sample.gaps"], "50");
    let check = part.check().unwrap();
    let of = check.topics.iter().find(|topic| topic.topic == "sample").unwrap();
    assert_eq!((of.count, of.gaps, of.gaps_before, of.duplicates), (250, 50, 50, 0));
    assert!(check.data_lost());
    // the next part continues from here
    let positions = part.end_positions().unwrap();
    assert_eq!((positions["sample"].incarnation, positions["sample"].next), (1, 400));
}

#[test]
fn history_that_the_part_before_holds_is_not_repeated() {
    let (_dir, mut recorder, part) = continued(90..400);
    recorder.stop().unwrap();
    assert!(matches!(recorder.wait(LONG), Some(Outcome::Stopped(_))));
    assert_eq!(recorder.status().lost, 0);
    // those published while no logger was there are in
    assert_eq!(sequences(&part), (100..400).collect::<Vec<_>>());
    let check = Recording::open(&part).unwrap().check().unwrap();
    assert!(!check.data_lost() && check.topics.iter().all(|topic| topic.duplicates == 0));
}

#[test]
fn what_happened_before_a_recording_is_not_in_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut recorder = RecorderFrontEnd::new(None).unwrap();
    recorder.tick(50 * 500_000);
    recorder.start(request(&path)).unwrap();
    push(&mut recorder, 1, 40..60);
    recorder.stop().unwrap();
    started(&mut recorder);
    assert!(matches!(recorder.wait(LONG), Some(Outcome::Stopped(_))));
    assert_eq!(sequences(&path), (50..60).collect::<Vec<_>>());
    assert_eq!(recorder.status().lost, 0);
}

#[test]
fn protocols_and_subjects_are_in_the_recording_and_in_its_next_part() {
    let run = |subject: &str| {
        [(key::PROTOCOL, "guided"), (key::PROTOCOL_FILE, "[[segments]]\n"), (key::SUBJECT, subject)]
            .map(|(key, value)| (key.to_owned(), value.to_owned()))
            .into()
    };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut recorder = RecorderFrontEnd::new(Some(dir.path().to_owned())).unwrap();
    recorder.note_run(run("S01")).unwrap(); // nothing is being recorded
    recorder.start(request(&path)).unwrap();
    started(&mut recorder);
    push(&mut recorder, 1, 0..10);
    recorder.note_run(run("S02")).unwrap();
    recorder.note_run(Default::default()).unwrap(); // it ended
    recorder.note_run(run("S03")).unwrap();
    drop(recorder);
    let subjects = |path: &Path| {
        let recording = Recording::open(path).unwrap();
        assert!(recording.runs().all(|run| run[key::PROTOCOL_FILE] == "[[segments]]\n"));
        recording.runs().map(|run| run[key::SUBJECT].clone()).collect::<Vec<_>>()
    };
    assert_eq!(subjects(&path), ["S02", "S03"]);
    let kept = state::load(dir.path(), 5).unwrap().unwrap();
    let mut recorder = RecorderFrontEnd::new(Some(dir.path().to_owned())).unwrap();
    recorder.start(StartRequest::next_part(kept, Positions::new())).unwrap();
    let part = started(&mut recorder);
    drop(recorder);
    assert_eq!(subjects(&part), ["S03"]);
}
