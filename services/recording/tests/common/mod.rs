//! Builds recordings for the tests.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};

use ipc_types::{
    COMMAND, Event, EventKind, Message, MotorCommand, Process, SAMPLE, Sample, Severity,
};
use recording::mcap_read::Recording;
use recording::mcap_write::{Output, Start, Writer, key};

pub const OFFSET: i64 = 1_700_000_000_000_000_000;
pub const PERIOD_NS: u64 = 500_000;

/// Sample `i`, every field different from its neighbours.
pub fn sample(i: u64) -> Sample {
    let mut s = Sample::default();
    s.stamp(11, 22, i, (i + 1_000) * PERIOD_NS + 80_000);
    s.tick = i + 1_000;
    s.scan_time_ns = s.tick * PERIOD_NS;
    let t = i as f64 * 5e-4;
    for axis in 0..3 {
        s.master_counts[axis] = -(i as i64) * (axis as i64 + 1);
        s.master_position[axis] = (t * 6.0).sin() / (axis as f64 + 3.0);
        s.slave_position[axis] = (t * 6.0 - 0.1).sin() * 0.77;
        s.slave_torque[axis] = (t * 3.0).cos() * 0.1 + 1e-17;
        s.motor_v[axis] = (t * 6.0).cos() * 1.5;
    }
    for channel in 0..16 {
        s.analog_v[channel] = t * channel as f64;
    }
    s.axes = 1;
    s.master_present = 1;
    s.slave_present = 1;
    s.torque_present = 1;
    s.motor_present = 1;
    s.analog_present = 0b11;
    s
}

pub fn samples(recording: &Recording) -> Vec<Sample> {
    recording
        .messages::<Sample>("sample")
        .unwrap()
        .filter_map(Result::ok)
        .map(|r| r.message)
        .collect()
}

pub fn command(i: u64) -> MotorCommand {
    let mut c = MotorCommand { volts: [i as f64, 0.5, -0.25], ..MotorCommand::default() };
    c.stamp(11, 33, i, (i * 4 + 1_000) * PERIOD_NS + 200_000);
    c
}

pub fn start() -> Start {
    Start { realtime_offset_ns: OFFSET, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::RIG_FILE, "[rig]\nname = \"hydrostatic\" # ä µ\n")
        .with(key::PROFILE, "best-effort")
}

/// Writes `n` samples, every fourth with a command, some events; ticks the writer as the logger
/// would.
pub fn fill(writer: &mut Writer, n: u64) {
    let event = ipc_types::event_topic(Process::Control).unwrap();
    for i in 0..n {
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
        if i % 4 == 0 {
            writer.write_message(&COMMAND, &command(i / 4)).unwrap();
        }
        if i % 1000 == 0 {
            let mut e = Event::new(
                Process::Control,
                EventKind::ProcessStarted,
                Severity::Info,
                "bereit, übrigens",
            );
            e.stamp(11, 33, i / 1000, sample(i).time_ns);
            writer.write_message(&event, &e).unwrap();
        }
        writer.tick(sample(i).time_ns).unwrap();
    }
}

pub fn write_file(path: &Path, n: u64) {
    let mut writer = Writer::create(path, &start(), sample(0).time_ns).unwrap();
    fill(&mut writer, n);
    writer.finish(&[]).unwrap();
}

/// Memory that takes so many bytes and then is full.
#[derive(Clone, Default)]
pub struct Tiny {
    pub bytes: Arc<Mutex<Vec<u8>>>,
    pub room: usize,
    pub syncs: Arc<Mutex<u64>>,
}

impl Write for Tiny {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        let mut bytes = self.bytes.lock().unwrap();
        let fits = data.len().min(self.room - bytes.len());
        if fits == 0 && !data.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        bytes.extend_from_slice(&data[..fits]);
        Ok(fits)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Output for Tiny {
    fn sync(&mut self) -> io::Result<()> {
        *self.syncs.lock().unwrap() += 1;
        Ok(())
    }
}
