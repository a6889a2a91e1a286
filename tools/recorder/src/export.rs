//! `export`.

use std::fs::OpenOptions;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use anyhow::Context;
use recording::mcap_read::{Recording, Selection};
use recording::record::{ColumnNames, Gaps, Options, SampleColumns, from_recording, write_csv};
use recording::schema::Layout;

use crate::{DATA_LOST, DONE, ExportFormat, LengthUnit};

pub(crate) fn export(
    file: &Path,
    format: ExportFormat,
    topic: Option<&str>,
    unit: LengthUnit,
    axis: usize,
    to: Option<&Path>,
    stdout: &mut dyn Write,
) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let ExportFormat::Csv = format;
    let mut code = if recording.tail().complete { DONE } else { DATA_LOST };
    let record = match topic {
        Some(topic) => {
            recording.channels_of(topic)?;
            None
        }
        None => {
            let names = match unit {
                LengthUnit::Rad => ColumnNames::rotary(),
                LengthUnit::M => ColumnNames::linear(),
            };
            let columns = SampleColumns { axis, ..SampleColumns::new(names) };
            let record =
                from_recording(&recording, &columns, &Options::default().gaps(Gaps::LongestRun))?;
            for finding in &record.findings {
                eprintln!("{}: {}: {}", file.display(), finding.column, finding.text);
                if finding.kind == recording::record::FindingKind::Masked {
                    code = DATA_LOST;
                }
            }
            Some(record)
        }
    };
    // Everything that can be wrong with the source is known now: no empty file is left behind.
    let mut created;
    let output: &mut dyn Write = match to {
        None => stdout,
        Some(path) => {
            created =
                OpenOptions::new().write(true).create_new(true).open(path).with_context(|| {
                    format!("{}: cannot create; files are never overwritten", path.display())
                })?;
            &mut created
        }
    };
    let mut output = BufWriter::new(output);
    match (record, topic) {
        (Some(record), _) => write_csv(&record, &mut output)?,
        (None, Some(topic)) => whole_topic(&recording, topic, &mut output)?,
        (None, None) => {}
    }
    output.flush()?;
    Ok(code)
}

/// All fields, arrays spread over columns; the log time first.
fn whole_topic(recording: &Recording, topic: &str, output: &mut dyn Write) -> anyhow::Result<()> {
    let channels = recording.channels_of(topic)?;
    let mut header: Option<Layout> = None;
    for message in
        recording.raw(Selection { channels: Some(channels.clone()), ..Selection::default() })
    {
        let message = message?;
        let (layout, body) = recording.decode(&message)?;
        match &header {
            Some(first) if first != layout => anyhow::bail!(
                "{}: topic {topic} changes its fields within the file: export the parts one by one",
                recording.path().display()
            ),
            Some(_) => {}
            None => {
                title(layout, output)?;
                header = Some(layout.clone());
            }
        }
        write!(output, "{}", message.log_time_ns())?;
        for field in &layout.fields {
            for value in field.read_all(body) {
                write!(output, ",{value}")?;
            }
        }
        writeln!(output)?;
    }
    if header.is_none()
        && let Some(layout) = channels
            .first()
            .and_then(|id| recording.channels().get(id))
            .and_then(|c| c.layout.as_ref().ok())
    {
        title(layout, output)?;
    }
    Ok(())
}

fn title(layout: &Layout, output: &mut dyn Write) -> io::Result<()> {
    write!(output, "log_time_ns")?;
    for field in &layout.fields {
        match field.array {
            None => write!(output, ",{}", field.name)?,
            Some(count) => {
                for index in 0..count {
                    write!(output, ",{}_{index}", field.name)?;
                }
            }
        }
    }
    writeln!(output)
}
