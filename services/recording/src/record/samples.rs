//! Records from farreach's recordings.

use std::collections::BTreeMap;
use std::path::Path;

use ipc_types::{ANALOG, AXES, SAMPLE, Sample};

use super::stretches::{Channel, Samples};
use super::{Draft, Finding, FindingKind, Options, Problem, Record, RecordError, TIME, Table};
use crate::column::{Column, Storage};
use crate::mcap_read::{Recorded, Recording};

/// How the channels of an axis are named in the record; `None` leaves a channel out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColumnNames {
    /// Motor volts at the card's output (V).
    pub motor: Option<String>,
    /// Position of the master (rad or m).
    pub master: Option<String>,
    /// Position of the slave (rad or m).
    pub slave: Option<String>,
    /// Torque or force of the hand (N·m or N).
    pub torque: Option<String>,
}

impl ColumnNames {
    /// `motor_v, master_rad, slave_rad, slave_torque_nm`.
    pub fn rotary() -> Self {
        Self::named(["motor_v", "master_rad", "slave_rad", "slave_torque_nm"])
    }
    /// `motor_v, master_m, slave_m, slave_force_n`.
    pub fn linear() -> Self {
        Self::named(["motor_v", "master_m", "slave_m", "slave_force_n"])
    }
    /// One mass that moves along a line: `motor_v, position_m, force_n`.
    pub fn one_mass_linear() -> Self {
        Self { slave: None, ..Self::named(["motor_v", "position_m", "", "force_n"]) }
    }
    /// One mass that turns: `motor_v, position_rad, torque_nm`.
    pub fn one_mass_rotary() -> Self {
        Self { slave: None, ..Self::named(["motor_v", "position_rad", "", "torque_nm"]) }
    }
    /// The position of the slave alone.
    pub fn slave_only(name: String) -> Self {
        Self { motor: None, master: None, slave: Some(name), torque: None }
    }
    fn named([motor, master, slave, torque]: [&str; 4]) -> Self {
        let name = |text: &str| Some(text.to_owned());
        Self { motor: name(motor), master: name(master), slave: name(slave), torque: name(torque) }
    }
}

/// Selection of the record's columns from the samples.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleColumns {
    /// Axis, from 0.
    pub axis: usize,
    /// Names of its channels.
    pub names: ColumnNames,
    /// Further axes, with the names of their channels. An axis that the samples do not have is
    /// left out.
    pub others: Vec<(usize, ColumnNames)>,
    /// Further analog channels as read, in volts: channel and name of the column.
    pub analog: Vec<(usize, String)>,
    /// Scan rate by the rig file (Hz); `None`: taken from scan times and ticks.
    pub scan_hz: Option<f64>,
}

impl SampleColumns {
    /// Axis 0 with these names.
    pub fn new(names: ColumnNames) -> Self {
        Self { axis: 0, names, others: Vec::new(), analog: Vec::new(), scan_hz: None }
    }
}

/// Reads the samples of a recording.
///
/// # Errors
/// As [`from_recording`], and those of opening the file.
pub fn from_mcap(
    path: &Path,
    columns: &SampleColumns,
    options: &Options,
) -> Result<Record, RecordError> {
    from_recording(&Recording::open(path)?, columns, options)
}

/// Reads the samples of an open recording. Values are taken bit by bit. Time is that within the
/// replayed record where acquisition replayed one, else the tick's: 0 at the first sample.
///
/// # Errors
/// [`RecordError`]: the first problem, with the sample's number as row. A damaged chunk
/// is an error too.
pub fn from_recording(
    recording: &Recording,
    columns: &SampleColumns,
    options: &Options,
) -> Result<Record, RecordError> {
    draft(recording, columns, options, &Storage::Memory)?.finish(recording.path(), options)
}

/// As [`from_recording`], for whoever writes the record and needs it in no memory: its columns are
/// in `storage`.
///
/// # Errors
/// As [`from_recording`], and those of the storage.
pub fn table_from_recording(
    recording: &Recording,
    columns: &SampleColumns,
    options: &Options,
    storage: &Storage,
) -> Result<Table, RecordError> {
    draft(recording, columns, options, storage)?.finish_table(recording.path(), options)
}

fn draft(
    recording: &Recording,
    columns: &SampleColumns,
    options: &Options,
    storage: &Storage,
) -> Result<Draft, RecordError> {
    let file = recording.path();
    let wrong = |what: String| Problem(format!("axis {}: {what}", columns.axis)).of(file);
    if columns.axis >= AXES {
        return Err(wrong(format!("expected an axis below {AXES}")));
    }
    let axes = std::iter::once(columns.axis).chain(columns.others.iter().map(|(axis, _)| *axis));
    let homed = axes.filter(|&axis| axis < AXES).fold(0, |bits, axis| bits | 1u8 << axis);
    let mut samples = Samples::new(channels(columns).map_err(wrong)?, homed, storage);
    let mut number = 0;
    recording.each(SAMPLE.topic.name, |Recorded { message, .. }: Recorded<Sample>| {
        number += 1;
        samples.take(number, &message).map_err(|error| Problem::from(error).of(file))
    })?;
    let Some(first) = samples.first() else {
        return Err(Problem::too_few_rows(options.rows_min, 0).of(file));
    };
    if columns.axis >= usize::from(first.axes) {
        return Err(wrong(format!("the recording has {} axes", first.axes)));
    }
    let mut findings = Vec::new();
    if samples.repeated > 0 {
        let repeated = samples.repeated;
        findings.push(Finding {
            column: TIME.to_owned(),
            kind: FindingKind::Repeated,
            first_row: 1,
            rows: repeated,
            text: format!("{repeated} samples occur twice: the repetitions were left out"),
        });
    }
    if !recording.tail.complete {
        findings.push(Finding {
            column: TIME.to_owned(),
            kind: FindingKind::Torn,
            first_row: samples.last_row(),
            rows: 0,
            text: format!(
                "{}; what came after sample {} is missing",
                recording.tail.reason,
                samples.len()
            ),
        });
    }
    kept(samples, columns, findings).map_err(|problem| match problem {
        Unkept::Axis(what) => wrong(what),
        Unkept::Other(problem) => problem.of(file),
    })
}

