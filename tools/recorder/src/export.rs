//! `export`.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::{Context, bail};
use recording::mcap_read::{Recording, Selection};
use recording::record::{ColumnNames, Gaps, Options, SampleColumns, from_recording, write_csv};
use recording::schema::Layout;

use crate::args::ExportOptions;
use crate::output::Output;
use crate::{DATA_LOST, ExportFormat, LengthUnit, bids, exit_code_of_tail, mat};

/// Writes a table whose source was found readable.
type WriteTable<'a> = Box<dyn FnOnce(&mut dyn Write) -> anyhow::Result<()> + 'a>;

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
    let recording = Recording::open(file)?;
    let mut code = exit_code_of_tail(&recording);
    let write: WriteTable<'_> = match topic {
        Some(topic) => {
            let channels = recording.channels_of(topic)?;
            Box::new(|output| whole_topic(&recording, topic, channels, output))
        }
        None => {
            let names = match unit {
                LengthUnit::Rad => ColumnNames::rotary(),
                LengthUnit::M => ColumnNames::linear(),
            };
            let columns = SampleColumns { axis: *axis, ..SampleColumns::new(names) };
            let record =
                from_recording(&recording, &columns, &Options::default().gaps(Gaps::LongestRun))?;
            for finding in &record.findings {
                eprintln!("{}: {}: {}", file.display(), finding.column, finding.text);
                if finding.kind == recording::record::FindingKind::Masked {
                    code = DATA_LOST;
                }
            }
            Box::new(move |output| Ok(write_csv(&record, output)?))
        }
    };
    // The source is known to be readable now: no empty file is left behind.
    let mut created;
    let output: &mut dyn Write = match to {
        None => stdout,
        Some(path) => {
            created = File::create_new(path).with_context(|| {
                format!("{}: cannot create; files are never overwritten", path.display())
            })?;
            &mut created
        }
    };
    let mut output = BufWriter::new(output);
    write(&mut output)?;
    output.flush()?;
    Ok(code)
}

/// All fields of a topic, the log time first, arrays spread over columns, a text in one.
fn whole_topic(
    recording: &Recording,
    topic: &str,
    channels: Vec<u16>,
    output: &mut dyn Write,
) -> anyhow::Result<()> {
    let mut table = csv::Writer::from_writer(output);
    let mut header: Option<Layout> = None;
    let selection = Selection { channels: Some(channels.clone()), ..Selection::default() };
    for message in recording.raw(selection) {
        let message = message?;
        let (layout, body) = recording.decode(&message)?;
        match &header {
            Some(first) if first == layout => {}
            Some(_) => bail!(
                "{}: topic {topic} changes its fields within the file: export the parts one by one",
                recording.path().display()
            ),
            None => {
                table.write_record(header_of(layout))?;
                header = Some(layout.clone());
            }
        }
        let mut row = vec![message.log_time_ns().to_string()];
        for field in &layout.fields {
            match field.event_text(&layout.fields, body) {
                Some(text) => row.push(text),
                None => row.extend(field.read_all(body).map(|value| value.to_string())),
            }
        }
        table.write_record(row)?;
    }
    if header.is_none()
        && let Some(layout) = channels
            .first()
            .and_then(|id| recording.channels.get(id))
            .and_then(|channel| channel.layout.as_ref().ok())
    {
        table.write_record(header_of(layout))?;
    }
    table.flush()?;
    Ok(())
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
