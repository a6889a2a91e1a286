//! `cat`.

use std::io::{BufWriter, Write};
use std::path::Path;

use ipc_types::Value;
use recording::mcap_read::{RawMessage, ReadError, Recording, Selection};
use recording::schema::{Layout, LayoutField};
use serde_json::{Map, json};

use crate::names::code_name;
use crate::output::Output;
use crate::{DATA_LOST, code_of_tail};

pub(crate) fn cat(
    file: &Path,
    topics: &[String],
    as_json: bool,
    out: &mut Output<'_>,
) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let mut channels = Vec::new();
    for topic in topics {
        channels.extend(recording.channels_of(topic)?);
    }
    let selection =
        Selection { channels: (!topics.is_empty()).then_some(channels), ..Selection::default() };
    let mut out = BufWriter::new(out);
    let mut code = code_of_tail(&recording);
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
        let (layout, body) = recording.decode(&message)?;
        if out.get_ref().closed() {
            continue; // only the exit code is still wanted
        }
        let topic = recording.channel(&message).map_or("?", |channel| channel.topic.as_str());
        if as_json {
            serde_json::to_writer(&mut out, &object(&message, topic, layout, body))?;
            writeln!(out)?;
        } else {
            writeln!(out, "{} {topic}{}", seconds(message.log_time_ns()), line(layout, body))?;
        }
    }
    out.flush()?;
    if !recording.tail().complete {
        eprintln!("{}: {}", file.display(), recording.tail().reason);
    }
    Ok(code)
}

fn seconds(ns: u64) -> String {
    format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

/// A message with every field by name, and the names of its codes.
fn object(message: &RawMessage, topic: &str, layout: &Layout, body: &[u8]) -> serde_json::Value {
    let mut fields = Map::new();
    let mut names = Map::new();
    for field in &layout.fields {
        let value = match field.array {
            None => field.read(body, 0).map_or(serde_json::Value::Null, number),
            Some(_) => field.read_all(body).map(number).collect(),
        };
        if let Some(name) = name_of(field, layout, body) {
            names.insert(field.name.clone(), name.into());
        }
        fields.insert(field.name.clone(), value);
    }
    let mut object = json!({
        "topic": topic,
        "log_time_ns": message.log_time_ns(),
        "publish_time_ns": message.publish_time_ns(),
        "sequence": message.sequence(),
        "fields": fields,
    });
    if !names.is_empty() {
        object["names"] = names.into();
    }
    object
}

/// JSON has no NaN and no infinity: these become text, so that nothing is hidden.
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
    if let Some(name) = name_of(field, layout, body) {
        return name.replace(' ', "_");
    }
    if field.array.is_none() {
        return field.read(body, 0).map(|value| value.to_string()).unwrap_or_default();
    }
    if let Some(text) = text_of(field, layout, body) {
        return format!("{text:?}");
    }
    let values: Vec<String> = field.read_all(body).map(|value| value.to_string()).collect();
    format!("[{}]", values.join(","))
}

/// The name of the code in a field, if it carries one.
fn name_of(field: &LayoutField, layout: &Layout, body: &[u8]) -> Option<&'static str> {
    match (field.array, field.read(body, 0)?) {
        (None, Value::Unsigned(code)) => code_name(&layout.name, &field.name, code),
        _ => None,
    }
}

/// Whether a field is the text of an event: bytes in `text`, their number in `text_len`.
pub(crate) fn is_text(field: &LayoutField, layout: &Layout) -> bool {
    field.name == "text" && field.array.is_some() && layout.field("text_len").is_some()
}

/// The text of such a field.
pub(crate) fn text_of(field: &LayoutField, layout: &Layout, body: &[u8]) -> Option<String> {
    if !is_text(field, layout) {
        return None;
    }
    let length = usize::try_from(layout.unsigned("text_len", body)?).ok()?;
    let bytes: Vec<u8> =
        field.read_all(body).take(length).map(|value| value.as_f64() as u8).collect();
    Some(String::from_utf8_lossy(&bytes).into_owned())
}
