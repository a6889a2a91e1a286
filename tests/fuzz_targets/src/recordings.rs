//! Recordings: what `farreach rec`, replay and `identify` do with a file.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{Cursor, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use ipc_types::{
    CDR_HEADER, EnableToken, Event, Message, Process, SAMPLE, Sample, Setpoint, TOPICS,
    WatchdogState, event_topic,
};
use mcap::records::{MessageHeader, Metadata};
use recorder::{BidsOptions, Command, ExportFormat, ExportOptions, LengthUnit};
use recording::mcap_edit::rewrite;
use recording::mcap_read::{Check, ReadError, Recording, Selection, in_order_of_time};
use recording::mcap_write::{Output, Start, Writer, key};
use recording::record::{ColumnNames, Options, SampleColumns, from_recording, from_topics};
use recording::schema::Layout;

use crate::{MemoryFile, Outcome, chosen, with_prefixes};

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const PROTOCOL: &str = include_str!("../../../launch/protocols/guided-1hz.toml");
/// As other programs write it.
const ZSTD: &[u8] = include_bytes!("../../../services/recording/tests/fixtures/zstd.mcap");
/// Ways of [`command`].
const COMMANDS: usize = 16;
/// When the recordings of others begin (ns since 1970).
const START_NS: u64 = 1_800_000_000_000_000_000;

/// Opens a recording, reads everything in it in each way, and checks that what is found whole is
/// read to its end.
pub(crate) fn read(bytes: &[u8]) -> Outcome {
    let file = MemoryFile::new(bytes);
    let recording = Recording::open(file.path()).map_err(told)?;
    let check = recording.check().map_err(told)?;
    let _ = (recording.began_monotonic_ns(), recording.end_positions().map_err(told)?);
    let (raw, raw_errors) = count(recording.raw(Selection::default()));
    let (mut sorted, mut sorted_errors) = (0, 0);
    in_order_of_time(&[&recording], &Selection::default(), |_, message| {
        let counted = if message.is_ok() { &mut sorted } else { &mut sorted_errors };
        *counted += 1;
        Ok::<(), String>(())
    })?;
    assert_eq!((raw, raw_errors), (sorted, sorted_errors), "in the file's order, by time");
    let samples = recording.messages::<Sample>(SAMPLE.topic.name).map(count);
    let _events = recording.messages_if_any::<Event>("event.experiment").map(count);
    if check.data_lost() {
        return Err(lost(&check));
    }
    assert_eq!((raw, raw_errors), (check.messages(), 0), "it was verified");
    assert!(recording.raw(Selection::default()).flatten().all(|m| recording.decode(&m).is_ok()));
    assert!(!matches!(samples, Ok((_, 1..))), "samples that were verified cannot be read");
    Ok(())
}

fn count<T>(messages: impl Iterator<Item = Result<T, ReadError>>) -> (u64, u64) {
    messages.fold((0, 0), |(good, bad), message| match message {
        Ok(_) => (good + 1, bad),
        Err(_) => (good, bad + 1),
    })
}

fn told(error: impl std::fmt::Display) -> String {
    error.to_string()
}

fn lost(check: &Check) -> String {
    let damage = check.damage.first().map(|damage| damage.what.as_str());
    format!("data lost: {}", damage.unwrap_or("see the counts"))
}

thread_local! {
    /// Where edited recordings go.
    static FOLDER: RefCell<Option<tempfile::TempDir>> = const { RefCell::new(None) };
}

/// Does something with an empty folder.
fn in_folder<T>(act: impl FnOnce(&Path) -> T) -> T {
    FOLDER.with_borrow_mut(|folder| {
        let folder = folder.get_or_insert_with(|| tempfile::tempdir().expect("a folder"));
        let done = act(folder.path());
        for entry in std::fs::read_dir(folder.path()).expect("the folder").flatten() {
            let path = entry.path();
            let _ = std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir_all(&path));
        }
        done
    })
}

