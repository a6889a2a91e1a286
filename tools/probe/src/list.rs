//! `list`.

use std::io::Write;

use ipc_types::{Rate, TOPICS};
use serde_json::json;

use crate::attach;

fn rate(rate: Rate) -> String {
    match rate {
        Rate::Loop(process) => process.text().to_owned(),
        Rate::Hertz(hertz) => format!("{hertz} Hz"),
        Rate::Sporadic => "sporadic".to_owned(),
    }
}

pub(crate) fn list(topic: Option<&str>, json: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    match topic {
        None => topics(json, out),
        Some(name) => fields(name, json, out),
    }
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

fn fields(name: &str, json: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    let topic = attach::topic(name)?;
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
        writeln!(out, "{:<22} {kind:<12} {}", field.name, field.doc.trim())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_and_fields_are_listed() {
        let text = |topic, json| {
            let mut out = Vec::new();
            list(topic, json, &mut out).unwrap();
            String::from_utf8(out).unwrap()
        };
        assert_eq!(text(None, false).lines().count(), TOPICS.len() + 1);
        let parsed: Vec<serde_json::Value> = serde_json::from_str(&text(None, true)).unwrap();
        assert_eq!(parsed.len(), TOPICS.len());
        assert!(
            text(Some("command"), false)
                .contains("volts                  float64[3]   motor volts (V)")
        );
        assert!(list(Some("x"), false, &mut Vec::new()).is_err());
    }
}
