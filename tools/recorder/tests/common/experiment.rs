//! Writes the recording of a small experiment, with everything that other programs' formats carry.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::path::Path;

use ipc_types::{
    Event, EventKind, Light, Message, PERFORMANCE, Performance, Process, SAMPLE, SESSION, Sample,
    SessionOutcome, SessionResult, Severity, VOLUME, Volume, VolumeSource, event_topic,
};
use recording::mcap_write::{Start, Writer, key};

pub const TICK_NS: u64 = 500_000;
pub const FIRST_TICK: u64 = 1000;
/// Samples, with those that are missing.
pub const SAMPLES: u64 = 9_001;
/// Samples that are missing.
pub const MISSING: std::ops::Range<u64> = 4_000..4_020;
/// When the first volume began: between two samples.
pub const FIRST_VOLUME_NS: u64 = 1_000_123_456;
pub const REPETITION_NS: u64 = 750_000_000;
pub const VOLUMES: u64 = 5;
/// The segments: kind, label, and when each began.
pub const SEGMENTS: [(&str, &str, u64); 4] = [
    ("wait_for_scanner", "waiting for the scanner", 600_000_000),
    ("rhythm", "session 1 of 4: rhythm", 2_000_000_000),
    ("centre", "centring 1", 4_000_000_000),
    ("rest", "rest 1", 4_500_000_000),
];
const RIG: &str = include_str!("../../../../launch/rigs/hydrostatic.toml");
const PROTOCOL: &str = include_str!("../../../../launch/protocols/force-matching.toml");

pub fn sample(tick: u64) -> Sample {
    // Nothing in it is a round number.
    let phase = tick as f64 * 1e-3;
    let mut sample = Sample {
        tick,
        // Taken late now and then.
        scan_time_ns: tick * TICK_NS + if tick.is_multiple_of(7) { 41_000 } else { 0 },
        axes: 1,
        master_present: 1,
        slave_present: 1,
        torque_present: 1,
        motor_present: if tick.is_multiple_of(11) { 0 } else { 1 },
        analog_present: 0xff,
        ..Sample::default()
    };
    sample.master_position[0] = phase.sin() / 3.0;
    sample.slave_position[0] = phase.cos() / 7.0;
    sample.slave_torque[0] = -0.25 * phase.sin();
    sample.motor_v[0] = phase.cos();
    for (input, volts) in sample.analog_v.iter_mut().enumerate().take(8) {
        *volts = (phase * (input + 1) as f64).sin() / 3.0;
    }
    sample.stamp(11, 22, tick, sample.scan_time_ns + 80_000);
    sample
}

fn event(kind: EventKind, at_ns: u64, sequence: u64, text: &str) -> Event {
    let mut event = Event::new(Process::Experiment, kind, Severity::Info, text);
    event.stamp(11, 44, sequence, at_ns);
    event
}

/// What happened, in the order of time.
pub fn events() -> Vec<Event> {
    let mut events = vec![event(EventKind::ProtocolStarted, 600_000_000, 0, "force-matching")];
    for (index, (_, label, begun_ns)) in (0..).zip(SEGMENTS) {
        let mut started = event(EventKind::SegmentStarted, begun_ns, 0, label);
        (started.segment, started.a) = (index, f64::from(index));
        events.push(started);
    }
    let mut beat = event(EventKind::Beat, 2_500_000_001, 0, "");
    (beat.a, beat.b) = (1.0 / 3.0, 1.0);
    events.push(beat);
    events.push(event(EventKind::SessionOver, 4_000_000_000, 0, "whole"));
    events.push(event(EventKind::Note, 4_600_000_000, 0, "\"sat up\tand slept, 5 µV"));
    events.push(event(EventKind::ProtocolStopped, 4_900_000_000, 0, "by the operator"));
    events.sort_by_key(|event| event.time_ns);
    for (sequence, event) in (0..).zip(&mut events) {
        event.sequence = sequence;
    }
    events
}

/// Writes the recording; without volumes where there was no scan.
pub fn write(path: &Path, subject: &str, scan: bool) {
    let samples = (0..SAMPLES).filter(|at| !MISSING.contains(at));
    write_samples(path, subject, scan, samples.map(|at| sample(FIRST_TICK + at)));
}

/// Writes the recording with these samples.
pub fn write_samples(
    path: &Path,
    subject: &str,
    scan: bool,
    samples: impl Iterator<Item = Sample>,
) {
    let mut start = Start { realtime_offset_ns: 1_700_000_000_123_456_789, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::RIG_FILE, RIG)
        .with(key::VERSION, "0.1.0");
    start.run = BTreeMap::from([
        (key::PROTOCOL.to_owned(), "force-matching".to_owned()),
        (key::PROTOCOL_FILE.to_owned(), PROTOCOL.to_owned()),
        (key::SUBJECT.to_owned(), subject.to_owned()),
        (key::TIME_NS.to_owned(), "590000000".to_owned()),
    ]);
    let mut writer = Writer::create(path, &start, 0).unwrap();
    for sample in samples {
        writer.write_message(&SAMPLE, &sample).unwrap();
    }
    let topic = event_topic(Process::Experiment).unwrap();
    for event in events() {
        writer.write_message(&topic, &event).unwrap();
    }
    for index in (0..VOLUMES).filter(|_| scan) {
        let volume = volume(index, FIRST_VOLUME_NS + index * REPETITION_NS);
        writer.write_message(&VOLUME, &volume).unwrap();
    }
    for update in 0..100u32 {
        let mut shown = performance(update);
        shown.stamp(11, 44, u64::from(update), shown.at_ns + 1000);
        writer.write_message(&PERFORMANCE, &shown).unwrap();
    }
    let mut result = SessionResult {
        begun_ns: 2_000_050_000,
        ended_ns: 4_000_050_000,
        planned_s: 2.0,
        samples: 4000,
        number: 1,
        segment: 1,
        sessions: 4,
        bars: 1,
        value: [1.0 / 7.0, 0.0],
        outcome: SessionOutcome::Whole.code(),
        ..SessionResult::default()
    };
    result.stamp(11, 44, 0, result.ended_ns);
    writer.write_message(&SESSION, &result).unwrap();
    writer.finish(&[]).unwrap();
}

/// A volume that the protocol counted.
pub fn volume(index: u64, at_ns: u64) -> Volume {
    let mut volume = Volume {
        index,
        at_ns,
        volumes: index + 1,
        source: VolumeSource::Pulse.code(),
        ..Volume::default()
    };
    volume.stamp(11, 44, index, at_ns + 900_000);
    volume
}

/// What the subject saw at an update of the session.
pub fn performance(update: u32) -> Performance {
    Performance {
        at_ns: 2_000_000_000 + u64::from(update) * 20_000_000,
        begun_ns: 2_000_000_000,
        number: 1,
        update: update / 50,
        // The bar is seen from the first second on.
        bars: u8::from(update >= 50),
        value: [f64::from(update) / 3.0, 0.0],
        height: [f64::from(update) / 9.0, 0.0],
        light: Light::Green.code(),
        ..Performance::default()
    }
}