/// Recovers and cuts a recording; what comes out is whole, and has what was readable.
pub(crate) fn edited(bytes: &[u8]) -> Outcome {
    let (way, bytes) = chosen(bytes, 3);
    let file = MemoryFile::new(bytes);
    let recording = Recording::open(file.path()).map_err(told)?;
    let check = recording.check().map_err(told)?;
    let times = |by: u64| check.origin_ns.map(|origin| origin.saturating_add(by));
    let (from, until) = match way {
        1 => (times(1), None),
        2 => (times(1_000_000), times(5_000_000)),
        _ => (None, None),
    };
    in_folder(|folder| {
        let out = folder.join("out.mcap");
        let how = BTreeMap::from([("edit".to_owned(), "recover".to_owned())]);
        let report = rewrite(&[&recording], from, until, &how, &out).map_err(told)?;
        let copy = Recording::open(&out).map_err(told)?;
        assert!(copy.tail.complete, "{:?}", copy.tail);
        let copied = copy.check().map_err(told)?;
        assert!(copied.damage.is_empty(), "{:?}", copied.damage);
        assert_eq!(copied.messages(), report.messages);
        if way == 0 && !check.data_lost() {
            let text = |check: &Check| format!("{:?} {:?}", check.topics, check.ticks);
            let filled = |check: &Check| {
                let mut check = check.clone();
                check.topics.retain(|topic| topic.count > 0);
                text(&check)
            };
            // By log time, duplicates may come to stand elsewhere.
            if check.topics.iter().all(|topic| topic.duplicates == 0) {
                assert_eq!(filled(&check), filled(&copied));
            }
        }
        Ok(())
    })
}

/// Runs a command of `farreach rec`.
pub(crate) fn command(bytes: &[u8]) -> Outcome {
    let (way, bytes) = chosen(bytes, COMMANDS);
    let memory = MemoryFile::new(bytes);
    let file = memory.path().to_owned();
    in_folder(|folder| {
        let export = |to, topic: Option<&str>, name: Option<&str>| ExportOptions {
            to,
            topic: topic.map(str::to_owned),
            unit: LengthUnit::Rad,
            axis: 0,
            out: name.map(|name| folder.join(name)),
            bids: BidsOptions { subject: Some("S1".to_owned()), ..BidsOptions::default() },
        };
        let csv = Some(folder.join("out.csv"));
        let (out, json) = (folder.join("out.mcap"), way % 2 == 0);
        let command = match way {
            0 | 1 => Command::Info { file, text: None, json },
            2 | 3 => Command::Verify { file, json },
            4 | 5 => Command::Cat { file, topic: Vec::new(), json },
            6 => Command::Recover { file, out, json },
            7 => Command::Cut { file, from: Some(0.001), to: None, out, json },
            8 => Command::Merge { files: vec![file.clone(), file], force: true, out, json },
            9 => Command::Sessions { file, out: csv, figure: None, json },
            10 => {
                let (repetition, figure) = (Some(0.75), Some(folder.join("out.svg")));
                let (pulses, volumes) = (None, Some(5));
                Command::Volumes { file, repetition, pulses, volumes, out: csv, figure, json }
            }
            11 => Command::Export { file, options: export(ExportFormat::Csv, None, None) },
            12 => Command::Export { file, options: export(ExportFormat::Mat, None, Some("S1_")) },
            13 => Command::Export { file, options: export(ExportFormat::Bids, None, Some("set")) },
            14 => {
                let page = Some(folder.join("out.html"));
                Command::Innovations { file, out: csv, page, json }
            }
            _ => Command::Resim { file, control: Some("hydrostatic".into()), json: false },
        };
        recorder::run_to(&command, &mut std::io::sink()).map(drop).map_err(|e| format!("{e:#}"))
    })
}

/// Reads a measured record out of a recording of farreach's, or of another program's.
pub(crate) fn record(bytes: &[u8]) -> Outcome {
    let (way, bytes) = chosen(bytes, 6);
    let file = MemoryFile::new(bytes);
    let mappings: &[&str] = match way {
        0 => &["slave_rad=/joint_states:position[1]", "slave_torque_nm=/cell:wrench[2]*0.001"],
        1 => &["t_s=/joint_states:header.stamp", "master_rad=/joint_states:position[0]"],
        2 => &["t_s=/cell:t", "slave_torque_nm=/cell:wrench[0]"],
        _ => &[],
    };
    let mapping = mappings.iter().map(|text| text.parse().expect("a mapping")).collect();
    let resample_hz = (way == 0).then_some(800.0);
    let options = Options { mapping, resample_hz, even_out: way != 3, ..Options::default() };
    let record = if mappings.is_empty() {
        let names = ColumnNames::rotary();
        let others = vec![(1, ColumnNames::slave_only("b.slave_rad".to_owned()))];
        let analog = vec![(3, "analog_3_v".to_owned())];
        let columns = SampleColumns { axis: way - 3, others, analog, ..SampleColumns::new(names) };
        from_recording(&Recording::open(file.path()).map_err(told)?, &columns, &options)
    } else {
        from_topics(file.path(), &options)
    };
    crate::tables::check_record(&record.map_err(told)?);
    Ok(())
}

