//! `list`.

use std::io::Write;
use std::path::Path;

use ipc_types::{Rate, TOPICS};
use recording::mcap_read::Recording;
use serde_json::json;

use crate::args::ListArgs;
use crate::attach;
use crate::recorded::Recorded;
use crate::stream::{Progress, Source, Stream};

fn rate(rate: Rate) -> String {
    match rate {
        Rate::Loop(process) => process.text().to_owned(),
        Rate::Hertz(hertz) => format!("{hertz} Hz"),
        Rate::Sporadic => "sporadic".to_owned(),
    }
}

pub(crate) fn list(args: &ListArgs, out: &mut dyn Write) -> anyhow::Result<i32> {
    match (&args.topic, &args.file) {
        (None, None) => topics(args.json, out)?,
        (Some(name), None) => fields(&Stream::of_topic(attach::topic(name)?), args.json, out)?,
        (None, Some(file)) => return recorded_topics(file, args.json, out),
        (Some(name), Some(file)) => {
            let recording = Recording::open(file)?;
            let source = Recorded::new(&recording, std::slice::from_ref(name))?;
            for stream in source.streams() {
                fields(stream, args.json, out)?;
            }
        }
    }
    Ok(recorder::DONE)
}

fn topics(json: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    if json {
        let rows: Vec<_> = TOPICS
            .iter()
            .map(|topic| {
                json!({
                    "topic": topic.name,
                    "owner": topic.owner.text(),
                    "rate": rate(topic.rate),
                    "bytes": topic.size,
                    "type": topic.ros_name,
                })
            })
            .collect();
        writeln!(out, "{}", serde_json::Value::from(rows))?;
        return Ok(());
    }
    writeln!(out, "{:<21} {:<12} {:<12} {:>6}  type", "topic", "from", "rate", "bytes")?;
    for topic in TOPICS {
        let rate = rate(topic.rate);
        let owner = topic.owner.text();
        writeln!(
            out,
            "{:<21} {owner:<12} {rate:<12} {:>6}  {}",
            topic.name, topic.size, topic.ros_name
        )?;
    }
    Ok(())
}

/// The topics of a recording, with how many messages of each are in it and how many are missing.
fn recorded_topics(file: &Path, json: bool, out: &mut dyn Write) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let mut source = Recorded::new(&recording, &[])?;
    while source.read(u64::MAX, &mut |_| {})? != Progress::Ended {}
    if json {
        let rows: Vec<_> = source
            .streams()
            .iter()
            .map(|stream| {
                json!({
                    "topic": stream.name,
                    "owner": stream.owner,
                    "messages": stream.received(),
                    "lost": stream.lost(),
                    "bytes": stream.size,
                    "type": stream.kind,
                })
            })
            .collect();
        writeln!(out, "{}", serde_json::Value::from(rows))?;
        return Ok(source.exit_code());
    }
    writeln!(
        out,
        "{:<21} {:<12} {:>9} {:>6} {:>6}  type",
        "topic", "from", "messages", "lost", "bytes"
    )?;
    for stream in source.streams() {
        writeln!(
            out,
            "{:<21} {:<12} {:>9} {:>6} {:>6}  {}",
            stream.name,
            stream.owner,
            stream.received(),
            stream.lost(),
            stream.size,
            stream.kind
        )?;
    }
    Ok(source.exit_code())
}

fn fields(topic: &Stream, json: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    if json {
        let rows: Vec<_> = topic
            .fields
            .iter()
            .map(|field| {
                json!({
                    "field": field.name,
                    "type": field.primitive.ros(),
                    "count": field.array,
                    "what": field.doc.trim(),
                })
            })
            .collect();
        writeln!(out, "{}", serde_json::Value::from(rows))?;
        return Ok(());
    }
    for field in topic.fields.iter().filter(|field| field.name != "reserved") {
        let kind = match field.array {
            Some(count) => format!("{}[{count}]", field.primitive.ros()),
            None => field.primitive.ros().to_owned(),
        };
        let line = format!("{:<22} {kind:<12} {}", field.name, field.doc.trim());
        writeln!(out, "{}", line.trim_end())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_and_fields_are_listed() {
        let text = |topic: Option<&str>, json| {
            let mut out = Vec::new();
            let topic = topic.map(str::to_owned);
            list(&ListArgs { topic, file: None, json }, &mut out).unwrap();
            String::from_utf8(out).unwrap()
        };
        assert_eq!(text(None, false).lines().count(), TOPICS.len() + 1);
        let parsed: Vec<serde_json::Value> = serde_json::from_str(&text(None, true)).unwrap();
        assert_eq!(parsed.len(), TOPICS.len());
        assert!(
            text(Some("command"), false)
                .contains("volts                  float64[3]   motor volts (V)")
        );
        let unknown = ListArgs { topic: Some("x".to_owned()), file: None, json: false };
        assert!(list(&unknown, &mut Vec::new()).is_err());
    }
}
