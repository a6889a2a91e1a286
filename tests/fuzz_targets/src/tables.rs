//! Tables in CSV: measured records, and trajectories of protocols.

use std::path::Path;

use recording::record::{Gaps, Mapping, Options, Record, from_csv_text, write_csv};
use rig::protocol::Protocol;

use crate::{MemoryFile, Outcome, chosen, with_prefixes};

/// Reads a measured record as replay and `identify` do. The bits of the first byte choose how:
/// gaps, uneven rows, another rate, other names of the columns.
pub(crate) fn record(bytes: &[u8]) -> Outcome {
    let (bits, bytes) = chosen(bytes, 16);
    let has = |bit: usize| bits >> bit & 1 == 1;
    let mapping: Vec<Mapping> = match has(3) {
        true => vec!["master_rad=position_m*0.5".parse().expect("a mapping")],
        false => Vec::new(),
    };
    let options = Options {
        gaps: if has(0) { Gaps::LongestRun } else { Gaps::Refuse },
        even_out: has(1),
        resample_hz: has(2).then_some(800.0),
        mapping,
        ..Options::default()
    };
    let record = from_csv_text(Path::new("fuzz.csv"), bytes, &options);
    check_record(&record.map_err(|error| error.to_string())?);
    Ok(())
}

/// A record that was read is whole, and is the same when it is written and read again.
pub(crate) fn check_record(record: &Record) {
    let rows = record.len();
    assert!(rows >= 2 && record.sampling_s > 0.0, "{rows} rows, {} s", record.sampling_s);
    assert!(record.time_s.windows(2).all(|pair| pair[1] > pair[0]), "time goes back");
    for (name, values) in &record.columns {
        assert_eq!(values.len(), rows, "{name}");
        assert!(values.iter().all(|value| value.is_finite()), "{name}");
    }
    assert!(record.findings.iter().all(|finding| !finding.text.is_empty()));
    let mut text = Vec::new();
    write_csv(record, &mut text).expect("it is written to memory");
    let options = Options { rows_min: 2, time_tolerance: f64::INFINITY, ..Options::default() };
    let again = from_csv_text(Path::new("again.csv"), text.as_slice(), &options)
        .unwrap_or_else(|error| panic!("what was read cannot be read again: {error}"));
    assert!(again.columns == record.columns, "its columns change when it is written");
    assert!(again.time_s == record.time_s, "its time changes when it is written");
}

fn table(header: &str, rows: usize, row: impl Fn(f64) -> Vec<f64>) -> Vec<u8> {
    let mut text = format!("{header}\n");
    for index in 0..rows {
        let cells: Vec<String> = row(index as f64).iter().map(f64::to_string).collect();
        text += &format!("{}\n", cells.join(","));
    }
    text.into_bytes()
}

pub(crate) fn record_seeds() -> Vec<Vec<u8>> {
    let rotary = |at: f64| vec![at * 1e-3, (at * 0.1).sin(), (at * 0.1).cos()];
    let uneven = |at: f64| vec![at * 1e-3 + 1e-4 * (at * 7.0 % 5.0), at, 1e30];
    let gap = |at: f64| vec![if at < 20.0 { at } else { at + 7.0 } * 2e-3, -at, 0.1 + 0.2];
    let tables = [
        table("t_s,master_rad,motor_v", 30, rotary),
        table("t_s,position_m,force_n", 30, uneven),
        table("t_s, \"slave, rad\" ,motor_v", 40, gap),
        b"\xef\xbb\xbft_s;a\r\n0;1\r\n".to_vec(),
        b"t_s\n0\n1\n2\n3\n4\n5\n6\n7\n8\n9\n10\n".to_vec(),
    ];
    with_prefixes(0..16, &tables)
}

/// Reads a table that a protocol names. The first byte chooses how the column is found.
pub(crate) fn trajectory(bytes: &[u8]) -> Outcome {
    let (way, bytes) = chosen(bytes, 3);
    let table = MemoryFile::new(bytes);
    let column = match way {
        0 => "",
        1 => "column = \"slave_deg\"\n",
        _ => "column = \"x_m\"\n",
    };
    let text = format!(
        "[protocol]\nname = \"table\"\n\n[[segments]]\nkind = \"file\"\npath = \"{}\"\n{column}",
        table.path().display()
    );
    let file = MemoryFile::new(text.as_bytes());
    let protocol = Protocol::load(file.path()).map_err(|error| error.to_string())?;
    let again = Protocol::parse(protocol.text(), protocol.file_name()).expect("it was read");
    assert!(again == protocol, "it changes when its text is read again");
    crate::texts::check_protocol(&protocol);
    Ok(())
}

pub(crate) fn trajectory_seeds() -> Vec<Vec<u8>> {
    let tables = [
        table("t_s,slave_deg", 12, |at| vec![0.25 * at, 10.0 * at.sin()]),
        table("t_s,note,x_m", 9, |at| vec![at, 0.0, 0.01 * at]),
        b"# measured\nt_s, slave_deg\n0, 0\n1.5, 10\n2, 0\n".to_vec(),
    ];
    with_prefixes(0..3, &tables)
}
