//! Writes long recordings as the logger does: every topic at about its rate, samples at 2 kHz, with
//! the noise of encoders and converters, so that they compress as those of a rig do.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::path::Path;

use ipc_types::{
    CARD_SCAN, CardScan, Event, EventKind, Message, ModelState, MonitorState, PERFORMANCE,
    Performance, Primitive, Process, Rate, SAMPLE, SESSION, Sample, SessionOutcome, SessionResult,
    Severity, TOPICS, Topic, VOLUME, Volume, VolumeSource,
};
use recording::mcap_write::{Start, Writer, key};

pub const RATE_HZ: u64 = 2000;
const TICK_NS: u64 = 1_000_000_000 / RATE_HZ;
/// The first tick: the computer has run for a while.
const FIRST_TICK: u64 = 3_600 * RATE_HZ;
const REPETITION_NS: u64 = 2_000_000_000;
/// Sessions in a recording.
const SESSIONS: u64 = 4;
/// Rate of the loops beside acquisition, and of what is published now and then (Hz).
const LOOP_HZ: u64 = 500;
const SPORADIC_HZ: u64 = 50;
const RIG: &str = include_str!("../../../../launch/rigs/hydrostatic.toml");
const PROTOCOL: &str = include_str!("../../../../launch/protocols/force-matching.toml");

/// Numbers that look random (SplitMix64).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// About normal, of standard deviation 1.
    fn normal(&mut self) -> f64 {
        let bits = self.next();
        let sum: u64 = (0..4).map(|at| bits >> (16 * at) & 0xffff).sum();
        (sum as f64 / 65_536.0 - 2.0) * 3.0_f64.sqrt()
    }
}

/// The steps of a converter of 16 bits over ±10 V.
fn converted(volts: f64) -> f64 {
    let step = 20.0 / 65_536.0;
    (volts / step).round() * step
}

fn sample(tick: u64, noise: &mut Noise) -> Sample {
    let t = tick as f64 / RATE_HZ as f64;
    let mut sample = Sample {
        tick,
        scan_time_ns: tick * TICK_NS,
        axes: 1,
        master_present: 1,
        slave_present: 1,
        torque_present: 1,
        motor_present: 1,
        analog_present: 0xff,
        ..Sample::default()
    };
    let count = std::f64::consts::TAU / 40_000.0;
    let angle = 0.4 * (std::f64::consts::TAU * 0.7 * t).sin();
    sample.master_counts[0] = ((angle + 1e-4 * noise.normal()) / count).round() as i64;
    sample.slave_counts[0] = ((0.9 * angle + 1e-4 * noise.normal()) / count).round() as i64;
    sample.master_position[0] = sample.master_counts[0] as f64 * count;
    sample.slave_position[0] = sample.slave_counts[0] as f64 * count;
    sample.motor_v[0] = converted(2.0 * angle + 0.01 * noise.normal());
    for volts in &mut sample.analog_v[..8] {
        *volts = converted(0.2 * noise.normal());
    }
    sample.slave_torque[0] = 0.31 * sample.analog_v[0];
    sample
}

/// A message of any type: noise in its floating-point fields, and its tick.
fn any_message(topic: &Topic, tick: u64, noise: &mut Noise) -> Vec<u8> {
    let mut bytes = vec![0; topic.size];
    for field in topic.fields {
        for index in 0..field.array.unwrap_or(1) {
            let word = match field.primitive {
                Primitive::F64 => converted(0.2 * noise.normal()).to_bits(),
                Primitive::U64 if field.name == "tick" => tick,
                _ => continue,
            };
            let at = field.offset + index * 8;
            bytes[at..at + 8].copy_from_slice(&word.to_le_bytes());
        }
    }
    bytes
}

/// The recording that is written.
struct Long {
    writer: Writer,
    /// Sequence number by index of the topic.
    sequences: Vec<u64>,
    noise: Noise,
    seconds: u64,
}

impl Long {
    fn send(&mut self, index: usize, mut bytes: Vec<u8>, time_ns: u64) {
        let sequence = self.sequences[index];
        self.sequences[index] += 1;
        // Session, incarnation, sequence, time: every message begins so.
        let head = [11, 100 + index as u64, sequence, time_ns];
        for (at, word) in head.into_iter().enumerate() {
            bytes[8 * at..8 * at + 8].copy_from_slice(&word.to_le_bytes());
        }
        self.writer.write(index, &bytes).unwrap();
    }

    fn tick(&mut self, at: u64) {
        let tick = FIRST_TICK + at;
        let now_ns = tick * TICK_NS;
        for (index, topic) in TOPICS.iter().enumerate() {
            let every = match topic.rate {
                Rate::Loop(Process::Acquisition) => 1,
                Rate::Loop(_) => RATE_HZ / LOOP_HZ,
                Rate::Hertz(hz) => RATE_HZ / u64::from(hz),
                Rate::Sporadic => RATE_HZ / SPORADIC_HZ,
            };
            // Not all in the same instant.
            let phase = index as u64 * 7 % every;
            if at % every != phase {
                continue;
            }
            if let Some(bytes) = self.message(topic, at) {
                self.send(index, bytes, now_ns + 60_000 + 500 * index as u64);
            }
        }
        self.writer.tick(now_ns).unwrap();
    }

