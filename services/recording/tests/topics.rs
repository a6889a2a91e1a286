//! Recordings of other programs, by a mapping.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use mcap::records::MessageHeader;
use re_cdr::{BigEndian, ByteOrder, CdrWriter, LittleEndian};
use recording::mcap_read::Recording;
use recording::record::{FindingKind, Options, Record, RecordError, from_topics};

const JOINT_STATE: &str = concat!(
    "std_msgs/Header header\nstring[] name\n",
    "float64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    "========\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
    "========\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
);
const START_NS: u64 = 1_800_000_000_000_000_000;

/// What the handle's joints say at a time.
fn position(time_s: f64) -> [f64; 2] {
    [(3.0 * time_s).sin(), 2.0 * time_s]
}

fn torque(time_s: f64) -> f64 {
    1500.0 - 400.0 * time_s
}

fn joint_state<B: ByteOrder>(stamp_ns: u64, options: [u8; 4]) -> Vec<u8> {
    let mut body = Vec::new();
    let mut cdr = CdrWriter::<B, Vec<u8>>::new(&mut body);
    cdr.write_i32((stamp_ns / 1_000_000_000) as i32);
    cdr.write_u32((stamp_ns % 1_000_000_000) as u32);
    cdr.write_string("handle");
    cdr.write_sequence_length(2);
    cdr.write_string("master");
    cdr.write_string("slave");
    cdr.write_sequence_length(2);
    position((stamp_ns - START_NS) as f64 * 1e-9)
        .into_iter()
        .for_each(|value| cdr.write_f64(value));
    cdr.write_sequence_length(0);
    cdr.write_sequence_length(0);
    [options.to_vec(), body].concat()
}

/// A recording of one second: joints at 1 kHz, stamped evenly and written late by turns; torque in
/// mN·m as JSON at 500 Hz.
fn write(path: &Path) {
    let mut mcap = mcap::Writer::new(BufWriter::new(File::create(path).unwrap())).unwrap();
    let schema =
        mcap.add_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE.as_bytes()).unwrap();
    let none = BTreeMap::new();
    let joints = mcap.add_channel(schema, "/joint_states", "cdr", &none).unwrap();
    let cell = mcap.add_channel(0, "/cell", "json", &none).unwrap();
    let other = mcap.add_channel(0, "/camera", "protobuf", &none).unwrap();
    let mut put = |channel_id: u16, log_time: u64, data: &[u8]| {
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        mcap.write_to_known_channel(&header, data).unwrap();
    };
    for row in 0..1000 {
        let stamp_ns = START_NS + row * 1_000_000;
        let logged_ns = stamp_ns + 100_000 * (row % 3);
        let data = match row % 2 {
            0 => joint_state::<LittleEndian>(stamp_ns, [0, 1, 0, 0]),
            _ => joint_state::<BigEndian>(stamp_ns, [0, 0, 0, 0]),
        };
        put(joints, logged_ns, &data);
        if row % 2 == 0 {
            let torque = [0.0, 0.0, torque(row as f64 * 1e-3)];
            let json = serde_json::json!({ "wrench": { "torque": torque }, "frame": "cell" });
            put(cell, stamp_ns, json.to_string().as_bytes());
            put(other, stamp_ns, b"\x08\x01");
        }
    }
    mcap.finish().unwrap();
}

fn read(path: &Path, mapping: &[&str], resample_hz: Option<f64>) -> Result<Record, RecordError> {
    let mapping = mapping.iter().map(|text| text.parse().unwrap()).collect();
    from_topics(path, &Options { mapping, resample_hz, ..Options::default() })
}

#[test]
fn stamps_of_a_topic_are_its_time_and_its_values_come_bit_by_bit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("other.mcap");
    write(&path);
    let mapping = [
        "t_s=/joint_states:header.stamp",
        "master_rad=/joint_states:position[0]",
        "slave_rad=/joint_states:position[1]",
    ];
    let record = read(&path, &mapping, None).unwrap();
    assert_eq!(record.len(), 1000);
    assert!(record.findings.is_empty(), "{:?}", record.findings);
    for row in 0..1000 {
        let time = row as f64 * 1e-3;
        assert!((record.time_s[row] - time).abs() < 1e-6);
        let exact = position(row as f64 * 1e6 * 1e-9);
        assert!((record.columns["master_rad"][row] - exact[0]).abs() < 1e-12);
        assert!((record.columns["slave_rad"][row] - exact[1]).abs() < 1e-12);
    }
}