/// Reads a schema, and a message by it: the text up to the first zero, and what follows.
pub(crate) fn schema(bytes: &[u8]) -> Outcome {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let (text, payload) = bytes.split_at(end);
    let text = String::from_utf8_lossy(text);
    let layout = Layout::parse("farreach/msg/Sample", "ros2msg", &text).map_err(told)?;
    let conversion = layout.conversion::<Sample>();
    let body = layout.body(payload.get(1..).unwrap_or_default()).map_err(told)?;
    assert_eq!(body.len(), layout.size);
    for field in &layout.fields {
        let count = field.read_all(body).count();
        assert_eq!(count, field.count(), "{field:?}");
        let _text = (field.values_text(body), field.event_text(&layout.fields, body));
    }
    let sample: Sample = conversion.apply(body).expect("the body is whole");
    assert!(!layout.matches::<Sample>() || sample.as_bytes() == body);
    Ok(())
}

// --- seeds

/// An output in memory.
#[derive(Clone, Debug, Default)]
struct Memory(Arc<Mutex<Vec<u8>>>);

impl Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).write(bytes)
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Output for Memory {
    fn sync(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

fn sample(index: u64) -> Sample {
    let mut sample = Sample {
        tick: 1000 + index,
        scan_time_ns: (1000 + index) * 500_000,
        axes: 1,
        master_present: 1,
        slave_present: 1,
        motor_present: 1,
        analog_present: 0xff,
        ..Sample::default()
    };
    sample.master_position[0] = (index as f64 * 3e-3).sin();
    sample.motor_v[0] = (index as f64 * 3e-3).cos();
    sample.stamp(1, 2, index, sample.scan_time_ns + 10_000);
    sample
}

/// A setpoint that names the sample and the token of the same place, in a run of [`PROTOCOL`].
fn setpoint(index: u64) -> Setpoint {
    let of = sample(index);
    let mut setpoint = Setpoint {
        protocol: rig::identity(PROTOCOL),
        player_ns: of.time_ns + 1,
        sample_tick: of.tick,
        sample_time_ns: of.scan_time_ns,
        samples_received: index + 1,
        token_incarnation: 2,
        token_sequence: index,
        renewed_ns: of.time_ns,
        run_ns: sample(0).time_ns + 1,
        epoch: 1,
        order: 1,
        run: 1,
        owner: Process::Experiment.code(),
        axes: 1,
        ..Setpoint::default()
    };
    setpoint.stamp(1, 3, index, of.time_ns + 2);
    setpoint
}

/// A token while power is allowed.
fn token(index: u64) -> EnableToken {
    let state = WatchdogState::Enabled.code();
    let mut token = EnableToken { epoch: 1, state, ..EnableToken::default() };
    token.stamp(1, 2, index, sample(index).time_ns);
    token
}

/// As the logger writes it, with all of its topics; ended, or cut off.
fn by_the_logger(samples: u64, ended: bool) -> Vec<u8> {
    let memory = Memory::default();
    let start = Start { realtime_offset_ns: START_NS as i64, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::RIG_FILE, RIG)
        .with(key::PROFILE, "best-effort");
    let path = Path::new("seed.mcap");
    let output = Box::new(memory.clone());
    let mut writer = Writer::to_output(output, path, &start, 0).expect("memory");
    for index in 0..samples {
        writer.write_message(&SAMPLE, &sample(index)).expect("memory");
    }
    if ended {
        drop(writer.finish(&[]).expect("memory"))
    } else {
        writer.flush().expect("memory")
    }
    std::mem::take(&mut *memory.0.lock().unwrap_or_else(PoisonError::into_inner))
}

/// A file that is not compressed, with these topics of farreach's, for changes record by record.
fn plain(topics: &[&str], messages: u64, chunk: u64) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(chunk));
    let mut writer = options.create(Cursor::new(Vec::new())).expect("memory");
    let entries = [
        (key::RIG, "hydrostatic"),
        (key::RIG_FILE, RIG),
        (key::PROFILE, "best-effort"),
        (key::REALTIME_OFFSET_NS, "5"),
        (key::STARTED_NS, "500000000"),
    ];
    let put = |writer: &mut mcap::Writer<_>, name: &str, entries: &[(&str, &str)]| {
        let text = |(key, value): &(&str, &str)| ((*key).to_owned(), (*value).to_owned());
        let metadata = entries.iter().map(text).collect();
        writer.write_metadata(&Metadata { name: name.to_owned(), metadata }).expect("memory");
    };
    put(&mut writer, "farreach", &entries);
    put(&mut writer, "farreach.continues", &[("sample", "2 0")]);
    let run = [("protocol", "guided-1hz"), ("protocol_file", PROTOCOL), ("time_ns", "500000000")];
    put(&mut writer, "farreach.run", &run);
    for name in topics {
        let Some(topic) = TOPICS.iter().find(|topic| topic.name == *name) else { continue };
        let text = (topic.schema)();
        let schema = writer.add_schema(topic.ros_name, "ros2msg", text.as_bytes()).expect("memory");
        let channel =
            writer.add_channel(schema, topic.name, "cdr", &BTreeMap::new()).expect("memory");
        for index in 0..messages {
            let sample = sample(index);
            let body = match *name {
                "sample" => sample.as_bytes().to_vec(),
                "setpoint" => setpoint(index).as_bytes().to_vec(),
                "token" => token(index).as_bytes().to_vec(),
                _ => {
                    // Their first fields: session, incarnation, sequence, time.
                    let mut body = sample.as_bytes()[..32].to_vec();
                    body.resize(topic.size, 0);
                    body
                }
            };
            let data = [&CDR_HEADER[..], &body].concat();
            let log_time = sample.time_ns + 5;
            let sequence = index as u32;
            let header =
                MessageHeader { channel_id: channel, sequence, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header, &data).expect("memory");
        }
    }
    put(&mut writer, "farreach.end", &[(key::CLEAN_END, "true"), ("sample.dropped", "0")]);
    writer.finish().expect("memory");
    writer.into_inner().into_inner()
}

