//! Measured records: every way in which the data can be wrong is named with its place.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;

use common::{PERIOD_NS, sample, start, write_file};
use ipc_types::{CardKind, SAMPLE, Sample};
use proptest::prelude::*;
use recording::mcap_write::Writer;
use recording::record::*;

fn csv(text: &str, options: &Options) -> Result<Record, RecordError> {
    from_csv_text(Path::new("r.csv"), text.as_bytes(), options)
}

fn table(rows: usize, mut row: impl FnMut(usize) -> String) -> String {
    let mut text = "t_s,motor_v,master_rad\n".to_owned();
    for i in 0..rows {
        text.push_str(&row(i));
        text.push('\n');
    }
    text
}

fn good(i: usize) -> String {
    format!("{:.4},{},{}", i as f64 * 5e-4, (i as f64 * 0.1).sin(), (i as f64 * 0.1).cos())
}

#[test]
fn a_sound_table_is_read_column_by_column() {
    let record = csv(&table(100, good), &Options::default().requiring(&["motor_v"])).unwrap();
    assert_eq!((record.len(), record.columns.len()), (100, 2));
    assert!((record.sampling_s - 5e-4).abs() < 1e-12);
    assert_eq!(record.column("motor_v").unwrap()[7], (0.7000000000000001f64).sin());
    assert_eq!(record.findings, vec![]);
}

#[test]
fn each_fault_is_named_with_row_and_column() {
    let with =
        |at: usize, text: &str| table(100, |i| if i == at { text.to_owned() } else { good(i) });
    let gap = table(100, |i| good(if i < 50 { i } else { i + 3 }));
    let jitter = with(40, "0.0201,1,1");
    let cases: Vec<(String, &str)> = vec![
        (
            with(10, "0.005,,1"),
            "r.csv: row 12, column `motor_v`: expected a finite number, found an empty cell",
        ),
        (
            with(10, "0.005,1,NaN"),
            "r.csv: row 12, column `master_rad`: expected a finite number, found `NaN`",
        ),
        (
            with(10, "0.005,inf,1"),
            "r.csv: row 12, column `motor_v`: expected a finite number, found `inf`",
        ),
        (
            with(10, "0.005,abc,1"),
            "r.csv: row 12, column `motor_v`: expected a finite number, found `abc`",
        ),
        (
            with(10, "0.005,1"),
            "r.csv: row 12: not a CSV table: expected 3 cells as in the header, found 2",
        ),
        (
            with(10, "0.0045,1,1"),
            "r.csv: row 12, column `t_s`: expected a time after 0.0045 s, found 0.0045 s",
        ),
        (
            with(10, "0.0001,1,1"),
            "r.csv: row 12, column `t_s`: expected a time after 0.0045 s, found 0.0001 s",
        ),
        (gap, "r.csv: row 52, column `t_s`: 3 samples are missing between 0.0245 s and 0.0265 s"),
        (jitter, "r.csv: row 42, column `t_s`: expected steps of 0.0005"),
        (table(3, good), "r.csv: expected at least 10 rows, found 3"),
        (table(0, good), "r.csv: expected at least 10 rows, found 0"),
        (
            String::new(),
            "r.csv: row 1: expected a header with the columns' names, found an empty file",
        ),
        (
            table(20, good).replace("t_s,motor_v,master_rad\n", ""),
            "expected a header with the columns' names, found the number 0.0000",
        ),
        (
            table(20, good).replace("t_s,", "time,"),
            "column `t_s` is missing; found time, motor_v, master_rad",
        ),
        (
            table(20, good).replace("master_rad", "motor_v"),
            "column `motor_v` occurs twice (columns 2 and 3)",
        ),
        (table(20, good).replace("motor_v", ""), "no name for column 2"),
        (
            table(20, good).replace("motor_v", "voltage"),
            "column `motor_v` is missing; found master_rad, voltage",
        ),
    ];
    for (text, expected) in cases {
        let error =
            csv(&text, &Options::default().requiring(&["motor_v"])).unwrap_err().to_string();
        assert!(error.contains(expected), "expected: {expected}\nfound:    {error}");
    }
    let error = from_csv(Path::new("/no/such.csv"), &Options::default()).unwrap_err().to_string();
    assert!(error.contains("/no/such.csv"), "{error}");
}

#[test]
fn a_byte_order_mark_and_blanks_do_no_harm() {
    let text = format!("\u{feff}{}", table(20, |i| format!(" {} ", good(i).replace(',', " , "))));
    assert_eq!(csv(&text, &Options::default()).unwrap().len(), 20);
}

