//! Tables without a header, at the rate of acquisition: inputs, and what the subject saw.

use std::io::Write;
use std::path::PathBuf;

use flate2::Compression;
use flate2::write::GzEncoder;
use ipc_types::{BARS, PERFORMANCE, Performance};
use recording::mcap_write::key;
use rig::{ChannelKind, RigFile};
use serde_json::{Value, json};

use super::events::number;
use super::names::Names;
use super::run::Run;
use super::staged::Staged;
use crate::signals::{Signal, Source};

/// Keys of the sidecar, and columns of our own, that no channel's name may take.
const RESERVED: [&str; 7] =
    ["TaskName", "SamplingFrequency", "StartTime", "Columns", "PhysioType", "Farreach", "volume"];

/// A column: its name, what it is, and its unit.
struct Column {
    name: String,
    about: String,
    unit: Option<String>,
}

/// Writes the inputs (`physio`) and, where sessions had bars, what the subject saw (`stim`).
pub(super) fn write(
    run: &Run<'_>,
    names: &Names,
    datatype: &str,
    staged: &mut Staged,
) -> anyhow::Result<()> {
    let file = |suffix: &str| names.recording(datatype, "handle", suffix);
    let inputs: Vec<usize> = indices(run, |signal, rig| match signal.source {
        Source::Torque(_) | Source::MotorVolts(_) | Source::Sync(_) => true,
        Source::Analog(input, _) => kind_of(rig, input) != ChannelKind::Emg,
        Source::Master(_) | Source::Slave(_) => false,
    });
    let mut columns: Vec<Column> = inputs.iter().map(|at| column_of(run, *at)).collect();
    for at in 0..columns.len() {
        let taken = |name: &str| {
            RESERVED.contains(&name) || columns[..at].iter().any(|column| column.name == name)
        };
        let mut name = columns[at].name.clone();
        while taken(&name) {
            name.push_str("_input");
        }
        columns[at].name = name;
    }
    if run.scan {
        columns.push(Column {
            name: "volume".to_owned(),
            about: "Number of the newest stored volume, from 0".to_owned(),
            unit: None,
        });
    }
    let mut volumes = 0;
    table(run, &inputs, file("physio.tsv.gz"), staged, |row, values, cells| {
        cells.extend(values.iter().map(|value| number(*value)));
        if run.scan {
            let at_ns = run.time_of_row(row);
            volumes += run.volumes[volumes..].iter().take_while(|volume| **volume <= at_ns).count();
            cells.push(volumes.checked_sub(1).map_or("n/a".to_owned(), |at| at.to_string()));
        }
    })?;
    let mut about = sidecar(run, &columns);
    about["PhysioType"] = "generic".into();
    about["Farreach"] = json!({
        "Version": run.version(),
        "Recording": run.recording.path().file_name().map(|name| name.to_string_lossy()),
        "Rig": run.recording.metadata(key::RIG),
        "RigFile": run.recording.metadata(key::RIG_FILE),
        "Protocol": run.protocol,
        "ProtocolFile": run.protocol_text,
    });
    staged.json(file("physio.json"), &about)?;
    seen_by_subject(run, |suffix| names.recording(datatype, "screen", suffix), staged)
}

/// Writes bars and light, where a session had them.
fn seen_by_subject(
    run: &Run<'_>,
    file: impl Fn(&str) -> PathBuf,
    staged: &mut Staged,
) -> anyhow::Result<()> {
    let mut shown: Vec<Performance> = Vec::new();
    for message in run.recording.messages_if_any::<Performance>(PERFORMANCE.topic.name)? {
        let message = message?.message;
        if (run.first_ns..run.ended_ns).contains(&message.at_ns) {
            shown.push(message);
        }
    }
    shown.sort_by_key(|message| message.at_ns);
    let bars = shown.iter().map(|message| usize::from(message.bars)).max().unwrap_or(0).min(BARS);
    if shown.is_empty() {
        return Ok(());
    }
    let column = |name: String, about: &str, unit: Option<&str>| Column {
        name,
        about: about.to_owned(),
        unit: unit.map(str::to_owned),
    };
    let mut columns = vec![
        column("light".to_owned(), "The subject's light: 1 green, 0 red", None),
        column("replay".to_owned(), "1 while the bar repeats the last session", None),
    ];
    for bar in 1..=bars {
        let heights = "Height of the bar, 0 to 19 of 20; the target is at 10";
        columns.push(column(format!("height_{bar}"), heights, None));
        let value = "What the bar compares with its target, in the unit of what is matched";
        columns.push(column(format!("value_{bar}"), value, None));
    }
    let mut next = 0;
    table(run, &[], file("stim.tsv.gz"), staged, |row, _, cells| {
        let at_ns = run.time_of_row(row);
        next += shown[next..].iter().take_while(|message| message.at_ns <= at_ns).count();
        let newest = next.checked_sub(1).map(|at| &shown[at]);
        let none = || "n/a".to_owned();
        cells.push(newest.map_or_else(none, |message| message.light.to_string()));
        cells.push(newest.map_or_else(none, |message| message.replay.to_string()));
        for bar in 0..bars {
            let seen = newest.filter(|message| bar < usize::from(message.bars));
            cells.push(seen.map_or_else(none, |message| number(message.height[bar])));
            cells.push(seen.map_or_else(none, |message| number(message.value[bar])));
        }
    })?;
    staged.json(file("stim.json"), &sidecar(run, &columns))
}

