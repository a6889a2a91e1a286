//! Writes short recordings of samples and commands, with ticks that are missing.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

use std::fs;
use std::path::Path;

use ipc_types::{COMMAND, Message, MotorCommand, SAMPLE, Sample};
use recording::mcap_write::{Start, Writer, key};

pub fn sample(i: u64) -> Sample {
    let t = i as f64 * 5e-4;
    let mut s = Sample {
        tick: 1000 + i,
        scan_time_ns: (1000 + i) * 500_000,
        axes: 1,
        master_present: 1,
        motor_present: 1,
        ..Sample::default()
    };
    s.master_position[0] = (t * 6.0).sin();
    s.motor_v[0] = (t * 5.0).cos();
    s.analog_v[3] = f64::NAN;
    s.stamp(11, 22, i, (1000 + i) * 500_000 + 80_000);
    s
}

pub fn write(path: &Path, ticks: impl IntoIterator<Item = u64>, end: bool) {
    let start = Start { realtime_offset_ns: 1_700_000_000_000_000_000, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::PROFILE, "best-effort");
    let mut writer = Writer::create(path, &start, 0).unwrap();
    for i in ticks {
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
        if i % 4 == 0 {
            let mut c = MotorCommand { volts: [0.5, 0.0, 0.0], ..MotorCommand::default() };
            c.stamp(11, 33, i / 4, (1000 + i) * 500_000 + 200_000);
            writer.write_message(&COMMAND, &c).unwrap();
        }
        writer.tick(i * 500_000).unwrap();
    }
    if end {
        writer.finish(&[]).unwrap();
    } else {
        // A file as a killed logger leaves it: as it is, without the writer's lock.
        let growing = path.with_extension("growing");
        fs::rename(path, &growing).unwrap();
        fs::copy(&growing, path).unwrap();
    }
}