#[test]
fn the_longest_run_is_kept_where_that_is_allowed_and_reported() {
    let text = table(100, |i| good(if i < 30 { i } else { i + 3 }));
    let record = csv(&text, &Options::default().gaps(Gaps::LongestRun)).unwrap();
    assert_eq!(record.len(), 70);
    let finding = &record.findings[0];
    assert_eq!((finding.kind, finding.first_row, finding.rows), (FindingKind::Masked, 32, 30));
}

#[test]
fn uneven_rows_are_resampled_where_that_is_allowed_and_told() {
    let options = Options { even_out: true, ..Options::default() };
    let row = |t: f64| format!("{t:.6},{:.9},{:.9}", (3.0 * t).sin(), (5.0 * t).cos());
    // A jitter of a tenth of the step, and two missing rows.
    let jitter = |i: usize| 0.01 * i as f64 + 0.001 * ((i * 7 % 5) as f64 - 2.0) / 2.0;
    let text = table(400, |i| row(jitter(if i < 100 { i } else { i + 2 })));
    assert!(csv(&text, &Options::default()).is_err());
    let record = csv(&text, &options).unwrap();
    let step = |at: usize| record.time_s[at + 1] - record.time_s[at];
    assert!((0..record.len() - 1).all(|at| (step(at) / step(0) - 1.0).abs() < 1e-6));
    let close = |(time, value): (&f64, &f64)| (value - (3.0 * time).sin()).abs() < 5e-3;
    assert!(record.time_s.iter().zip(record.column("motor_v").unwrap()).all(close));
    let finding = &record.findings[0];
    assert_eq!(finding.kind, FindingKind::Resampled);
    assert!(finding.text.contains("2 rows are missing"), "{}", finding.text);
    // A gap stays an error with its row; even rows stay as they are.
    let text = table(400, |i| row(jitter(if i < 100 { i } else { i + 5 })));
    let error = csv(&text, &options).unwrap_err().to_string();
    assert!(error.contains("row 102") && error.contains("samples are missing"), "{error}");
    let text = table(400, |i| row(0.01 * i as f64));
    assert_eq!(csv(&text, &options).unwrap(), csv(&text, &Options::default()).unwrap());
}

#[test]
fn dead_and_saturated_channels_are_findings() {
    let text = table(2000, |i| {
        format!("{:.4},0.25,{}", i as f64 * 5e-4, (i as f64 * 0.01).sin().min(0.8))
    });
    let record = csv(&text, &Options::default()).unwrap();
    let kinds: Vec<_> = record.findings.iter().map(|f| (f.column.as_str(), f.kind)).collect();
    assert_eq!(kinds, [("master_rad", FindingKind::Saturated), ("motor_v", FindingKind::Dead)]);
}

#[test]
fn samples_come_out_bit_identical() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 3000);
    let record =
        from_mcap(&path, &SampleColumns::new(ColumnNames::rotary()), &Options::default()).unwrap();
    assert_eq!(record.len(), 3000);
    assert_eq!(record.sampling_s, 5e-4);
    for i in 0..3000 {
        let s = sample(i as u64);
        for (name, value) in [
            ("motor_v", s.motor_v[0]),
            ("master_rad", s.master_position[0]),
            ("slave_rad", s.slave_position[0]),
            ("slave_torque_nm", s.slave_torque[0]),
        ] {
            assert_eq!(record.column(name).unwrap()[i].to_bits(), value.to_bits(), "{name} {i}");
        }
        assert_eq!(record.time_s[i], i as f64 * 5e-4);
    }
}

fn write(path: &Path, samples: impl IntoIterator<Item = Sample>) {
    let mut writer = Writer::create(path, &start(), 0).unwrap();
    for sample in samples {
        writer.write_message(&SAMPLE, &sample).unwrap();
    }
    writer.finish(&[]).unwrap();
}