/// Writes a packed table, as [`write_rows`].
fn table(
    run: &Run<'_>,
    signals: &[usize],
    file: PathBuf,
    staged: &mut Staged,
    cells: impl FnMut(u64, &[f64], &mut Vec<String>),
) -> anyhow::Result<()> {
    let mut packed = GzEncoder::new(staged.create(file)?, Compression::default());
    write_rows(run, signals, &mut packed, cells)?;
    Ok(packed.finish()?.flush()?)
}

/// Writes the rows of a table: `cells` gets the number of each, and its values of these signals.
pub(super) fn write_rows(
    run: &Run<'_>,
    signals: &[usize],
    out: &mut impl Write,
    mut cells: impl FnMut(u64, &[f64], &mut Vec<String>),
) -> anyhow::Result<()> {
    let mut row = Vec::new();
    run.each_row(signals, |number, _, values| {
        cells(number, values, &mut row);
        writeln!(out, "{}", row.join("\t"))?;
        row.clear();
        Ok(())
    })
}

fn sidecar(run: &Run<'_>, columns: &[Column]) -> Value {
    let mut about = json!({
        "TaskName": run.protocol,
        "SamplingFrequency": run.rate_hz(),
        "StartTime": Run::seconds(run.first_ns, run.zero_ns),
        "Columns": columns.iter().map(|column| column.name.as_str()).collect::<Vec<_>>(),
    });
    for column in columns {
        about[&column.name] = match &column.unit {
            Some(unit) => json!({"Description": column.about, "Units": unit}),
            None => json!({"Description": column.about}),
        };
    }
    about
}

/// The signals that are wanted, as indices.
pub(super) fn indices(run: &Run<'_>, wanted: impl Fn(&Signal, &RigFile) -> bool) -> Vec<usize> {
    let signals = run.samples.signals.iter().enumerate();
    signals.filter(|(_, signal)| wanted(signal, &run.samples.rig)).map(|(at, _)| at).collect()
}

/// What an input of the card measures.
pub(super) fn kind_of(rig: &RigFile, input: usize) -> ChannelKind {
    rig.channel_at(input).map_or(ChannelKind::Other, |channel| channel.kind)
}

fn column_of(run: &Run<'_>, at: usize) -> Column {
    let Signal { name, unit, source } = &run.samples.signals[at];
    let of = |axis: usize| run.samples.rig.axes.get(axis).map_or("", |axis| axis.name.as_str());
    let (name, about) = match source {
        Source::Analog(input, _) if kind_of(&run.samples.rig, *input) == ChannelKind::Trigger => {
            ("trigger", format!("The scanner's trigger line: {name}"))
        }
        Source::Torque(axis) => (
            name.as_str(),
            format!("What the hand applies to {}, positive when it drives it positive", of(*axis)),
        ),
        Source::MotorVolts(axis) => (name.as_str(), format!("Volts at the motor of {}", of(*axis))),
        Source::Analog(input, _) => (name.as_str(), format!("Input {input} of the card")),
        Source::Sync(_) => (
            name.as_str(),
            "1 during the pulse that the card gives at a session's beginning".to_owned(),
        ),
        Source::Master(_) | Source::Slave(_) => (name.as_str(), "Position".to_owned()),
    };
    Column { name: name.to_owned(), about, unit: Some(unit.clone()) }
}
