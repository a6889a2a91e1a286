//! `export --to parquet`: the tables of `--to csv` with typed columns, and what is known of them.
//!
//! The metadata of a file have the recording's own, each under `farreach.KEY` (`farreach.rig`,
//! `farreach.rig_file`, `farreach.session`, …), `units`, a JSON object with the unit of each column
//! that has one, and of a topic its name, the type of its messages, and in `incarnations` (a JSON
//! array) those of the processes that sent them.

use std::collections::BTreeMap;
use std::io::Write;

use anyhow::{Context, bail};
use ipc_types::{AXES, Primitive, Value};
use parquet::data_type::ByteArray;
use recording::mcap_read::{RawMessage, Recording, Selection};
use recording::mcap_write::key;
use recording::record::Table;
use recording::schema::Layout;

use crate::names::unit_of;
use crate::parquet_file::{Kind, ParquetWriter, Values};
use crate::topic_rows::{Cell, Content, TopicColumn, columns_of, each_part};

/// Rows of a record that are read at a time.
const ROWS: usize = 8 * 1024;

/// Writes the measured record.
///
/// # Errors
/// Those of the output, and of the columns' files.
pub(crate) fn write_record(
    recording: &Recording,
    record: &Table,
    output: &mut (dyn Write + Send),
) -> anyhow::Result<()> {
    let columns: Vec<_> = record.columns().collect();
    let kinds: Vec<_> = columns.iter().map(|(name, _)| ((*name).to_owned(), Kind::F64)).collect();
    let mut file = ParquetWriter::new(output, &kinds)?;
    let rows = columns.first().map_or(0, |(_, column)| column.len());
    for first in (0..rows).step_by(ROWS) {
        let mut values = Vec::with_capacity(columns.len());
        for (_, column) in &columns {
            let mut piece = vec![0.0; ROWS.min(rows - first)];
            column.read(first, &mut piece)?;
            values.push(Values::F64(piece));
        }
        file.push(values)?;
    }
    let units = columns.iter().map(|(name, _)| ((*name).to_owned(), unit_in(name).to_owned()));
    file.finish(metadata(recording, units, Vec::new())?)
}

/// The unit at the end of the name of a record's column.
fn unit_in(name: &str) -> &'static str {
    match name.rsplit_once('_').map(|(_, unit)| unit) {
        Some("s") => "s",
        Some("v") => "V",
        Some("rad") => "rad",
        Some("m") => "m",
        Some("nm") => "N·m",
        Some("n") => "N",
        _ => "",
    }
}

/// Writes all fields of a topic.
///
/// # Errors
/// Those of reading and of the output; a topic whose fields change, or cannot be read.
pub(crate) fn write_topic(
    recording: &Recording,
    topic: &str,
    selection: &Selection,
    output: &mut (dyn Write + Send),
) -> anyhow::Result<()> {
    let first = selection.channels.as_ref().and_then(|channels| channels.first());
    let Some(channel) = first.and_then(|first| recording.channels.get(first)) else {
        bail!("{}: no topic {topic}", recording.path().display());
    };
    let path = recording.path().display();
    let layout = channel.layout.as_ref().map_err(Clone::clone);
    let layout = layout.with_context(|| format!("{path}: topic {topic}"))?;
    let columns = columns_of(layout);
    let kinds: Vec<_> =
        columns.iter().map(|column| (column.name.clone(), kind_of(column))).collect();
    let mut file = ParquetWriter::new(output, &kinds)?;
    let sender = columns.iter().position(|column| column.name == "incarnation");
    let mut incarnations: Vec<u64> = Vec::new();
    let rows = |columns: &[TopicColumn<'_>], messages: &[RawMessage]| {
        values_of(recording, columns, messages)
    };
    each_part(recording, topic, selection, rows, |found, rows| {
        if found != layout {
            bail!(
                "{path}: the fields of topic {topic} are not the same from beginning to end, as \
                 one table needs them: export the files it was merged from, or --to csv"
            );
        }
        if let Some(Values::I64(values)) = sender.and_then(|sender| rows.get(sender)) {
            for value in values.iter().map(|value| value.cast_unsigned()) {
                if incarnations.last() != Some(&value) && !incarnations.contains(&value) {
                    incarnations.push(value);
                }
            }
        }
        file.push(rows)
    })?;
    let more = vec![
        ("topic".to_owned(), topic.to_owned()),
        ("type".to_owned(), channel.schema_name.clone()),
        ("incarnations".to_owned(), serde_json::to_string(&incarnations)?),
    ];
    file.finish(metadata(recording, units_of(recording, layout), more)?)
}

