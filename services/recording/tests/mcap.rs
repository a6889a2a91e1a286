//! Recordings written, torn, damaged and read back.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::fs;
use std::path::Path;

use common::{OFFSET, Tiny, command, fill, sample, samples, start, write_file};
use ipc_types::{COMMAND, LossCounters, Message, MotorCommand, SAMPLE, Sample, TOPICS};
use proptest::prelude::*;
use recording::mcap_read::{ReadError, Recording, Selection};
use recording::mcap_write::{FLUSH_NS, SYNC_NS, WriteError, Writer, key};

#[test]
fn what_was_written_is_read_back_bit_by_bit_with_times_and_metadata() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut writer = Writer::create(&path, &start(), 7).unwrap();
    fill(&mut writer, 5000);
    let losses =
        [LossCounters { topic: 0, received: 5000, gaps: 0, dropped: 0, ..LossCounters::default() }];
    let summary = writer.finish(&losses).unwrap();
    assert_eq!((summary.written, summary.refused), (5000 + 1250 + 5, 0));
    assert_eq!(summary.bytes, fs::metadata(&path).unwrap().len());

    let recording = Recording::open(&path).unwrap();
    assert!(recording.ended_cleanly());
    assert_eq!(recording.realtime_offset_ns(), Some(OFFSET));
    assert_eq!(recording.metadata(key::RIG_FILE), Some("[rig]\nname = \"hydrostatic\" # ä µ\n"));
    assert_eq!(recording.metadata(key::STARTED_NS), Some("7"));
    assert_eq!(recording.end_record().unwrap()["sample.received"], "5000");
    assert_eq!(recording.channels.len(), TOPICS.len());
    for (i, recorded) in recording.messages::<Sample>("sample").unwrap().enumerate() {
        let recorded = recorded.unwrap();
        assert_eq!(recorded.message.as_bytes(), sample(i as u64).as_bytes());
        assert_eq!(recorded.log_time_ns, sample(i as u64).time_ns + OFFSET as u64);
    }
    let commands: Vec<_> = recording
        .messages::<MotorCommand>("command")
        .unwrap()
        .map(|r| r.unwrap().message)
        .collect();
    assert_eq!(commands, (0..1250).map(command).collect::<Vec<_>>());

    let check = recording.check().unwrap();
    assert!(!check.data_lost());
    let of = |name: &str| check.topics.iter().find(|t| t.topic == name).unwrap().clone();
    assert_eq!(
        (of("sample").count, of("command").count, of("event/control").count, of("token").count),
        (5000, 1250, 5, 0)
    );
    assert!((of("sample").rate_hz().unwrap() - 2000.0).abs() < 0.01);
    assert_eq!(check.ticks.unwrap().last, 5999);
}

#[test]
fn flush_and_sync_follow_the_time_that_they_are_told() {
    let out = Tiny { room: usize::MAX, ..Tiny::default() };
    let mut writer = Writer::to_output(Box::new(out.clone()), Path::new("x"), &start(), 0).unwrap();
    let begun = out.bytes.lock().unwrap().len();
    writer.write_message(&SAMPLE, &sample(0)).unwrap();
    writer.tick(FLUSH_NS - 1).unwrap();
    assert_eq!(out.bytes.lock().unwrap().len(), begun);
    writer.tick(FLUSH_NS).unwrap();
    assert!(out.bytes.lock().unwrap().len() > begun);
    assert_eq!(*out.syncs.lock().unwrap(), 0);
    writer.tick(SYNC_NS).unwrap();
    assert_eq!(*out.syncs.lock().unwrap(), 1);
}

#[test]
fn an_existing_file_is_never_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    fs::write(&path, "precious").unwrap();
    let error = Writer::create(&path, &start(), 0).unwrap_err();
    assert!(matches!(error, WriteError::Exists { .. }), "{error}");
    assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    let error = Writer::create(&dir.path().join("no/such/run.mcap"), &start(), 0).unwrap_err();
    assert!(matches!(error, WriteError::Create { .. }), "{error}");
}

#[test]
fn a_message_of_another_build_is_refused_alone() {
    let out = Tiny { room: usize::MAX, ..Tiny::default() };
    let mut writer = Writer::to_output(Box::new(out), Path::new("x"), &start(), 0).unwrap();
    assert!(matches!(
        writer.write(0, &[0; 16]),
        Err(WriteError::Length { topic: "sample", found: 16, .. })
    ));
    assert!(matches!(writer.write(TOPICS.len(), &[0; 16]), Err(WriteError::Topic { .. })));
    writer.write_message(&SAMPLE, &sample(0)).unwrap();
    assert_eq!((writer.written(), writer.refused(), writer.refused_of(0)), (1, 2, 1));
}

