//! Parquet files, read back: every value is that of the CSV file, bit by bit.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::fs::File;
use std::path::Path;

use clap::Parser;
use parquet::basic::{LogicalType, TimeUnit};
use parquet::column::reader::ColumnReader;
use parquet::file::reader::{FileReader, SerializedFileReader};
use recorder::DATA_LOST;
use recording::mcap_read::Recording;

use common::{Folder, Line, experiment, fails, long, rec, short};

/// What a file says, its values as the text that CSV files have of them.
struct Contents {
    columns: Vec<(String, Vec<String>)>,
    kinds: BTreeMap<String, String>,
    metadata: BTreeMap<String, String>,
    groups: usize,
}

fn read(path: &Path) -> Contents {
    let reader = SerializedFileReader::new(File::open(path).unwrap()).unwrap();
    let file = reader.metadata().file_metadata();
    let mut columns = Vec::new();
    let mut kinds = BTreeMap::new();
    for (at, column) in file.schema_descr().columns().iter().enumerate() {
        let logical = column.logical_type_ref();
        let unsigned = matches!(logical, Some(LogicalType::Integer(kind)) if !kind.is_signed);
        let mut texts = Vec::new();
        for group in 0..reader.num_row_groups() {
            let group = reader.get_row_group(group).unwrap();
            let rows = usize::try_from(group.metadata().num_rows()).unwrap();
            let found = values(group.get_column_reader(at).unwrap(), rows, unsigned);
            assert_eq!(found.len(), rows);
            texts.extend(found);
        }
        kinds.insert(column.name().to_owned(), format!("{:?}", column.physical_type()));
        columns.push((column.name().to_owned(), texts));
    }
    let metadata = file.key_value_metadata().unwrap().iter();
    let metadata = metadata.map(|entry| (entry.key.clone(), entry.value.clone().unwrap()));
    Contents { columns, kinds, metadata: metadata.collect(), groups: reader.num_row_groups() }
}

fn values(reader: ColumnReader, rows: usize, unsigned: bool) -> Vec<String> {
    macro_rules! all {
        ($reader:ident, $text:expr) => {{
            let (mut reader, mut values) = ($reader, Vec::new());
            reader.read_records(rows, None, None, &mut values).unwrap();
            values.into_iter().map($text).collect()
        }};
    }
    match reader {
        ColumnReader::Int32ColumnReader(reader) => all!(reader, |value: i32| {
            assert!(unsigned);
            value.cast_unsigned().to_string()
        }),
        ColumnReader::Int64ColumnReader(reader) => all!(reader, |value: i64| match unsigned {
            true => value.cast_unsigned().to_string(),
            false => value.to_string(),
        }),
        // The shortest text that parses to the same number.
        ColumnReader::DoubleColumnReader(reader) => all!(reader, |value: f64| value.to_string()),
        ColumnReader::ByteArrayColumnReader(reader) => {
            all!(reader, |value: parquet::data_type::ByteArray| value.as_utf8().unwrap().to_owned())
        }
        _ => panic!("a type that is not written"),
    }
}

/// Exports both ways and compares.
fn compare(folder: &Folder, run: &str, name: &str, more: &[&str]) -> Contents {
    let (table, parquet) = (format!("{name}.csv"), format!("{name}.parquet"));
    let export = |to: &str, out: &str| {
        let (run, out) = (folder.text(run), folder.text(out));
        let mut words = vec!["export", &run, "--to", to, "-o", &out];
        words.extend(more);
        rec(&words)
    };
    assert_eq!(export("csv", &table), export("parquet", &parquet), "{name}");
    let contents = read(&folder.path(&parquet));
    let mut table = csv::Reader::from_path(folder.path(&table)).unwrap();
    let names: Vec<&str> = contents.columns.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(table.headers().unwrap().iter().collect::<Vec<_>>(), names, "{name}");
    let mut rows = 0;
    for (row, record) in table.records().enumerate() {
        for (cell, (column, values)) in record.unwrap().iter().zip(&contents.columns) {
            assert_eq!(cell, values[row], "{name}, row {row}, {column}");
        }
        rows += 1;
    }
    assert!(contents.columns.iter().all(|(_, values)| values.len() == rows), "{name}");
    contents
}

#[test]
fn every_topic_has_the_values_of_the_csv_file() {
    let folder = Folder::new();
    long::write(&folder.path("long.mcap"), 2);
    experiment::write(&folder.path("experiment.mcap"), "S07", true);
    short::write(&folder.path("short.mcap"), 0..100, true);
    for run in ["long", "experiment", "short"] {
        let file = format!("{run}.mcap");
        let recording = Recording::open(&folder.path(&file)).unwrap();
        for channel in recording.channels.values() {
            let name = format!("{run}-{}", channel.topic.replace('/', "-"));
            let found = compare(&folder, &file, &name, &["--topic", &channel.topic]);
            assert_eq!(found.metadata["topic"], channel.topic);
            assert_eq!(found.metadata["type"], channel.schema_name);
        }
    }
}

