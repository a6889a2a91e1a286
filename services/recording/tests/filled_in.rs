//! Ticks that the simulated card filled in late are counted, and are not missing.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;

use common::{PERIOD_NS, sample, start};
use ipc_types::{CARD_SCAN, CardKind, CardScan, Message, SAMPLE, Sample};
use recording::mcap_read::{Check, FilledIn, Recording};
use recording::mcap_write::Writer;

const TICKS: u64 = 400;

/// The wake at which the card simulated a tick: it did not run from tick 1100 to 1130, nor from
/// 1200 to 1202.
fn woke(tick: u64) -> u64 {
    match tick {
        1100..=1130 => 1131,
        1200..=1202 => 1203,
        tick => tick,
    }
}

fn scan(i: u64) -> CardScan {
    let mut scan = CardScan::default();
    scan.tick = sample(i).tick;
    scan.scan_time_ns = scan.tick * PERIOD_NS;
    scan.stamp(11, 44, i, woke(scan.tick) * PERIOD_NS + 60_000);
    scan
}

fn check(path: &Path, write: impl Fn(&mut Writer, u64)) -> Check {
    let mut writer = Writer::create(path, &start(), sample(0).time_ns).unwrap();
    (0..TICKS).for_each(|i| write(&mut writer, i));
    writer.finish(&[]).unwrap();
    Recording::open(path).unwrap().check().unwrap()
}

/// 31 and 3 ticks were late; those of the wakes themselves were not.
const FOUND: FilledIn = FilledIn { ticks: 34, longest: 31, longest_ns: 31 * PERIOD_NS };

#[test]
fn the_scans_of_the_simulated_card_tell_what_it_filled_in() {
    let dir = tempfile::tempdir().unwrap();
    let found = check(&dir.path().join("run.mcap"), |writer, i| {
        writer.write_message(&CARD_SCAN, &scan(i)).unwrap();
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
    });
    assert!(found.simulated && !found.data_lost());
    assert_eq!(found.filled_in, Some(FOUND));
    assert_eq!(found.ticks.unwrap().missing, 0);
}

#[test]
fn without_them_the_samples_tell_and_those_of_other_cards_have_none() {
    let dir = tempfile::tempdir().unwrap();
    let marked = |i: u64, backend: CardKind| Sample {
        filled_in: u8::from(woke(sample(i).tick) != sample(i).tick),
        backend: backend.code(),
        ..sample(i)
    };
    let of = |name: &str, backend| {
        check(&dir.path().join(name), |writer, i| {
            writer.write_message(&SAMPLE, &marked(i, backend)).unwrap();
        })
    };
    assert_eq!(of("simulated.mcap", CardKind::Simulated).filled_in, Some(FOUND));
    let real = of("real.mcap", CardKind::Comedi);
    assert_eq!((real.simulated, real.filled_in), (false, None));
}

#[test]
fn a_recording_of_an_older_build_does_not_claim_that_none_were() {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/v0.1.0.mcap");
    let old = Recording::open(&fixture).unwrap();
    let scans = old.messages_if_any::<CardScan>(CARD_SCAN.topic.name).unwrap().count();
    let found = old.check().unwrap();
    assert_eq!((found.simulated, found.filled_in.is_some()), (true, scans > 0));
}