#[test]
fn a_full_disk_is_reported_once_and_leaves_what_was_flushed() {
    let dir = tempfile::tempdir().unwrap();
    let mut seen_full = 0;
    for room in (0..400_000).step_by(23_456) {
        let out = Tiny { room, ..Tiny::default() };
        let offered = 4000u64;
        let mut refused = 0;
        match Writer::to_output(Box::new(out.clone()), Path::new("x"), &start(), sample(0).time_ns)
        {
            Err(error) => assert!(matches!(error, WriteError::DiskFull { .. }), "{error}"),
            Ok(mut writer) => {
                for i in 0..offered {
                    let _ = writer.write_message(&SAMPLE, &sample(i));
                    let _ = writer.tick(sample(i).time_ns);
                }
                let taken = writer.written();
                refused = writer.refused();
                assert_eq!(taken + refused, offered, "every message is either taken or refused");
                match writer.finish(&[]) {
                    Ok(_) => assert_eq!(refused, 0),
                    Err(
                        WriteError::DiskFull { refused: r, .. }
                        | WriteError::Poisoned { refused: r, .. },
                    ) => {
                        seen_full += 1;
                        refused = r;
                    }
                    Err(other) => panic!("{other}"),
                }
            }
        }
        let bytes = out.bytes.lock().unwrap().clone();
        let path = dir.path().join(format!("{room}.mcap"));
        fs::write(&path, &bytes).unwrap();
        match Recording::open(&path) {
            Ok(recording) if !recording.channels.is_empty() => {
                let found = samples(&recording);
                assert!(found.iter().enumerate().all(|(i, s)| *s == sample(i as u64)));
                assert!(
                    found.len() as u64 + refused >= offered,
                    "{room}: {} found, {refused} refused",
                    found.len()
                );
            }
            Ok(_) | Err(ReadError::Empty { .. } | ReadError::NotMcap { .. }) => {
                assert!(room < 50_000, "{room}")
            }
            Err(other) => panic!("{other}"),
        }
    }
    assert!(seen_full >= 5, "{seen_full}");
}

#[test]
fn a_killed_logger_leaves_everything_up_to_the_last_flush() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut writer = Writer::create(&path, &start(), sample(0).time_ns).unwrap();
    for i in 0..3000 {
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
        writer.tick(sample(i).time_ns).unwrap();
    }
    // The writer still lives: the file is growing, and nothing is lost.
    let growing = Recording::open(&path).unwrap();
    assert!(growing.tail.being_written && !growing.tail.complete);
    assert!(growing.tail.reason.contains("still being written"));
    assert!(!growing.check().unwrap().data_lost());
    // What SIGKILL leaves: the file as it is, without the writer's lock.
    let killed = dir.path().join("killed.mcap");
    fs::copy(&path, &killed).unwrap();
    let recording = Recording::open(&killed).unwrap();
    assert!(!recording.ended_cleanly() && !recording.tail.complete);
    let found = samples(&recording);
    assert_eq!(found, (0..found.len() as u64).map(sample).collect::<Vec<_>>());
    let flush_samples = (FLUSH_NS / common::PERIOD_NS) as usize;
    assert!(found.len() > 3000 - flush_samples - 1, "{}", found.len());
    assert!(!recording.tail.being_written);
    assert!(recording.check().unwrap().data_lost());
}

#[test]
fn a_file_cut_anywhere_reads_as_a_prefix() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole.mcap");
    write_file(&whole, 3000);
    let bytes = fs::read(&whole).unwrap();
    let path = dir.path().join("cut.mcap");
    let mut longest = 0;
    // every byte near both ends, a prime stride between
    let places =
        (0..200).chain((200..bytes.len()).step_by(1009)).chain(bytes.len() - 200..bytes.len());
    for place in places {
        fs::write(&path, &bytes[..place]).unwrap();
        let recording = match Recording::open(&path) {
            Ok(recording) => recording,
            Err(ReadError::Empty { .. }) if place == 0 => continue,
            Err(ReadError::NotMcap { .. }) if place < 8 => continue,
            Err(other) => panic!("{place}: {other}"),
        };
        assert!(!recording.tail.complete, "{place}");
        assert_eq!(recording.tail.readable + recording.tail.lost, place as u64);
        assert!(!recording.tail.reason.is_empty());
        if recording.channels_of("sample").is_err() {
            continue;
        }
        let found = samples(&recording);
        assert!(found.iter().enumerate().all(|(i, s)| *s == sample(i as u64)), "{place}");
        assert!(found.len() >= longest || place < 200, "{place}");
        longest = longest.max(found.len());
    }
    assert_eq!(longest, 3000);
}