#[test]
fn the_measured_record_has_the_values_of_the_csv_file_and_units() {
    let folder = Folder::new();
    long::write(&folder.path("run.mcap"), 10);
    let found = compare(&folder, "run.mcap", "record", &[]);
    assert_eq!(found.columns[0].1.len(), 20_200);
    assert!(found.kinds.values().all(|kind| kind == "DOUBLE"), "{:?}", found.kinds);
    let units: BTreeMap<String, String> = serde_json::from_str(&found.metadata["units"]).unwrap();
    let text: Vec<_> = units.iter().map(|(name, unit)| format!("{name} {unit}")).collect();
    let expected = "master_rad rad, motor_v V, slave_rad rad, slave_torque_nm N·m, t_s s";
    assert_eq!(text.join(", "), expected);
    assert_eq!(found.metadata["farreach.rig"], "hydrostatic");
}

#[test]
fn columns_have_types_and_the_file_says_which_rig_and_units() {
    let folder = Folder::new();
    long::write(&folder.path("run.mcap"), 1);
    let found = compare(&folder, "run.mcap", "sample", &["--topic", "sample"]);
    let recording = Recording::open(&folder.path("run.mcap")).unwrap();
    let rig_file = recording.metadata("rig_file").unwrap();
    assert_eq!(found.metadata["farreach.rig_file"], rig_file);
    assert_eq!(found.metadata["farreach.session"], "11");
    assert!(!found.metadata.contains_key("farreach.checksum"));
    let units: BTreeMap<String, String> = serde_json::from_str(&found.metadata["units"]).unwrap();
    for (column, unit) in [
        ("log_time_ns", "ns"),
        ("scan_time_ns", "ns"),
        // The rig's axis 0 is a rotary one; it has no axis 1.
        ("master_position_0", "rad"),
        ("slave_torque_0", "N·m"),
        ("slave_torque_1", "N·m or N"),
        ("analog_v_3", "V"),
    ] {
        assert_eq!(units[column], unit, "{column}");
    }
    assert!(!units.contains_key("tick") && !units.contains_key("gate_state"), "{units:?}");
    for (column, kind) in [
        ("tick", "INT64"),
        ("analog_v_0", "DOUBLE"),
        ("digital_in", "INT32"),
        ("gate_state", "INT32"),
    ] {
        assert_eq!(found.kinds[column], kind, "{column}");
    }
    let sender = found.columns.iter().find(|(name, _)| name == "incarnation").unwrap();
    assert_eq!(found.metadata["incarnations"], format!("[{}]", sender.1[0]));

    let reader = File::open(folder.path("sample.parquet")).unwrap();
    let reader = SerializedFileReader::new(reader).unwrap();
    let time = reader.metadata().file_metadata().schema_descr().column(0);
    let instant = LogicalType::timestamp(true, TimeUnit::NANOS);
    assert_eq!(time.logical_type_ref(), Some(&instant));
}

#[test]
fn a_topic_without_messages_has_its_columns() {
    let folder = Folder::new();
    short::write(&folder.path("run.mcap"), 0..20, true);
    let found = compare(&folder, "run.mcap", "token", &["--topic", "token"]);
    assert!(found.columns.len() > 10 && found.groups == 0);
    assert_eq!(found.metadata["incarnations"], "[]");
}

#[test]
fn nothing_is_overwritten_or_half_written() {
    let folder = Folder::new();
    long::write(&folder.path("run.mcap"), 2);
    let run = folder.text("run.mcap");
    fs::write(folder.path("there.parquet"), "somebody's").unwrap();
    let there = folder.text("there.parquet");
    let words = ["export", &run, "--to", "parquet", "--topic", "sample", "-o", &there];
    let error = fails(&words);
    assert!(error.contains("never overwritten"), "{error}");
    assert_eq!(fs::read(folder.path("there.parquet")).unwrap(), b"somebody's");

    // A damaged chunk behind whole ones.
    let mut bytes = fs::read(&run).unwrap();
    let at = bytes.len() / 2;
    bytes[at] ^= 1;
    fs::write(folder.path("damaged.mcap"), bytes).unwrap();
    let damaged = folder.text("damaged.mcap");
    for topic in [None, Some("sample")] {
        let out = folder.text("never.parquet");
        let mut words = vec!["export", &damaged, "--to", "parquet", "-o", &out];
        words.extend(topic.iter().flat_map(|topic| ["--topic", topic]));
        let error = fails(&words);
        assert!(error.contains("damaged at byte"), "{error}");
    }
    let mut left: Vec<_> =
        fs::read_dir(folder.path("")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["damaged.mcap", "run.mcap", "there.parquet"]);

    let error = fails(&["export", &run, "--to", "parquet", "--topic", "smaple", "-o", "x"]);
    assert!(error.contains("no topic `smaple`"), "{error}");
    assert!(Line::try_parse_from(["rec", "export", "x", "--to", "parquet"]).is_err());
}

#[test]
fn a_torn_recording_gives_what_it_has_with_its_exit_code() {
    let folder = Folder::new();
    short::write(&folder.path("killed.mcap"), 0..2000, false);
    let (run, out) = (folder.text("killed.mcap"), folder.text("killed.parquet"));
    let words = ["export", &run, "--to", "parquet", "--topic", "sample", "-o", &out];
    assert_eq!(rec(&words).0, DATA_LOST);
    assert!(!read(&folder.path("killed.parquet")).columns[0].1.is_empty());
}
