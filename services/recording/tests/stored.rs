//! A record whose columns are on disk is that in memory, with the same findings.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;

use common::{PERIOD_NS, sample, start};
use ipc_types::{CardKind, Message, SAMPLE, Sample};
use recording::column::Storage;
use recording::mcap_read::Recording;
use recording::mcap_write::Writer;
use recording::record::{
    ColumnNames, FindingKind, Gaps, Options, SampleColumns, from_recording, table_from_recording,
    write_csv,
};

fn write(path: &Path, samples: impl Iterator<Item = Sample>) -> Recording {
    let mut writer = Writer::create(path, &start(), 0).unwrap();
    for (number, mut sample) in (0..).zip(samples) {
        let time_ns = sample.scan_time_ns + 80_000;
        let incarnation = sample.incarnation.max(22);
        sample.stamp(11, incarnation, number, time_ns);
        writer.write_message(&SAMPLE, &sample).unwrap();
    }
    writer.finish(&[]).unwrap();
    Recording::open(path).unwrap()
}

/// Both records as text, or both errors; and the kinds of findings.
fn both(recording: &Recording, gaps: Gaps) -> Result<Vec<FindingKind>, String> {
    let mut columns = SampleColumns::new(ColumnNames::rotary());
    columns.analog = vec![(1, "input_v".to_owned())];
    let options = Options::default().gaps(gaps);
    let folder = tempfile::tempdir().unwrap();
    let storage = Storage::Folder(folder.path().to_owned());
    let in_memory = from_recording(recording, &columns, &options);
    let on_disk = table_from_recording(recording, &columns, &options, &storage);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "files have no names");
    match (in_memory, on_disk) {
        (Ok(record), Ok(table)) => {
            assert_eq!(record.findings, table.findings);
            let (mut expected, mut found) = (Vec::new(), Vec::new());
            write_csv(&record, &mut expected).unwrap();
            table.write_csv(&mut found).unwrap();
            assert!(expected.len() > 100_000 && expected == found);
            Ok(record.findings.iter().map(|finding| finding.kind).collect())
        }
        (Err(expected), Err(found)) => {
            assert_eq!(expected.to_string(), found.to_string());
            Err(found.to_string())
        }
        (in_memory, on_disk) => panic!("{:?} {:?}", in_memory.err(), on_disk.err()),
    }
}

#[test]
fn on_disk_and_in_memory_are_the_same() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let whole = write(&path("whole.mcap"), (0..30_000).map(sample));
    assert_eq!(both(&whole, Gaps::Refuse), Ok(vec![]));

    // Samples that are missing.
    let holes = (0..9_000).chain(9_010..26_000).chain(26_001..30_000);
    let holes = write(&path("holes.mcap"), holes.map(sample));
    assert!(both(&holes, Gaps::Refuse).unwrap_err().contains("samples are missing"));
    assert_eq!(both(&holes, Gaps::LongestRun), Ok(vec![FindingKind::Masked]));

    // An axis that is homed, and homed again; samples that come twice; a channel that comes late.
    let homed = |at: u64| {
        let mut sample = sample(at);
        (sample.homed, sample.homing_sequence) = match at {
            0..12_000 => (0, 0),
            12_000..21_000 => (1, 1),
            _ => (1, 2),
        };
        if at < 24_000 {
            sample.analog_present = 1;
        }
        sample
    };
    let first = (0..14_000).map(|at| (at, 22));
    let again = first.chain((13_990..30_000).map(|at| (at, 23)));
    let again = again.map(|(at, incarnation)| Sample { incarnation, ..homed(at) });
    let homed = write(&path("homed.mcap"), again);
    let found = both(&homed, Gaps::LongestRun).unwrap();
    let expected = [FindingKind::Repeated, FindingKind::Rezeroed, FindingKind::Partial];
    assert_eq!(found, expected);

    // A record that was replayed in a loop, with a position that jumps and a channel that stays at
    // its extreme.
    let replayed = (0..40_000).map(|at: u64| {
        let place = at % 17_000;
        let mut sample = Sample {
            backend: CardKind::Replay.code(),
            record_time_s: place as f64 * PERIOD_NS as f64 * 1e-9,
            ..sample(at)
        };
        let t = place as f64 * 5e-4;
        sample.master_position[0] = (t * 6.0).sin() + if place > 10_000 { 0.5 } else { 0.0 };
        sample.motor_v[0] = (t * 6.0).cos().min(0.8);
        sample.slave_torque[0] = 0.25;
        sample
    });
    let replayed = write(&path("replayed.mcap"), replayed);
    let found = both(&replayed, Gaps::Refuse).unwrap();
    for kind in
        [FindingKind::Looped, FindingKind::Jumping, FindingKind::Saturated, FindingKind::Dead]
    {
        assert!(found.contains(&kind), "{kind:?}: {found:?}");
    }
    // A value that is no number is an error that names it.
    let spoilt = (0..20_000).map(|at| {
        let mut sample = sample(at);
        if at == 17_000 {
            sample.motor_v[0] = f64::NAN;
        }
        sample
    });
    let error = both(&write(&path("spoilt.mcap"), spoilt), Gaps::Refuse).unwrap_err();
    assert!(error.contains("row 17001, column `motor_v`"), "{error}");
}