/// Where records of a kind begin.
fn records_of(bytes: &[u8], opcode: u8) -> Vec<usize> {
    let mut at = 8;
    let mut found = Vec::new();
    while at + 9 <= bytes.len() - 8 {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap());
        if bytes[at] == opcode {
            found.push(at);
        }
        at += 9 + length as usize;
    }
    found
}

#[test]
fn a_file_cut_within_the_indices_of_its_last_chunk_hides_none_of_its_messages() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole.mcap");
    write_file(&whole, 3000);
    let bytes = fs::read(&whole).unwrap();
    let path = dir.path().join("cut.mcap");
    let indices = records_of(&bytes, 7);
    assert!(indices.len() > 3, "{indices:?}");
    for place in indices.into_iter().flat_map(|index| [index, index + 5]) {
        fs::write(&path, &bytes[..place]).unwrap();
        let recording = Recording::open(&path).unwrap();
        // The check reads every chunk, whatever its indices say.
        let check = recording.check().unwrap();
        let counted =
            |topic: &str| check.topics.iter().find(|found| found.topic == topic).unwrap().count;
        let read = recording.messages::<MotorCommand>("command").unwrap().count() as u64;
        assert_eq!(
            (samples(&recording).len() as u64, read),
            (counted("sample"), counted("command")),
            "{place}"
        );
    }
}

#[test]
fn zeros_after_the_data_are_a_torn_tail() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 2000);
    let bytes = fs::read(&path).unwrap();
    let mut torn = bytes[..bytes.len() - 3000].to_vec();
    torn.extend_from_slice(&[0; 8192]);
    fs::write(&path, torn).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert!(!recording.tail.complete && recording.tail.lost > 0);
    let found = samples(&recording);
    assert!(!found.is_empty() && found.iter().enumerate().all(|(i, s)| *s == sample(i as u64)));
}

#[test]
fn a_file_that_is_no_recording_is_reported_as_such() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.mcap");
    assert!(matches!(Recording::open(&path), Err(ReadError::Io { .. })));
    assert!(matches!(Recording::open(dir.path()), Err(ReadError::Io { .. })));
    fs::write(&path, "").unwrap();
    assert!(matches!(Recording::open(&path), Err(ReadError::Empty { .. })));
    fs::write(&path, "t_s,motor_v\n0,1\n").unwrap();
    let error = Recording::open(&path).unwrap_err();
    assert!(error.to_string().contains("not an MCAP file"), "{error}");
    write_file(&dir.path().join("run.mcap"), 10);
    let recording = Recording::open(&dir.path().join("run.mcap")).unwrap();
    let error = recording.messages::<Sample>("smaple").unwrap_err().to_string();
    assert!(error.contains("smaple") && error.contains("sample"), "{error}");
}

#[test]
fn gaps_and_duplicates_are_counted_per_incarnation() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut writer = Writer::create(&path, &start(), 0).unwrap();
    for i in (0..100).chain(110..200).chain([199]) {
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
    }
    for i in 0..50 {
        let mut s = sample(200 + i);
        s.stamp(11, 99, i, s.time_ns);
        writer.write_message(&SAMPLE, &s).unwrap();
    }
    let losses = LossCounters { dropped: 3, ..LossCounters::default() };
    writer.finish(&[losses]).unwrap();
    let check = Recording::open(&path).unwrap().check().unwrap();
    let of = check.topics.iter().find(|t| t.topic == "sample").unwrap();
    assert_eq!((of.gaps, of.gap_places, of.duplicates, of.incarnations), (10, 1, 1, 2));
    assert_eq!(of.dropped, 3);
    let ticks = check.ticks.unwrap();
    assert_eq!((ticks.first, ticks.last), (sample(0).tick, sample(249).tick));
    assert_eq!((ticks.missing, ticks.holes, ticks.backwards), (10, 1, 1));
    assert!(check.data_lost());
}

