//! `farreach rec cat`: prints the messages of a recording as text or JSON lines.

use std::io::{BufWriter, Write};
use std::path::Path;

use ipc_types::Value;
use recording::mcap_read::{RawMessage, ReadError, Recording, Selection};
use recording::schema::{Layout, LayoutField};
use serde_json::{Map, json};

use crate::names::code_name;
use crate::output::Output;
use crate::{DATA_LOST, exit_code_of_tail};

/// Prints the messages of the given topics (all if empty) and returns the exit code: `DATA_LOST` if
/// a chunk is damaged or the end is missing.
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
    let mut code = exit_code_of_tail(&recording);
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
            // The reader closed the pipe: go on decoding only to determine the exit code.
            continue;
        }
        let topic = recording.channel(&message).map_or("?", |channel| channel.topic.as_str());
        if as_json {
            serde_json::to_writer(&mut out, &message_json(&message, topic, layout, body))?;
            writeln!(out)?;
        } else {
            writeln!(
                out,
                "{} {topic}{}",
                seconds_text(message.log_time_ns()),
                fields_text(layout, body)
            )?;
        }
    }
    out.flush()?;
    if !recording.tail.complete {
        eprintln!("{}: {}", file.display(), recording.tail.reason);
    }
    Ok(code)
}

/// Nanoseconds as decimal seconds.
fn seconds_text(ns: u64) -> String {
    format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

/// A message as JSON: every field under `fields`, and under `names` the names of the fields that
/// hold codes.
fn message_json(
    message: &RawMessage,
    topic: &str,
    layout: &Layout,
    body: &[u8],
) -> serde_json::Value {
    let mut fields = Map::new();
    let mut names = Map::new();
    for field in &layout.fields {
        let value = match field.array {
            None => json!(field.read(body, 0)),
            Some(_) => json!(field.read_all(body).collect::<Vec<_>>()),
        };
        if let Some(name) = code_name_of(field, layout, body) {
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

/// All fields as ` name=value`, without padding.
fn fields_text(layout: &Layout, body: &[u8]) -> String {
    let mut text = String::new();
    for field in layout.fields.iter().filter(|field| field.name != "reserved") {
        text.push_str(&format!(" {}={}", field.name, field_text(field, layout, body)));
    }
    text
}

/// One field as text: the name of its code, quoted text, a number, or `[a,b,...]`.
fn field_text(field: &LayoutField, layout: &Layout, body: &[u8]) -> String {
    if let Some(name) = code_name_of(field, layout, body) {
        return name.replace(' ', "_");
    }
    match field.event_text(&layout.fields, body) {
        Some(text) => format!("{text:?}"),
        None => field.values_text(body),
    }
}

/// The name of the code that a scalar field holds; `None` if the field is not a code.
fn code_name_of(field: &LayoutField, layout: &Layout, body: &[u8]) -> Option<&'static str> {
    match (field.array, field.read(body, 0)?) {
        (None, Value::Unsigned(code)) => code_name(&layout.name, &field.name, code),
        _ => None,
    }
}