#[test]
fn lost_samples_are_refused_or_masked_and_absent_channels_left_out() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(
        &path,
        (0..300).filter(|i| !(100..104).contains(i)).map(|i| {
            let mut s = sample(i);
            s.torque_present = 0;
            s.slave_present = u8::from(i > 150);
            s
        }),
    );
    let columns =
        SampleColumns { scan_hz: Some(2000.0), ..SampleColumns::new(ColumnNames::rotary()) };
    let error = from_mcap(&path, &columns, &Options::default()).unwrap_err().to_string();
    assert!(error.contains("row 101") && error.contains("4 samples are missing"), "{error}");
    let record = from_mcap(&path, &columns, &Options::default().gaps(Gaps::LongestRun)).unwrap();
    assert_eq!(record.len(), 196);
    assert_eq!(record.columns.keys().collect::<Vec<_>>(), ["master_rad", "motor_v"]);
    let kinds: Vec<_> = record.findings.iter().map(|f| f.kind).collect();
    assert_eq!(kinds, [FindingKind::Partial, FindingKind::Masked]);
    let error = from_mcap(
        &path,
        &columns,
        &Options::default().gaps(Gaps::LongestRun).requiring(&["slave_rad"]),
    );
    assert!(error.unwrap_err().to_string().contains("column `slave_rad` is missing"));
    let axis = SampleColumns { axis: 1, ..columns };
    assert!(matches!(
        from_mcap(&path, &axis, &Options::default()),
        Err(RecordError::Unusable { problem, .. }) if problem.starts_with("axis 1: ")
    ));
}

#[test]
fn other_axes_come_beside_the_axis_where_the_samples_have_them() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(
        &path,
        (0..100).map(|i| {
            let mut s = sample(i);
            (s.axes, s.slave_present) = (2, 0b11);
            s.slave_position[1] = -2.0 * i as f64;
            s
        }),
    );
    let other =
        |axis: usize, name: &str| (axis, ColumnNames::slave_only(column_of(name, "slave_rad")));
    let columns = SampleColumns {
        others: vec![other(1, "rotation"), other(2, "third"), other(7, "eighth")],
        scan_hz: Some(2000.0),
        ..SampleColumns::new(ColumnNames::rotary())
    };
    let record = from_mcap(&path, &columns, &Options::default()).unwrap();
    let names: Vec<&str> = record.columns.keys().map(String::as_str).collect();
    assert!(names.contains(&"slave_rad") && names.contains(&"rotation.slave_rad"), "{names:?}");
    assert!(!names.iter().any(|name| name.starts_with("third") || name.starts_with("eighth")));
    assert_eq!(record.column("rotation.slave_rad").unwrap()[7], -14.0);
}

#[test]
fn a_replayed_record_keeps_its_own_time_and_one_pass() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let replayed = |i: u64, at: f64| {
        let mut s = sample(i);
        s.backend = CardKind::Replay.code();
        s.record_time_s = at;
        s
    };
    write(&path, (0..250).map(|i| replayed(i, (i % 100) as f64 * 0.0016384)));
    let record =
        from_mcap(&path, &SampleColumns::new(ColumnNames::one_mass_linear()), &Options::default())
            .unwrap();
    assert_eq!(record.len(), 100);
    assert_eq!(record.time_s[99], 99.0 * 0.0016384);
    assert_eq!(record.findings[0].kind, FindingKind::Looped);
    assert!(record.columns.contains_key("position_m"));
    assert_eq!(record.column("position_m").unwrap()[5], sample(5).master_position[0]);
}

#[test]
fn a_recording_that_was_cut_off_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write_file(&path, 3000);
    let read = || {
        from_mcap(&path, &SampleColumns::new(ColumnNames::rotary()), &Options::default()).unwrap()
    };
    assert!(read().findings.iter().all(|finding| finding.kind != FindingKind::Torn));
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 2000]).unwrap();
    let record = read();
    let torn = record.findings.iter().find(|finding| finding.kind == FindingKind::Torn).unwrap();
    assert!(torn.text.contains(&format!("after sample {}", record.len())), "{torn:?}");
}

#[test]
fn repeated_samples_are_left_out_and_said() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(&path, (0..100).chain(99..200).map(sample));
    let record =
        from_mcap(&path, &SampleColumns::new(ColumnNames::rotary()), &Options::default()).unwrap();
    assert_eq!((record.len(), record.findings[0].kind), (200, FindingKind::Repeated));
    assert_eq!(record.time_s[199], 199.0 * PERIOD_NS as f64 * 1e-9);
}

