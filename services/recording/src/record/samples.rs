//! Records from farreach's recordings.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use ipc_types::{ANALOG, AXES, CARD_FIFO, CardKind, SAMPLE, Sample};

use super::{Draft, Finding, FindingKind, Options, Problem, Record, RecordError, TIME};
use crate::mcap_read::Recording;

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

/// Whether the card may deliver a scan again to an acquisition that takes over.
const fn read_again(newest: u64, tick: u64) -> bool {
    tick < newest && newest - tick <= CARD_FIFO as u64
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
    let file = recording.path();
    let wrong = |what: String| Problem(format!("axis {}: {what}", columns.axis)).of(file);
    if columns.axis >= AXES {
        return Err(wrong(format!("expected an axis below {AXES}")));
    }
    let (mut samples, repeated) = distinct_samples(recording)?;
    let Some((_, first)) = samples.first().copied() else {
        return Err(Problem::too_few_rows(options.rows_min, 0).of(file));
    };
    if columns.axis >= usize::from(first.axes) {
        return Err(wrong(format!("the recording has {} axes", first.axes)));
    }
    let mut findings = Vec::new();
    if repeated > 0 {
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
            first_row: samples.last().map_or(0, |(row, _)| *row),
            rows: 0,
            text: format!(
                "{}; what came after sample {} is missing",
                recording.tail.reason,
                samples.len()
            ),
        });
    }
    findings.extend(one_zero(&mut samples, columns));
    let first = samples.first().map_or(first, |(_, sample)| *sample);
    let replayed = first.backend == CardKind::Replay.code();
    let time_s = if replayed {
        findings.extend(one_pass(&mut samples));
        samples.iter().map(|(_, sample)| sample.record_time_s).collect()
    } else {
        let period_s = match columns.scan_hz {
            Some(hz) => 1.0 / hz,
            None => period_s(&samples).ok_or_else(|| {
                wrong("the scan rate cannot be told from the samples: give the rig file".to_owned())
            })?,
        };
        samples
            .iter()
            .map(|(row, sample)| match sample.tick.checked_sub(first.tick) {
                Some(ticks) => Ok(ticks as f64 * period_s),
                None => {
                    let after = -((first.tick - sample.tick) as f64) * period_s;
                    Err(Problem::time_backwards(*row, 0.0, after).of(file))
                }
            })
            .collect::<Result<_, _>>()?
    };
    let picked = pick(&samples, columns, &mut findings).map_err(wrong)?;
    if picked.is_empty() {
        return Err(wrong("none of its channels is present".to_owned()));
    }
    let rows = samples.iter().map(|(row, _)| *row).collect();
    Draft { time_s, rows, columns: picked, findings }.finish(file, options)
}

/// The samples with their numbers in the file from 1, and how many repetitions were left out.
fn distinct_samples(recording: &Recording) -> Result<(Vec<(u64, Sample)>, u64), RecordError> {
    let mut samples: Vec<(u64, Sample)> = Vec::new();
    let mut repeated = 0u64;
    for (index, sample) in recording.messages::<Sample>(SAMPLE.topic.name)?.enumerate() {
        let sample = sample?.message;
        // An acquisition that takes over reads again the scans that its predecessor had not
        // acknowledged to the card.
        match samples.last() {
            Some((_, last))
                if last.tick == sample.tick
                    || last.incarnation != sample.incarnation
                        && read_again(last.tick, sample.tick) =>
            {
                repeated += 1;
            }
            _ => samples.push((index as u64 + 1, sample)),
        }
    }
    Ok((samples, repeated))
}

