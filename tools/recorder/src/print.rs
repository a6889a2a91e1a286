//! `cat`.

use std::io::Write;
use std::path::Path;

use ipc_types::Value;
use recording::mcap_read::{ReadError, Recording, Selection};
use recording::schema::{Layout, LayoutField};
use serde_json::{Map, json};

use crate::{DATA_LOST, DONE};

pub(crate) fn cat(
    file: &Path,
    topics: &[String],
    as_json: bool,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let mut channels = Vec::new();
    for topic in topics {
        channels.extend(recording.channels_of(topic)?);
    }
    let selection =
        Selection { channels: (!topics.is_empty()).then_some(channels), ..Selection::default() };
    let mut out = std::io::BufWriter::new(out);
    let mut code = DONE;
    for message in recording.raw(selection) {
        let message = match message {
            Ok(message) => message,
            Err(error @ ReadError::Damaged { .. }) => {
                eprintln!("{error}");
                code = DATA_LOST;
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let topic = recording.channel(&message).map_or("?", |channel| channel.topic.as_str());
        let (layout, body) = recording.decode(&message)?;
        if as_json {
            let object = json!({
                "topic": topic,
                "log_time_ns": message.log_time_ns(),
                "publish_time_ns": message.publish_time_ns(),
                "sequence": message.sequence(),
                "fields": fields(layout, body),
            });
            serde_json::to_writer(&mut out, &object)?;
            writeln!(out)?;
        } else {
            writeln!(out, "{} {topic}{}", seconds(message.log_time_ns()), line(layout, body))?;
        }
    }
    out.flush()?;
    if !recording.tail().complete {
        eprintln!("{}: {}", file.display(), recording.tail().reason);
        code = DATA_LOST;
    }
    Ok(code)
}

fn seconds(ns: u64) -> String {
    format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

/// Every field by name. JSON has no NaN and no infinity: these become text, so that nothing is
/// hidden.
fn fields(layout: &Layout, body: &[u8]) -> Map<String, serde_json::Value> {
    let mut map = Map::new();
    for field in &layout.fields {
        let value = match field.array {
            None => field.read(body, 0).map_or(serde_json::Value::Null, number),
            Some(_) => field.read_all(body).map(number).collect(),
        };
        map.insert(field.name.clone(), value);
    }
    map
}

fn number(value: Value) -> serde_json::Value {
    match value {
        Value::Unsigned(v) => v.into(),
        Value::Signed(v) => v.into(),
        Value::Float(v) if v.is_finite() => v.into(),
        Value::Float(v) => v.to_string().into(),
    }
}

fn line(layout: &Layout, body: &[u8]) -> String {
    let mut text = String::new();
    for field in layout.fields.iter().filter(|field| field.name != "reserved") {
        text.push_str(&format!(" {}={}", field.name, plain(field, layout, body)));
    }
    text
}

fn plain(field: &LayoutField, layout: &Layout, body: &[u8]) -> String {
    if field.array.is_none() {
        return field.read(body, 0).map(|value| value.to_string()).unwrap_or_default();
    }
    // an event's text is bytes with a length beside it
    if field.name == "text"
        && let Some(Value::Unsigned(length)) =
            layout.field("text_len").and_then(|length| length.read(body, 0))
    {
        let bytes: Vec<u8> =
            field.read_all(body).map(|value| value.as_f64() as u8).take(length as usize).collect();
        return format!("{:?}", String::from_utf8_lossy(&bytes));
    }
    let values: Vec<String> = field.read_all(body).map(|value| value.to_string()).collect();
    format!("[{}]", values.join(","))
}