/// Why no samples can be kept.
enum Unkept {
    /// Something about the axis.
    Axis(String),
    Other(Problem),
}

impl From<Problem> for Unkept {
    fn from(problem: Problem) -> Self {
        Self::Other(problem)
    }
}

/// The samples of one stretch, with the columns whose channels are present in all of them.
fn kept(
    samples: Samples,
    columns: &SampleColumns,
    mut findings: Vec<Finding>,
) -> Result<Draft, Unkept> {
    let Some((stretch, mut read)) = samples.finish(&mut findings) else {
        return Err(Problem::too_few_rows(1, 0).into());
    };
    let pass = stretch.pass();
    let mut time_s = std::mem::take(&mut read.time);
    let mut rows = std::mem::take(&mut read.rows);
    time_s.cut(pass.rows.clone());
    rows.cut(pass.rows.clone());
    if !stretch.is_replayed() {
        let period_s = match columns.scan_hz {
            Some(hz) => 1.0 / hz,
            None => stretch.period_s().ok_or_else(|| {
                let what = "the scan rate cannot be told from the samples: give the rig file";
                Unkept::Axis(what.to_owned())
            })?,
        };
        time_s = seconds(&time_s, &rows, period_s, &read.storage)?;
    }
    let mut picked: BTreeMap<String, Column> = BTreeMap::new();
    for ((channel, mut values), there) in read.channels.into_iter().zip(&pass.present) {
        if *there == pass.rows.len() {
            values.cut(pass.rows.clone());
            picked.insert(channel.name, values);
        } else if *there > 0 {
            findings.push(Finding {
                column: channel.name,
                kind: FindingKind::Partial,
                first_row: 1,
                rows: *there as u64,
                text: format!("present in {there} of {} samples only: left out", pass.rows.len()),
            });
        }
    }
    if picked.is_empty() {
        return Err(Unkept::Axis("none of its channels is present".to_owned()));
    }
    Ok(Draft { time_s, rows, columns: picked, findings })
}

/// Ticks since the first sample as times (s).
fn seconds(
    ticks: &Column,
    rows: &Column,
    period_s: f64,
    storage: &Storage,
) -> Result<Column, Problem> {
    let (mut time_s, mut cursor) = (Column::new(storage), ticks.cursor());
    for at in 0..ticks.len() {
        let since = cursor.at(at)?;
        if since < 0.0 {
            let row = rows.cursor().at(at)? as u64;
            return Err(Problem::time_backwards(row, 0.0, since * period_s));
        }
        time_s.push(since * period_s)?;
    }
    Ok(time_s)
}

/// The channels that are wanted.
fn channels(columns: &SampleColumns) -> Result<Vec<Channel>, String> {
    type Read = fn(&Sample, usize) -> f64;
    type Present = fn(&Sample, usize) -> bool;
    let of_axis = |(axis, names): (usize, &ColumnNames)| {
        let channels: [(&Option<String>, Present, Read); 4] = [
            (&names.motor, |s, i| s.motor_present >> i & 1 == 1, |s, i| s.motor_v[i]),
            (&names.master, |s, i| s.master_present >> i & 1 == 1, |s, i| s.master_position[i]),
            (&names.slave, |s, i| s.slave_present >> i & 1 == 1, |s, i| s.slave_position[i]),
            (&names.torque, |s, i| s.torque_present >> i & 1 == 1, |s, i| s.slave_torque[i]),
        ];
        channels.map(|(name, present, read)| {
            Some(Channel { name: name.clone()?, index: axis, present, read })
        })
    };
    let others = columns.others.iter().map(|(axis, names)| (*axis, names));
    let axis_channels = std::iter::once((columns.axis, &columns.names))
        .chain(others.filter(|(axis, _)| *axis < AXES))
        .flat_map(of_axis)
        .flatten();
    let analog: (Present, Read) = (|s, i| s.analog_present >> i & 1 == 1, |s, i| s.analog_v[i]);
    let further = columns.analog.iter().map(|(channel, name)| Channel {
        name: name.clone(),
        index: *channel,
        present: analog.0,
        read: analog.1,
    });
    let wanted: Vec<Channel> = axis_channels.chain(further).collect();
    match wanted.iter().find(|channel| channel.index >= ANALOG) {
        Some(Channel { name, index, .. }) => Err(format!(
            "column `{name}`: expected an analog channel below {ANALOG}, found {index}"
        )),
        None => Ok(wanted),
    }
}