/// As another program writes it: JSON and ROS 2 messages.
fn by_others(chunked: bool) -> Vec<u8> {
    const SCHEMA: &str = "std_msgs/Header header\nfloat64[] position\n========\n\
        MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n========\n\
        MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
    let options = mcap::WriteOptions::new().compression(None).use_chunks(chunked);
    let mut writer = options.create(Cursor::new(Vec::new())).expect("memory");
    let schema = writer
        .add_schema("sensor_msgs/msg/JointState", "ros2msg", SCHEMA.as_bytes())
        .expect("memory");
    let none = BTreeMap::new();
    let joints = writer.add_channel(schema, "/joint_states", "cdr", &none).expect("memory");
    let cell = writer.add_channel(0, "/cell", "json", &none).expect("memory");
    for row in 0..30_u32 {
        let log_time = START_NS + u64::from(row) * 1_000_000;
        let mut body = [0, 1, 0, 0].to_vec();
        for word in [1_800_000_000, row * 1_000_000, 2, u32::from_le_bytes(*b"h\0\0\0"), 2, 0] {
            body.extend(word.to_le_bytes());
        }
        for angle in [f64::from(row).sin(), 0.1 * f64::from(row)] {
            body.extend(angle.to_le_bytes());
        }
        let json = serde_json::json!({ "t": 1e-3 * f64::from(row), "wrench": [1.5, row, -2] });
        for (channel_id, data) in [(joints, body), (cell, json.to_string().into_bytes())] {
            let header =
                MessageHeader { channel_id, sequence: row, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header, &data).expect("memory");
        }
    }
    writer.finish().expect("memory");
    writer.into_inner().into_inner()
}

/// Files that are not compressed.
pub(crate) fn plain_seeds() -> Vec<Vec<u8>> {
    let events = event_topic(Process::Experiment).map(|topic| topic.topic.name);
    let experiment: Vec<&str> =
        ["sample", "volume", "session", "performance"].into_iter().chain(events).collect();
    vec![
        plain(&["sample"], 12, 2000),
        plain(&experiment, 3, 1 << 20),
        plain(&["command", "model_state", "innovation"], 2, 1000),
        plain(&["sample", "token", "setpoint", "scanner", "command", "enable_line"], 3, 4000),
        plain(&[], 0, 1000),
        by_others(true),
        by_others(false),
    ]
}

pub(crate) fn seeds() -> Vec<Vec<u8>> {
    let mut seeds = plain_seeds();
    seeds.extend([by_the_logger(20, true), by_the_logger(20, false), ZSTD.to_vec()]);
    seeds.extend([b"".to_vec(), b"t_s,master_rad\n0,1\n".to_vec()]);
    seeds
}

pub(crate) fn edited_seeds() -> Vec<Vec<u8>> {
    with_prefixes(0..3, &seeds())
}

pub(crate) fn command_seeds() -> Vec<Vec<u8>> {
    with_prefixes(0..COMMANDS as u8, &seeds())
}

pub(crate) fn record_seeds() -> Vec<Vec<u8>> {
    with_prefixes(0..6, &seeds())
}

pub(crate) fn schema_seeds() -> Vec<Vec<u8>> {
    TOPICS
        .iter()
        .map(|topic| {
            let message = [&[0][..], &CDR_HEADER, &vec![1; topic.size]].concat();
            [(topic.schema)().into_bytes(), message].concat()
        })
        .collect()
}
