//! The electrodes of a run, as BDF+.

use std::io::Write;

use recording::column::Column;
use rig::{Channel, ChannelKind};
use serde_json::json;

use super::continuous::{indices, kind_of};
use super::events;
use super::names::Names;
use super::run::Run;
use super::staged::Staged;
use crate::bdf_file::{BdfAnnotation, BdfHeader, BdfSignal, write_bdf};
use crate::signals::Source;

/// Characters of a signal's name in the file.
const LABEL: usize = 16;

/// Writes the electrodes, with the scanner's trigger; returns whether the rig has any.
pub(super) fn write(run: &Run<'_>, names: &Names, staged: &mut Staged) -> anyhow::Result<bool> {
    let recorded = |wanted: fn(ChannelKind) -> bool| {
        indices(run, |signal, rig| match signal.source {
            Source::Analog(input, _) => wanted(kind_of(rig, input)),
            _ => false,
        })
    };
    let electrodes = recorded(|kind| kind == ChannelKind::Emg).len();
    if electrodes == 0 {
        return Ok(false);
    }
    let channels: Vec<(usize, &Channel)> =
        recorded(|kind| matches!(kind, ChannelKind::Emg | ChannelKind::Trigger))
            .into_iter()
            .filter_map(|at| Some((at, channel_of(run, at)?)))
            .collect();
    write_signals(run, names, &channels, staged)?;
    let mut table = staged.create(names.file("emg", "channels.tsv"))?;
    writeln!(table, "name\ttype\tunits\tdescription\ttarget_muscle")?;
    for (_, channel) in &channels {
        writeln!(table, "{}", row(channel))?;
    }
    table.flush()?;
    let about = json!({
        "TaskName": run.protocol,
        "TaskDescription": run.description,
        "SamplingFrequency": run.rate_hz(),
        "RecordingType": "continuous",
        "RecordingDuration": run.duration_s(),
        "StartTime": Run::seconds(run.first_ns, run.zero_ns),
        "SoftwareFilters": "n/a",
        "HardwareFilters": "n/a",
        "EMGChannelCount": electrodes,
        "TriggerChannelCount": channels.len() - electrodes,
        "SoftwareVersions": format!("farreach {}", run.version()),
    });
    staged.json(names.file("emg", "emg.json"), &about)?;
    events::write(run, &names.file("emg", "events"), run.first_ns, staged)?;
    super::dataset::describe_electrodes(run, names, staged);
    super::dataset::note_file(run, names, &names.file("emg", "emg.bdf"), staged);
    Ok(true)
}

fn channel_of<'a>(run: &'a Run<'_>, at: usize) -> Option<&'a Channel> {
    let Source::Analog(input, _) = run.samples.signals[at].source else { return None };
    run.samples.rig.channel_at(input)
}

/// Name of a channel in the file: that of the rig file, where it fits.
fn label(channel: &Channel) -> String {
    let Channel { name, index, .. } = channel;
    let fits = name.len() <= LABEL && name.chars().all(|c| c.is_ascii_graphic() || c == ' ');
    if fits { name.clone() } else { format!("input {index}") }
}

fn row(channel: &Channel) -> String {
    let text = events::cell;
    let kind = if channel.kind == ChannelKind::Emg { "EMG" } else { "TRIG" };
    let group = channel.group.map_or_else(String::new, |group| format!(", {}", group.word()));
    format!(
        "{}\t{kind}\t{}\t{} at input {} of the card{group}\t{}",
        label(channel),
        text(&channel.unit),
        text(&channel.name),
        channel.index,
        text(&channel.muscle)
    )
}