/// The values of some messages, a vector for each column.
fn values_of(
    recording: &Recording,
    columns: &[TopicColumn<'_>],
    messages: &[RawMessage],
) -> anyhow::Result<Vec<Values>> {
    let empty = |column| kind_of(column).values(messages.len());
    let mut values: Vec<Values> = columns.iter().map(empty).collect();
    for message in messages {
        let (layout, body) = recording.decode(message)?;
        for (values, column) in values.iter_mut().zip(columns) {
            let cell = column.cell(message, layout, body);
            push(values, cell).with_context(|| {
                format!("{}: column {}", recording.path().display(), column.name)
            })?;
        }
    }
    Ok(values)
}

fn kind_of(column: &TopicColumn<'_>) -> Kind {
    match column.content {
        Content::LogTime => Kind::Instant,
        Content::Text(_) => Kind::Text,
        Content::Element(field, _) => match field.primitive {
            Primitive::U8 => Kind::Small(8),
            Primitive::U16 => Kind::Small(16),
            Primitive::U32 => Kind::U32,
            Primitive::U64 => Kind::U64,
            Primitive::I64 => Kind::I64,
            Primitive::F64 => Kind::F64,
        },
    }
}

fn push(values: &mut Values, cell: Option<Cell>) -> anyhow::Result<()> {
    match (values, cell) {
        (Values::I64(values), Some(Cell::LogTime(ns))) => {
            values.push(i64::try_from(ns).context("a log time beyond the year 2262")?);
        }
        // An unsigned column holds the bits; its type says how they are read.
        (Values::I32(values), Some(Cell::Number(Value::Unsigned(value)))) => {
            values.push((value as u32).cast_signed());
        }
        (Values::I64(values), Some(Cell::Number(Value::Unsigned(value)))) => {
            values.push(value.cast_signed());
        }
        (Values::I64(values), Some(Cell::Number(Value::Signed(value)))) => values.push(value),
        (Values::F64(values), Some(Cell::Number(Value::Float(value)))) => values.push(value),
        (Values::Text(values), Some(Cell::Text(text))) => {
            values.push(ByteArray::from(text.into_bytes()));
        }
        (_, cell) => bail!("{cell:?} is no value of it"),
    }
    Ok(())
}

/// The units of the columns by this build's messages; of an axis of the rig the one that it has.
fn units_of(recording: &Recording, layout: &Layout) -> BTreeMap<String, String> {
    let mut units = BTreeMap::new();
    for TopicColumn { name, content } in columns_of(layout) {
        let unit = match content {
            Content::LogTime => "ns",
            Content::Text(_) => continue,
            Content::Element(field, index) => {
                let unit = unit_of(&layout.name, &field.name);
                let of_axis = field.array == Some(AXES);
                match unit.split_once(" or ").filter(|_| of_axis) {
                    Some((rotary, linear)) => {
                        match recording.metadata(&format!("axis.{index}.unit")) {
                            Some("rad") => rotary,
                            Some("m") => linear,
                            _ => unit,
                        }
                    }
                    None => unit,
                }
            }
        };
        units.insert(name, unit.to_owned());
    }
    units
}

fn metadata(
    recording: &Recording,
    units: impl IntoIterator<Item = (String, String)>,
    more: Vec<(String, String)>,
) -> anyhow::Result<Vec<(String, String)>> {
    let units: BTreeMap<String, String> =
        units.into_iter().filter(|(_, unit)| !unit.is_empty()).collect();
    let mut all = vec![("units".to_owned(), serde_json::to_string(&units)?)];
    all.extend(more);
    // The checksum is that of a record of the recording.
    let own = recording.start_record().into_iter().flatten();
    let own = own.filter(|(key, _)| key.as_str() != key::CHECKSUM);
    all.extend(own.map(|(key, value)| (format!("farreach.{key}"), value.clone())));
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_of_a_record_has_its_unit() {
        let names = ["t_s", "motor_v", "master_rad", "slave_m", "slave_torque_nm", "slave_force_n"];
        assert_eq!(names.map(unit_in), ["s", "V", "rad", "m", "N·m", "N"]);
        assert_eq!(["count", "what_else"].map(unit_in), ["", ""]);
    }
}
