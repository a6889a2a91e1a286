//! `export`.

use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use anyhow::bail;
use ipc_types::SAMPLE;
use recording::column::Storage;
use recording::mcap_read::{RawMessage, ReadError, Recording, Selection};
use recording::record::{
    ColumnNames, FindingKind, Gaps, Options, SampleColumns, Table, table_from_recording,
};
use recording::schema::Layout;

use crate::args::ExportOptions;
use crate::output::{Output, beside, new_file, none_exists};
use crate::progress::Progress;
use crate::{DATA_LOST, ExportFormat, LengthUnit, bids, exit_code_of_tail, mat};

pub(crate) fn export(
    file: &Path,
    options: &ExportOptions,
    stdout: &mut Output<'_>,
) -> anyhow::Result<i32> {
    let ExportOptions { to: format, topic, unit, axis, out: to, bids } = options;
    let (topic, to) = (topic.as_deref(), to.as_deref());
    if *format != ExportFormat::Csv && topic.is_some() {
        bail!("--topic: only csv has the fields of a topic");
    }
    if *format != ExportFormat::Bids
        && let Some(option) = bids.given()
    {
        bail!("{option}: it names parts of a dataset, with --to bids");
    }
    match (format, to) {
        (ExportFormat::Csv, _) => {}
        (_, None) => bail!("--out: say where to write"),
        (ExportFormat::Mat, Some(name)) => return mat::export(file, name, stdout),
        (ExportFormat::Bids, Some(folder)) => return bids::export(file, bids, folder, stdout),
    }
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
        write_to(to, stdout, |output| Ok(record.write_csv(output)?))?;
        return Ok(code);
    };
    write_to(to, stdout, |output| whole_topic(&recording, topic, &selection, output))?;
    drop(progress);
    Ok(code)
}

/// Writes to a new file, which is there whole or not at all, or to stdout.
fn write_to(
    to: Option<&Path>,
    stdout: &mut Output<'_>,
    write: impl FnOnce(&mut dyn Write) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    match to {
        Some(path) => new_file(path, write),
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

/// Rows of one channel.
struct Rows {
    channel_id: u16,
    text: Vec<u8>,
}

/// All fields of a topic, the log time first, arrays spread over columns, a text in one. Rows are
/// written in the order of the file, and made of the messages on all processors.
fn whole_topic(
    recording: &Recording,
    topic: &str,
    selection: &Selection,
    output: &mut dyn Write,
) -> anyhow::Result<()> {
    let layout_of = |id: &u16| recording.channels.get(id)?.layout.as_ref().ok();
    let mut header: Option<&Layout> = None;
    let work = |messages: Result<Vec<RawMessage>, ReadError>| rows_of(recording, &messages?);
    recording.in_order(selection, work, |rows: anyhow::Result<Vec<Rows>>| {
        for Rows { channel_id, text } in rows? {
            let layout = layout_of(&channel_id);
            match header {
                Some(first) if Some(first) == layout => {}
                Some(_) => bail!(
                    "{}: topic {topic} changes its fields within the file: export the parts one \
                     by one",
                    recording.path().display()
                ),
                None => {
                    header = layout;
                    write_header(layout, output)?;
                }
            }
            output.write_all(&text)?;
        }
        Ok(())
    })?;
    if header.is_none() {
        let first = selection.channels.as_ref().and_then(|channels| channels.first());
        write_header(first.and_then(layout_of), output)?;
    }
    Ok(())
}

fn write_header(layout: Option<&Layout>, output: &mut dyn Write) -> anyhow::Result<()> {
    let Some(layout) = layout else { return Ok(()) };
    let mut table = csv::Writer::from_writer(output);
    table.write_record(header_of(layout))?;
    Ok(table.flush()?)
}

/// The rows of some messages; a part for each stretch of messages of one channel.
fn rows_of(recording: &Recording, messages: &[RawMessage]) -> anyhow::Result<Vec<Rows>> {
    let mut parts = Vec::new();
    let mut cell = String::new();
    for messages in messages.chunk_by(|a, b| a.channel_id() == b.channel_id()) {
        let mut table = csv::Writer::from_writer(Vec::new());
        for message in messages {
            let (layout, body) = recording.decode(message)?;
            table.write_field(message.log_time_ns().to_string())?;
            for field in &layout.fields {
                if let Some(text) = field.event_text(&layout.fields, body) {
                    table.write_field(text)?;
                    continue;
                }
                for value in field.read_all(body) {
                    cell.clear();
                    write!(cell, "{value}")?;
                    table.write_field(&cell)?;
                }
            }
            table.write_record(None::<&[u8]>)?;
        }
        let text = table.into_inner().map_err(|error| error.into_error())?;
        parts.extend(messages.first().map(|of| Rows { channel_id: of.channel_id(), text }));
    }
    Ok(parts)
}

fn header_of(layout: &Layout) -> Vec<String> {
    let mut names = vec!["log_time_ns".to_owned()];
    for field in &layout.fields {
        match field.array {
            Some(count) if field.text_length(&layout.fields).is_none() => {
                names.extend((0..count).map(|index| format!("{}_{index}", field.name)));
            }
            _ => names.push(field.name.clone()),
        }
    }
    names
}
