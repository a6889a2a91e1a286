//! `export`.

use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use anyhow::bail;
use ipc_types::SAMPLE;
use recording::column::Storage;
use recording::mcap_read::{RawMessage, Recording, Selection};
use recording::record::{
    ColumnNames, FindingKind, Gaps, Options, SampleColumns, Table, table_from_recording,
};
use recording::schema::Layout;

use crate::args::ExportOptions;
use crate::output::{Output, beside, new_file, none_exists};
use crate::progress::Progress;
use crate::topic_rows::{Cell, TopicColumn, columns_of, each_part};
use crate::{DATA_LOST, ExportFormat, LengthUnit, bids, exit_code_of_tail, mat, parquet_export};

pub(crate) fn export(
    file: &Path,
    options: &ExportOptions,
    stdout: &mut Output<'_>,
) -> anyhow::Result<i32> {
    let ExportOptions { to: format, topic, unit, axis, out: to, bids } = options;
    let (topic, to) = (topic.as_deref(), to.as_deref());
    let is_table = matches!(format, ExportFormat::Csv | ExportFormat::Parquet);
    if !is_table && topic.is_some() {
        bail!("--topic: only csv and parquet have the fields of a topic");
    }
    if *format != ExportFormat::Bids
        && let Some(option) = bids.given()
    {
        bail!("{option}: it names parts of a dataset, with --to bids");
    }
    let target = match (format, to) {
        (ExportFormat::Csv, to) => Target::Csv(to),
        (_, None) => bail!("--out: say where to write"),
        (ExportFormat::Parquet, Some(path)) => Target::Parquet(path),
        (ExportFormat::Mat, Some(name)) => return mat::export(file, name, stdout),
        (ExportFormat::Bids, Some(folder)) => return bids::export(file, bids, folder, stdout),
    };
    if let Some(path) = to {
        none_exists(&[path])?;
    }
    let recording = Recording::open(file)?;
    let mut code = exit_code_of_tail(&recording);
    let channels = recording.channels_of(topic.unwrap_or(SAMPLE.topic.name))?;
    let selection = Selection { channels: Some(channels), ..Selection::default() };
    let progress = Progress::of([&recording], &selection, 1, false);
    let Some(topic) = topic else {
        let names = match unit {
            LengthUnit::Rad => ColumnNames::rotary(),
            LengthUnit::M => ColumnNames::linear(),
        };
        let columns = SampleColumns { axis: *axis, ..SampleColumns::new(names) };
        let record = record(&recording, &columns, to)?;
        drop(progress);
        for finding in &record.findings {
            eprintln!("{}: {}: {}", file.display(), finding.column, finding.text);
            if finding.kind == FindingKind::Masked {
                code = DATA_LOST;
            }
        }
        match target {
            Target::Csv(to) => write_to(to, stdout, |output| Ok(record.write_csv(output)?))?,
            Target::Parquet(path) => {
                new_file(path, |output| parquet_export::write_record(&recording, &record, output))?
            }
        }
        return Ok(code);
    };
    match target {
        Target::Csv(to) => {
            write_to(to, stdout, |output| whole_topic(&recording, topic, &selection, output))?;
        }
        Target::Parquet(path) => new_file(path, |output| {
            parquet_export::write_topic(&recording, topic, &selection, output)
        })?,
    }
    drop(progress);
    Ok(code)
}

/// Where a table goes.
enum Target<'a> {
    /// To a file, or to stdout.
    Csv(Option<&'a Path>),
    Parquet(&'a Path),
}

/// Writes to a new file, which is there whole or not at all, or to stdout.
fn write_to(
    to: Option<&Path>,
    stdout: &mut Output<'_>,
    write: impl FnOnce(&mut dyn Write) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    match to {
        Some(path) => new_file(path, |output| write(output)),
        None => {
            let mut output = std::io::BufWriter::new(stdout);
            write(&mut output)?;
            Ok(output.flush()?)
        }
    }
}

/// The measured record, its columns in files beside what is written of it.
fn record(
    recording: &Recording,
    columns: &SampleColumns,
    to: Option<&Path>,
) -> anyhow::Result<Table> {
    let folder = to.map_or_else(std::env::temp_dir, |path| beside(path).to_owned());
    let options = Options::default().gaps(Gaps::LongestRun);
    Ok(table_from_recording(recording, columns, &options, &Storage::Folder(folder))?)
}

/// All fields of a topic. Rows are written in the order of the file, and made of the messages on
/// all processors.
fn whole_topic(
    recording: &Recording,
    topic: &str,
    selection: &Selection,
    output: &mut dyn Write,
) -> anyhow::Result<()> {
    let mut header_written = false;
    let rows = |columns: &[TopicColumn<'_>], messages: &[RawMessage]| {
        rows_of(recording, columns, messages)
    };
    let layout = each_part(recording, topic, selection, rows, |layout, text| {
        if !header_written {
            write_header(layout, output)?;
            header_written = true;
        }
        Ok(output.write_all(&text)?)
    })?;
    match layout {
        Some(layout) if !header_written => write_header(layout, output),
        _ => Ok(()),
    }
}

fn write_header(layout: &Layout, output: &mut dyn Write) -> anyhow::Result<()> {
    let mut table = csv::Writer::from_writer(output);
    table.write_record(columns_of(layout).into_iter().map(|column| column.name))?;
    Ok(table.flush()?)
}

/// The rows of some messages of one channel.
fn rows_of(
    recording: &Recording,
    columns: &[TopicColumn<'_>],
    messages: &[RawMessage],
) -> anyhow::Result<Vec<u8>> {
    let mut table = csv::Writer::from_writer(Vec::new());
    let mut cell = String::new();
    for message in messages {
        let (layout, body) = recording.decode(message)?;
        for column in columns {
            cell.clear();
            match column.cell(message, layout, body) {
                Some(Cell::LogTime(ns)) => write!(cell, "{ns}")?,
                Some(Cell::Number(value)) => write!(cell, "{value}")?,
                Some(Cell::Text(text)) => cell = text,
                None => {}
            }
            table.write_field(&cell)?;
        }
        table.write_record(None::<&[u8]>)?;
    }
    Ok(table.into_inner().map_err(|error| error.into_error())?)
}