#[test]
fn a_selection_reads_only_its_channels_and_times() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 4000);
    let recording = Recording::open(&path).unwrap();
    let ids = recording.channels_of("command").unwrap();
    let at = |i: u64| sample(i).time_ns + OFFSET as u64;
    let selection = Selection {
        channels: Some(ids.clone()),
        from_ns: Some(at(1000)),
        until_ns: Some(at(2000)),
    };
    let found: Vec<_> = recording.raw(selection).map(Result::unwrap).collect();
    assert!(
        found
            .iter()
            .all(|m| ids.contains(&m.channel_id())
                && (at(1000)..at(2000)).contains(&m.log_time_ns()))
    );
    assert_eq!(found.len(), 250);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_bytes_survive(
        messages in prop::collection::vec((0..TOPICS.len(), any::<u64>()), 1..200)
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.mcap");
        let mut writer = Writer::create(&path, &start(), 0).unwrap();
        let mut offered = Vec::new();
        for (topic, mut seed) in messages {
            let bytes: Vec<u8> = (0..TOPICS[topic].size).map(|_| {
                seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (seed >> 56) as u8
            }).collect();
            writer.write(topic, &bytes).unwrap();
            offered.push((TOPICS[topic].name, bytes));
        }
        writer.finish(&[]).unwrap();
        let recording = Recording::open(&path).unwrap();
        let found: Vec<_> = recording.raw(Selection::default()).map(|m| {
            let m = m.unwrap();
            let (_, body) = recording.decode(&m).unwrap();
            (recording.channel(&m).unwrap().topic.clone(), body.to_vec())
        }).collect();
        prop_assert_eq!(found.len(), offered.len());
        for (found, offered) in found.iter().zip(&offered) {
            prop_assert_eq!(found.0.as_str(), offered.0);
            prop_assert_eq!(&found.1, &offered.1);
        }
    }

    #[test]
    fn a_damaged_file_never_panics_and_never_lies(
        at in any::<prop::sample::Index>(),
        flip in 1u8..,
        more in any::<prop::sample::Index>(),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.mcap");
        write_file(&path, 1500);
        let mut bytes = fs::read(&path).unwrap();
        let length = bytes.len();
        bytes[at.index(length)] ^= flip;
        bytes[more.index(length)] ^= flip.rotate_left(3);
        fs::write(&path, &bytes).unwrap();
        if let Ok(recording) = Recording::open(&path) {
            let said = recording.check().unwrap().data_lost();
            let found = recording
                .messages::<Sample>("sample")
                .map(|found| found.flatten().collect::<Vec<_>>());
            for found in found.iter().flatten() {
                // payloads lie within checksummed chunks: what is read is what was written
                let written = sample(found.message.sequence);
                prop_assert_eq!(found.message.as_bytes(), written.as_bytes());
            }
            if !said {
                // and where nothing is said to be missing, all of it is there
                prop_assert_eq!(found.map(|found| found.len()).ok(), Some(1500));
                let expected = start();
                prop_assert_eq!(
                    recording.metadata(key::RIG_FILE),
                    expected.metadata.get(key::RIG_FILE).map(String::as_str)
                );
            }
        }
    }
}

#[test]
fn a_damaged_summary_makes_no_topic_another_and_hides_no_chunk() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 300);
    let sound = fs::read(&path).unwrap();
    let whole = Recording::open(&path).unwrap();
    assert_eq!((whole.damage.len(), whole.check().unwrap().data_lost()), (0, false));
    let written = samples(&whole);
    // the footer stands before the end mark: opcode, length, start of the summary, start of its
    // offsets, checksum
    let footer = sound.len() - 8 - 29;
    let begin = u64::from_le_bytes(sound[footer + 9..footer + 17].try_into().unwrap()) as usize;
    assert!(begin > 0 && begin < footer);
    for at in (begin..sound.len()).step_by(23) {
        let mut bytes = sound.clone();
        bytes[at] ^= 1;
        fs::write(&path, &bytes).unwrap();
        let recording = Recording::open(&path).unwrap();
        assert_eq!(samples(&recording), written, "byte {at}");
        assert!(recording.check().unwrap().data_lost(), "byte {at}");
        assert_eq!(recording.channels.len(), TOPICS.len(), "byte {at}");
    }
}

#[test]
fn records_outside_chunks_are_covered_by_the_checksum_of_all_data() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 300);
    let mut bytes = fs::read(&path).unwrap();
    // in the header, which names the program that wrote the file
    let at = bytes.windows(8).position(|w| w == b"farreach").unwrap();
    bytes[at] = b'F';
    fs::write(&path, &bytes).unwrap();
    let check = Recording::open(&path).unwrap().check().unwrap();
    assert!(
        check.damage.iter().any(|d| d.what.contains("checksum of all data")),
        "{:?}",
        check.damage
    );
    assert!(check.data_lost());
}

#[test]
fn commands_keep_their_place_between_samples() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 40);
    let recording = Recording::open(&path).unwrap();
    let names: Vec<_> = recording
        .raw(Selection::default())
        .map(|m| recording.channel(&m.unwrap()).unwrap().topic.clone())
        .filter(|name| name == SAMPLE.topic.name || name == COMMAND.topic.name)
        .collect();
    assert_eq!(names.iter().filter(|n| *n == "command").count(), 10);
    assert_eq!(names[..3], ["sample", "command", "sample"]);
}
