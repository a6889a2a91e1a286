//! Exports of recordings that are longer than what is held of them in memory: every value is there,
//! bit by bit.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;
mod mat_reader;

use std::fs;

use ipc_types::{Message, Sample};
use recorder::{DONE, Signal, signals};
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use recording::record::{Options, from_csv};
use rig::RigFile;

use common::{Folder, long, rec};
use mat_reader::read;

const SECONDS: u64 = 20;
const SESSIONS: usize = 4;

fn samples(folder: &Folder) -> (Vec<Sample>, Vec<Signal>) {
    long::write(&folder.path("run.mcap"), SECONDS);
    let recording = Recording::open(&folder.path("run.mcap")).unwrap();
    let rig = RigFile::parse(recording.metadata(key::RIG_FILE).unwrap(), "rig file").unwrap();
    let samples = recording.messages::<Sample>("sample").unwrap();
    (samples.map(|sample| sample.unwrap().message).collect(), signals(&rig))
}

#[test]
fn matlab_files_have_every_sample_of_a_session() {
    let folder = Folder::new();
    let (samples, signals) = samples(&folder);
    let words = ["export", &folder.text("run.mcap"), "--to", "mat", "-o", &folder.text("S_")];
    assert_eq!(rec(&words).0, DONE);
    let length = (SECONDS * long::RATE_HZ) as usize / SESSIONS;
    for session in 0..SESSIONS {
        let own = &samples[session * length..(session + 1) * length];
        let name = format!("S_{}.mat", session + 1);
        let mat = read(&fs::read(folder.path(&name)).unwrap());
        assert_eq!(mat.at("output").size(), [length, signals.len()], "{name}");
        let (time, output) = (mat.at("time").numbers(), mat.at("output").numbers());
        let begun_ns = own[0].scan_time_ns;
        for (at, sample) in own.iter().enumerate() {
            let since_s = (sample.scan_time_ns as f64 - begun_ns as f64) * 1e-9;
            assert_eq!(time[at].to_bits(), since_s.to_bits(), "{name}, row {at}");
            for (column, signal) in signals.iter().enumerate() {
                let value = output[column * length + at];
                let expected = signal.value(sample);
                assert!(
                    value.to_bits() == expected.to_bits() || value.is_nan() && expected.is_nan(),
                    "{name}, row {at}, {}: {value}, expected {expected}",
                    signal.name
                );
            }
        }
        let emg = mat.at("emg");
        let electrodes = emg.at("names").texts().len();
        assert!(electrodes > 0);
        for name in ["filtered", "envelope"] {
            assert_eq!(emg.at(name).size(), [length, electrodes]);
            assert!(emg.at(name).numbers().iter().all(|value| value.is_finite()), "{name}");
        }
    }
}

#[test]
fn tables_have_every_sample() {
    let folder = Folder::new();
    let (samples, _) = samples(&folder);
    let run = folder.text("run.mcap");
    let words = ["export", &run, "--to", "csv", "-o", &folder.text("record.csv")];
    assert_eq!(rec(&words).0, DONE);
    let record = from_csv(&folder.path("record.csv"), &Options::default()).unwrap();
    assert_eq!(record.len(), samples.len());
    type Read = fn(&Sample) -> f64;
    let columns: [(&str, Read); 4] = [
        ("master_rad", |sample| sample.master_position[0]),
        ("slave_rad", |sample| sample.slave_position[0]),
        ("slave_torque_nm", |sample| sample.slave_torque[0]),
        ("motor_v", |sample| sample.motor_v[0]),
    ];
    for (name, of) in columns {
        let column = record.column(name).unwrap();
        let same = |(value, sample): (&f64, &Sample)| value.to_bits() == of(sample).to_bits();
        assert!(column.iter().zip(&samples).all(same), "{name}");
    }

    // All fields.
    let (code, text) = rec(&["export", &run, "--to", "csv", "--topic", "sample"]);
    assert_eq!(code, DONE);
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &str| header.iter().position(|column| *column == name).unwrap();
    let (tick, volts, sequence) = (place("tick"), place("analog_v_7"), place("sequence"));
    let mut count = 0;
    for (line, sample) in lines.zip(&samples) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), header.len());
        assert_eq!(cells[tick].parse::<u64>().unwrap(), sample.tick);
        let value: f64 = cells[volts].parse().unwrap();
        assert_eq!(value.to_bits(), sample.analog_v[7].to_bits());
        assert_eq!(cells[sequence].parse::<u64>().unwrap(), sample.sequence());
        count += 1;
    }
    assert_eq!(count, samples.len());
}