/// The columns whose channels are present in every sample.
fn pick(
    samples: &[(u64, Sample)],
    columns: &SampleColumns,
    findings: &mut Vec<Finding>,
) -> Result<BTreeMap<String, Vec<f64>>, String> {
    let mut picked: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    type Read = fn(&Sample, usize) -> f64;
    type Present = fn(&Sample, usize) -> bool;
    let of_axis = |(axis, names): (usize, &ColumnNames)| {
        let channels: [(&Option<String>, Present, Read); 4] = [
            (&names.motor, |s, i| s.motor_present >> i & 1 == 1, |s, i| s.motor_v[i]),
            (&names.master, |s, i| s.master_present >> i & 1 == 1, |s, i| s.master_position[i]),
            (&names.slave, |s, i| s.slave_present >> i & 1 == 1, |s, i| s.slave_position[i]),
            (&names.torque, |s, i| s.torque_present >> i & 1 == 1, |s, i| s.slave_torque[i]),
        ];
        channels.map(|(name, p, r)| Some((name.clone()?, axis, p, r)))
    };
    let others = columns.others.iter().map(|(axis, names)| (*axis, names));
    let axis_channels = std::iter::once((columns.axis, &columns.names))
        .chain(others.filter(|(axis, _)| *axis < AXES))
        .flat_map(of_axis)
        .flatten();
    let analog: (Present, Read) = (|s, i| s.analog_present >> i & 1 == 1, |s, i| s.analog_v[i]);
    let further =
        columns.analog.iter().map(|(channel, name)| (name.clone(), *channel, analog.0, analog.1));
    for (name, index, present, read) in axis_channels.chain(further) {
        if index >= ANALOG {
            return Err(format!(
                "column `{name}`: expected an analog channel below {ANALOG}, found {index}"
            ));
        }
        let there = samples.iter().filter(|(_, sample)| present(sample, index)).count();
        if there == samples.len() {
            picked.insert(name, samples.iter().map(|(_, sample)| read(sample, index)).collect());
        } else if there > 0 {
            findings.push(Finding {
                column: name,
                kind: FindingKind::Partial,
                first_row: 1,
                rows: there as u64,
                text: format!("present in {there} of {} samples only: left out", samples.len()),
            });
        }
    }
    Ok(picked)
}

/// Positions that count from different zeros make no record: keeps the longest stretch with the
/// same zeros, among those where the record's axes are homed if there is one.
fn one_zero(samples: &mut Vec<(u64, Sample)>, columns: &SampleColumns) -> Option<Finding> {
    let axes = std::iter::once(columns.axis).chain(columns.others.iter().map(|(axis, _)| *axis));
    let wanted = axes.filter(|&axis| axis < AXES).fold(0, |bits, axis| bits | 1u8 << axis);
    let zeros = |sample: &Sample| (sample.homing_sequence, sample.homed & wanted);
    let homed =
        |sample: &Sample| sample.homed & wanted == wanted & ((1u8 << sample.axes.min(7)) - 1);
    keep_one(
        samples,
        FindingKind::Rezeroed,
        |before, sample| zeros(before) != zeros(sample),
        |rows, first| (homed(first), rows.len()),
        |stretches, kept| {
            format!(
                "positions count from {stretches} different zeros (homing): kept the longest \
                 stretch, {kept} samples"
            )
        },
    )
}

/// A record that was replayed in a loop contains several passes: keeps the longest, the first of
/// equal ones.
fn one_pass(samples: &mut Vec<(u64, Sample)>) -> Option<Finding> {
    keep_one(
        samples,
        FindingKind::Looped,
        |before, sample| sample.record_time_s < before.record_time_s,
        |rows, _| (rows.len(), Reverse(rows.start)),
        |passes, kept| {
            format!("the record was replayed {passes} times: kept the longest pass, {kept} samples")
        },
    )
}

/// Keeps the stretch of samples that ranks highest, by its rows and its first sample. A stretch
/// `begins` at a sample that differs from the one before. `None` where there is one stretch; the
/// text of the finding tells the number of stretches and of samples kept.
fn keep_one<Rank: Ord>(
    samples: &mut Vec<(u64, Sample)>,
    kind: FindingKind,
    begins: impl Fn(&Sample, &Sample) -> bool,
    rank: impl Fn(&Range<usize>, &Sample) -> Rank,
    text: impl Fn(usize, usize) -> String,
) -> Option<Finding> {
    let mut starts = vec![0];
    starts.extend((1..samples.len()).filter(|&i| begins(&samples[i - 1].1, &samples[i].1)));
    let stretches = starts.len();
    if stretches == 1 {
        return None;
    }
    starts.push(samples.len());
    let rows = starts.windows(2).map(|pair| pair[0]..pair[1]);
    let best = rows.max_by_key(|rows| rank(rows, &samples[rows.start].1))?;
    let (all, first_row) = (samples.len(), samples[best.start].0);
    *samples = samples.drain(best).collect();
    Some(Finding {
        column: TIME.to_owned(),
        kind,
        first_row,
        rows: (all - samples.len()) as u64,
        text: text(stretches, samples.len()),
    })
}

/// The grid's period (s). Ticks are multiples of it, and its rate is a whole number of Hz, so that
/// the mean over the recording, rounded, is exact.
fn period_s(samples: &[(u64, Sample)]) -> Option<f64> {
    let (_, first) = samples.first()?;
    let (_, last) = samples.last()?;
    let ticks = last.tick.checked_sub(first.tick).filter(|&ticks| ticks > 0)?;
    let span_ns = last.scan_time_ns.checked_sub(first.scan_time_ns).filter(|&span| span > 0)?;
    let hz = (ticks as f64 / (span_ns as f64 * 1e-9)).round();
    (hz >= 1.0).then(|| 1.0 / hz)
}