    /// What a topic has to say, if anything.
    fn message(&mut self, topic: &Topic, at: u64) -> Option<Vec<u8>> {
        let tick = FIRST_TICK + at;
        let now_ns = tick * TICK_NS;
        let once_in = |ticks: u64| at / ticks != (at + RATE_HZ / SPORADIC_HZ) / ticks;
        let session_ticks = (self.seconds * RATE_HZ / SESSIONS).max(1);
        let (session, within) = (at / session_ticks, at % session_ticks);
        let begun_ns = (FIRST_TICK + session * session_ticks) * TICK_NS;
        Some(match topic.name {
            name if name == SAMPLE.topic.name => sample(tick, &mut self.noise).as_bytes().to_vec(),
            name if name == CARD_SCAN.topic.name => {
                let scan = CardScan { tick, scan_time_ns: now_ns, ..CardScan::default() };
                let mut bytes = any_message(topic, tick, &mut self.noise);
                // What is checked of it, behind the common head.
                bytes[32..56].copy_from_slice(&scan.as_bytes()[32..56]);
                bytes
            }
            name if name == PERFORMANCE.topic.name => Performance {
                at_ns: now_ns,
                begun_ns,
                number: session as u32 + 1,
                update: (within * 2 / RATE_HZ) as u32,
                bars: 1,
                value: [self.noise.normal(), 0.0],
                height: [10.0, 0.0],
                ..Performance::default()
            }
            .as_bytes()
            .to_vec(),
            name if name == VOLUME.topic.name => {
                let every = REPETITION_NS / TICK_NS;
                let index = at / every;
                return once_in(every).then(|| {
                    let source = VolumeSource::Pulse.code();
                    let volumes = index + 1;
                    let at_ns = FIRST_TICK * TICK_NS + index * REPETITION_NS;
                    let volume = Volume { index, at_ns, volumes, source, ..Volume::default() };
                    volume.as_bytes().to_vec()
                });
            }
            name if name == SESSION.topic.name => {
                return once_in(session_ticks).then(|| {
                    let ended = SessionResult {
                        begun_ns,
                        ended_ns: begun_ns + session_ticks * TICK_NS,
                        samples: session_ticks,
                        number: session as u32 + 1,
                        segment: session as u32,
                        sessions: SESSIONS as u32,
                        bars: 1,
                        outcome: SessionOutcome::Whole.code(),
                        ..SessionResult::default()
                    };
                    ended.as_bytes().to_vec()
                });
            }
            "model_state" => {
                return once_in(RATE_HZ).then(|| {
                    let state = MonitorState::Steady.code();
                    let state = ModelState { tick, learnt: 1.0, state, ..ModelState::default() };
                    state.as_bytes().to_vec()
                });
            }
            // These mean something, and come rarely.
            "home_order" | "sync_order" | "emg_maximum" | "scanner_key" => return None,
            name if name.starts_with("event") => {
                return once_in(20 * RATE_HZ).then(|| self.event(topic, session, within));
            }
            _ => any_message(topic, tick, &mut self.noise),
        })
    }

    fn event(&self, topic: &Topic, session: u64, within: u64) -> Vec<u8> {
        let mut event = Event::new(topic.owner, EventKind::Note, Severity::Info, "as usual");
        if topic.owner == Process::Experiment && within < 20 * RATE_HZ {
            let label = format!("session {} of {SESSIONS}", session + 1);
            let kind = EventKind::SegmentStarted;
            event = Event::new(topic.owner, kind, Severity::Info, &label);
            event.segment = session as u32;
        }
        event.as_bytes().to_vec()
    }
}

/// Writes a recording of so many seconds.
pub fn write(path: &Path, seconds: u64) {
    let begun_ns = FIRST_TICK * TICK_NS;
    let mut start = Start { realtime_offset_ns: 1_700_000_000_123_456_789, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::RIG_FILE, RIG)
        .with(key::SESSION, "11")
        .with(key::SUBJECT, "S07")
        .with(key::VERSION, env!("CARGO_PKG_VERSION"))
        .with("axis.0.name", "handle")
        .with("axis.0.unit", "rad");
    start.run = BTreeMap::from([
        (key::PROTOCOL.to_owned(), "force-matching".to_owned()),
        (key::PROTOCOL_FILE.to_owned(), PROTOCOL.to_owned()),
        (key::SUBJECT.to_owned(), "S07".to_owned()),
        // The protocol began before the recording.
        (key::TIME_NS.to_owned(), (begun_ns - 1_000_000).to_string()),
    ]);
    let writer = Writer::create(path, &start, begun_ns).unwrap();
    let mut long =
        Long { writer, sequences: vec![0; TOPICS.len()], noise: Noise(seconds), seconds };
    // A little more, so that samples follow the last session.
    for at in 0..seconds * RATE_HZ + RATE_HZ / 10 {
        long.tick(at);
    }
    long.writer.finish(&[]).unwrap();
}