fn write_signals(
    run: &Run<'_>,
    names: &Names,
    channels: &[(usize, &Channel)],
    staged: &mut Staged,
) -> anyhow::Result<()> {
    let labels: Vec<String> = channels.iter().map(|(_, channel)| label(channel)).collect();
    let rows = even_rows(run, channels)?;
    let signals: Vec<BdfSignal<'_>> = channels
        .iter()
        .zip(&labels)
        .zip(rows)
        .map(|(((_, channel), label), values)| BdfSignal {
            label,
            unit: &channel.unit,
            transducer: &channel.muscle,
            range: channel.range_v * channel.per_v,
            values,
        })
        .collect();
    let mut annotations: Vec<BdfAnnotation> = events::rows(run)
        .into_iter()
        .map(|row| BdfAnnotation {
            onset_s: Run::seconds(row.at_ns, run.first_ns),
            duration_s: Run::seconds(row.until_ns, row.at_ns),
            text: row.in_words(),
        })
        .collect();
    annotations.extend(missing(run)?);
    for (at, channel) in channels {
        annotations.extend(not_read(run, *at, &label(channel))?);
    }
    let header = BdfHeader {
        subject: &names.subject,
        equipment: "farreach",
        began_ns: run.wall_clock_ns(run.first_ns),
        rate_hz: run.rate_hz(),
    };
    let mut file = staged.create(names.file("emg", "emg.bdf"))?;
    write_bdf(&header, &signals, &annotations, &mut file)?;
    Ok(file.flush()?)
}

/// The values of each channel in an even table.
fn even_rows(run: &Run<'_>, channels: &[(usize, &Channel)]) -> anyhow::Result<Vec<Column>> {
    let signals: Vec<usize> = channels.iter().map(|(at, _)| *at).collect();
    let mut columns: Vec<Column> = signals.iter().map(|_| Column::new(&run.storage)).collect();
    run.each_row(&signals, |_, _, values| {
        for (column, value) in columns.iter_mut().zip(values) {
            column.push(*value)?;
        }
        Ok(())
    })?;
    Ok(columns)
}

/// The stretches without samples, which the file has as zeros; the last record is filled up so.
fn missing(run: &Run<'_>) -> anyhow::Result<Vec<BdfAnnotation>> {
    let rate_hz = u64::from(run.rate_hz());
    let filled = run.rows().next_multiple_of(rate_hz) - run.rows();
    let mut missing = Stretches::default();
    run.each_row(&[], |row, there, _| {
        missing.see(row, !there);
        Ok(())
    })?;
    let mut notes = missing.notes(run, "samples missing");
    if filled > 0 {
        notes.push(BdfAnnotation {
            onset_s: run.rows() as f64 / rate_hz as f64,
            duration_s: filled as f64 / rate_hz as f64,
            text: "after the end".to_owned(),
        });
    }
    Ok(notes)
}

/// The stretches in which the card did not read a channel.
fn not_read(run: &Run<'_>, at: usize, label: &str) -> anyhow::Result<Vec<BdfAnnotation>> {
    let mut absent = Stretches::default();
    run.each_row(&[at], |row, there, values| {
        absent.see(row, there && !values.iter().all(|value| value.is_finite()));
        Ok(())
    })?;
    Ok(absent.notes(run, &format!("{label} not read")))
}

/// Stretches of rows that have something: first row and number of rows.
#[derive(Default)]
struct Stretches(Vec<(u64, u64)>);

impl Stretches {
    fn see(&mut self, row: u64, has: bool) {
        if !has {
            return;
        }
        match self.0.last_mut() {
            Some((begun, length)) if *begun + *length == row => *length += 1,
            _ => self.0.push((row, 1)),
        }
    }

    /// A note on each stretch.
    fn notes(self, run: &Run<'_>, text: &str) -> Vec<BdfAnnotation> {
        let rate_hz = f64::from(run.rate_hz());
        let note = |(begun, length): (u64, u64)| BdfAnnotation {
            onset_s: begun as f64 / rate_hz,
            duration_s: length as f64 / rate_hz,
            text: text.to_owned(),
        };
        self.0.into_iter().map(note).collect()
    }
}