#[test]
fn scans_that_a_new_acquisition_reads_again_are_left_out_and_a_clock_that_goes_back_is_not() {
    let dir = tempfile::tempdir().unwrap();
    let from = |incarnation: u64, tick: u64| Sample { incarnation, ..sample(tick) };
    let read = |name: &str, samples: Vec<Sample>| {
        let path = dir.path().join(name);
        write(&path, samples);
        from_mcap(&path, &SampleColumns::new(ColumnNames::rotary()), &Options::default())
    };
    // The one before had taken three scans, and was killed before it told the card.
    let taken_over = (0..100).map(|tick| from(1, tick)).chain((97..200).map(|tick| from(2, tick)));
    let record = read("taken-over.mcap", taken_over.collect()).unwrap();
    assert_eq!((record.len(), record.findings[0].rows), (200, 3));
    // The same by one and the same acquisition, or from long before, is no repetition.
    let back = (0..100).map(|tick| from(1, tick)).chain((97..200).map(|tick| from(1, tick)));
    assert!(read("back.mcap", back.collect()).is_err());
    let anew = (1000..1100).map(|tick| from(1, tick)).chain((0..200).map(|tick| from(2, tick)));
    assert!(read("anew.mcap", anew.collect()).is_err());
}

#[test]
fn the_measured_sets_of_others_are_read() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    for (name, rows, sampling_s, column) in [
        ("emps_train.csv", 24_841, 1e-3, "position_m"),
        ("silverbox_multisine.csv", 65_062, 0.0016384, "output"),
    ] {
        let path = data.join(name);
        if !path.exists() {
            eprintln!("SKIPPED: {} is not there", path.display());
            continue;
        }
        let record = from_csv(&path, &Options::default().requiring(&[column])).unwrap();
        assert_eq!(record.len(), rows);
        assert!((record.sampling_s / sampling_s - 1.0).abs() < 1e-6, "{}", record.sampling_s);
        eprintln!("{name}: {:?}", record.findings);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn csv_keeps_every_bit(
        values in prop::collection::vec(
            prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO,
            10..60,
        )
    ) {
        let record = Record {
            name: "r.csv".into(),
            time_s: (0..values.len()).map(|i| i as f64 * 5e-4).collect(),
            columns: [("input".to_owned(), values.clone())].into(),
            sampling_s: 5e-4,
            findings: vec![],
        };
        let mut text = Vec::new();
        write_csv(&record, &mut text).unwrap();
        let back = from_csv_text(Path::new("r.csv"), &text[..], &Options::default()).unwrap();
        for (a, b) in back.columns["input"].iter().zip(&values) {
            prop_assert_eq!(a.to_bits(), b.to_bits());
        }
        prop_assert_eq!(back.time_s, record.time_s);
    }
}

#[test]
fn columns_are_taken_from_where_the_mapping_says() {
    let text = table(100, good).replace("t_s,motor_v,master_rad", "time ms,u,angle");
    let mapping = |list: &[&str]| list.iter().map(|one| one.parse().unwrap()).collect();
    let with =
        |list: &[&str]| csv(&text, &Options { mapping: mapping(list), ..Options::default() });
    let record = with(&["t_s=time ms*1000", "motor_v=u*-2", "master_rad=angle"]).unwrap();
    let plain = csv(&table(100, good), &Options::default()).unwrap();
    assert_eq!(record.columns["master_rad"], plain.columns["master_rad"]);
    assert!((record.sampling_s - 1000.0 * plain.sampling_s).abs() < 1e-9);
    assert!(
        record.columns["motor_v"]
            .iter()
            .zip(&plain.columns["motor_v"])
            .all(|(a, b)| *a == -2.0 * b)
    );
    let said = with(&["t_s=time"]).unwrap_err().to_string();
    assert!(said.contains("column `time` is missing; found time ms, u, angle"), "{said}");
    let said = with(&["t_s=time ms", "angle=u"]).unwrap_err().to_string();
    assert!(said.contains("mapped by angle=u: column 3 already has that name"), "{said}");
}

#[test]
fn rows_that_are_not_even_can_be_brought_to_a_rate() {
    let uneven = table(200, |i| {
        format!("{:.6},{},{i}", i as f64 * 1e-3 + 1e-4 * (i % 2) as f64, i as f64 * 1e-3)
    });
    assert!(csv(&uneven, &Options::default()).unwrap_err().to_string().contains("resample"));
    let record =
        csv(&uneven, &Options { resample_hz: Some(1000.0), ..Options::default() }).unwrap();
    assert!((record.sampling_s - 1e-3).abs() < 1e-9);
    assert_eq!(record.findings[0].kind, FindingKind::Resampled);
    for (row, time) in record.time_s.iter().enumerate() {
        assert!((record.columns["motor_v"][row] - time).abs() < 1.1e-4);
    }
}