#[test]
fn topics_with_different_times_are_resampled_to_one_grid() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("other.mcap");
    write(&path);
    let mapping =
        ["slave_rad=/joint_states:position[1]", "slave_torque_nm=/cell:wrench.torque[2]*0.001"];
    let record = read(&path, &mapping, Some(800.0)).unwrap();
    assert!((record.sampling_s - 1.0 / 800.0).abs() < 1e-9);
    assert_eq!(record.findings[0].kind, FindingKind::Resampled);
    for (row, time) in record.time_s.iter().enumerate() {
        assert!((record.columns["slave_torque_nm"][row] - 1e-3 * torque(*time)).abs() < 1e-9);
        // Written up to 0.2 ms late.
        assert!((record.columns["slave_rad"][row] - 2.0 * time).abs() <= 2.0 * 2.1e-4);
    }
    assert!(record.len() > 790);
}

#[test]
fn sources_that_cannot_be_read_are_reported_with_topic_and_field() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("other.mcap");
    write(&path);
    let cases: [(&[&str], &str); 8] = [
        (&["master_rad=position"], "expected TOPIC:FIELD"),
        (
            &["master_rad=/joints:position[0]"],
            "no topic `/joints`; it has /camera, /cell, /joint_states",
        ),
        (
            &["master_rad=/joint_states:angle"],
            "the message has effort, header, name, position, velocity",
        ),
        (&["master_rad=/joint_states:position[2]"], "message 1: no number there"),
        (&["master_rad=/joint_states:name[0]"], "no number there"),
        (&["master_rad=/camera:x"], "found protobuf"),
        (&["a=/cell:frame"], "the message has frame, wrench"),
        (&["t_s=/joint_states:header.stamp", "a=/cell:wrench.torque[2]"], "found 2 topics"),
    ];
    for (mapping, expected) in cases {
        let said = read(&path, mapping, None).unwrap_err().to_string();
        assert!(
            said.contains(expected) && said.contains("other.mcap"),
            "expected: {expected}\nfound:    {said}"
        );
    }
    let twice = ["a=/cell:wrench.torque[2]", "a=/cell:wrench.torque[1]"];
    assert!(read(&path, &twice, None).unwrap_err().to_string().contains("mapped twice"));
}

/// `fixtures/zstd.mcap` was written by the MCAP library for Python: 300 messages of
/// [`joint_state`] in chunks of 16 KiB.
#[test]
fn chunks_compressed_by_zstd_are_read_and_a_damaged_one_is_reported() {
    let fixture = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/zstd.mcap"));
    let mapping = ["t_s=/joint_states:header.stamp", "master_rad=/joint_states:position[0]"];
    let record = read(fixture, &mapping, None).unwrap();
    assert_eq!(record.len(), 300);
    for (row, found) in record.columns["master_rad"].iter().enumerate() {
        assert!((found - position(row as f64 * 1e-3)[0]).abs() < 1e-12, "row {row}");
    }
    let check = Recording::open(fixture).unwrap().check().unwrap();
    assert!(check.damage.is_empty() && check.messages() == 300, "{check:?}");

    let mut bytes = std::fs::read(fixture).unwrap();
    let chunk = bytes.windows(4).position(|part| part == b"zstd").unwrap();
    bytes[chunk + 600] ^= 0x10;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.mcap");
    std::fs::write(&path, bytes).unwrap();
    let check = Recording::open(&path).unwrap().check().unwrap();
    assert_eq!(check.damage.len(), 1, "{:?}", check.damage);
    assert!((1..300).contains(&check.messages()), "{}", check.messages());
}

#[test]
fn truncated_messages_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cut.mcap");
    let mut mcap = mcap::Writer::new(BufWriter::new(File::create(&path).unwrap())).unwrap();
    let schema =
        mcap.add_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE.as_bytes()).unwrap();
    let joints = mcap.add_channel(schema, "/joint_states", "cdr", &BTreeMap::new()).unwrap();
    let whole = joint_state::<LittleEndian>(START_NS, [0, 1, 0, 0]);
    let header = MessageHeader { channel_id: joints, sequence: 0, log_time: 1, publish_time: 1 };
    mcap.write_to_known_channel(&header, &whole[..whole.len() / 2]).unwrap();
    mcap.finish().unwrap();
    let said = read(&path, &["a=/joint_states:position[0]"], None).unwrap_err().to_string();
    assert!(said.contains("message 1"), "{said}");
}
