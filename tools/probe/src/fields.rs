//! Formats messages as text and JSON, by the table of fields.

use anyhow::{Context, bail};
use ipc_types::{Field, Topic};
use serde_json::{Map, Value as Json, json};

/// A field or one element of it, with its name.
#[derive(Clone, Debug)]
pub(crate) struct Pick {
    name: String,
    field: &'static Field,
    index: Option<usize>,
}

/// The requested fields; all but the reserved ones if none is requested.
pub(crate) fn picks(topic: &'static Topic, names: &[String]) -> anyhow::Result<Vec<Pick>> {
    if names.is_empty() {
        let all = topic.fields.iter().filter(|field| field.name != "reserved");
        return Ok(all
            .map(|field| Pick { name: field.name.to_owned(), field, index: None })
            .collect());
    }
    names.iter().map(|name| pick(topic, name)).collect()
}

fn pick(topic: &'static Topic, text: &str) -> anyhow::Result<Pick> {
    let (name, index) = match text.strip_suffix(']').and_then(|text| text.split_once('[')) {
        Some((name, index)) => {
            let index = index
                .parse::<usize>()
                .with_context(|| format!("field {text}: expected an index in []"))?;
            (name, Some(index))
        }
        None => (text, None),
    };
    let Some(field) = topic.fields.iter().find(|field| field.name == name) else {
        let names: Vec<_> = topic.fields.iter().map(|field| field.name).collect();
        bail!("field {name}: topic {} has {}", topic.name, names.join(", "));
    };
    match (index, field.array) {
        (Some(_), None) => {
            bail!("field {text}: {name} of topic {} is no array; leave [] out", topic.name)
        }
        (Some(index), Some(count)) if index >= count => {
            bail!("field {text}: expected an index from 0 to {}, found {index}", count - 1)
        }
        _ => Ok(Pick { name: text.to_owned(), field, index }),
    }
}

/// The picked fields by name.
pub(crate) fn json(topic: &Topic, picks: &[Pick], bytes: &[u8]) -> Map<String, Json> {
    let value = |pick: &Pick| match (pick.index, pick.field.array) {
        (None, Some(_)) => match pick.field.event_text(topic.fields, bytes) {
            Some(text) => text.into(),
            None => json!(pick.field.read_all(bytes).collect::<Vec<_>>()),
        },
        (index, _) => json!(pick.field.read(bytes, index.unwrap_or(0))),
    };
    picks.iter().map(|pick| (pick.name.clone(), value(pick))).collect()
}

/// The picked fields in one line.
pub(crate) fn line(topic: &Topic, picks: &[Pick], bytes: &[u8]) -> String {
    let value = |pick: &Pick| match pick.index {
        None => match pick.field.event_text(topic.fields, bytes) {
            Some(text) => format!("{text:?}"),
            None => pick.field.values_text(bytes),
        },
        Some(index) => {
            pick.field.read(bytes, index).map(|value| value.to_string()).unwrap_or_default()
        }
    };
    let pairs: Vec<_> = picks.iter().map(|pick| format!("{}={}", pick.name, value(pick))).collect();
    pairs.join(" ")
}

#[cfg(test)]
mod tests {
    use ipc_types::{
        COMMAND, Event, EventKind, Message, MotorCommand, Process, Severity, event_topic,
        find_topic,
    };

    use super::*;

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn picked_fields_in_a_line_and_in_json() {
        let topic = find_topic(COMMAND.topic.name).unwrap();
        let command = MotorCommand {
            sample_tick: 7,
            volts: [0.5, f64::NAN, -1.0],
            mode: 2,
            ..MotorCommand::default()
        };
        let picks = picks(topic, &names(&["sample_tick", "volts", "volts[2]", "mode"])).unwrap();
        let bytes = command.as_bytes();
        assert_eq!(
            line(topic, &picks, bytes),
            "sample_tick=7 volts=[0.5,NaN,-1] volts[2]=-1 mode=2"
        );
        let expected = r#"{"mode":2,"sample_tick":7,"volts":[0.5,"NaN",-1.0],"volts[2]":-1.0}"#;
        assert_eq!(Json::Object(json(topic, &picks, bytes)).to_string(), expected);
    }

    #[test]
    fn every_field_of_every_topic_can_be_shown() {
        for topic in ipc_types::TOPICS {
            let picks = picks(topic, &[]).unwrap();
            let bytes = vec![0; topic.size];
            assert_eq!(json(topic, &picks, &bytes).len(), picks.len(), "{}", topic.name);
            assert!(!json(topic, &picks, &bytes).values().any(Json::is_null), "{}", topic.name);
            assert!(
                line(topic, &picks, &bytes).starts_with("session=0 incarnation=0"),
                "{}",
                topic.name
            );
        }
    }

    #[test]
    fn an_events_text_is_text() {
        let typed = event_topic(Process::Logger).unwrap();
        let topic = find_topic(typed.topic.name).unwrap();
        let event = Event::new(Process::Logger, EventKind::DataLost, Severity::Error, "3 \"lost\"");
        let picks = picks(topic, &names(&["text"])).unwrap();
        assert_eq!(line(topic, &picks, event.as_bytes()), r#"text="3 \"lost\"""#);
        assert_eq!(json(topic, &picks, event.as_bytes())["text"], "3 \"lost\"");
    }

    #[test]
    fn wrong_fields_say_what_there_is() {
        let topic = find_topic("command").unwrap();
        for (text, expected) in [
            ("volt", "topic command has session"),
            ("volts[3]", "from 0 to 2"),
            ("volts[x]", "expected an index"),
            ("mode[0]", "no array"),
        ] {
            let error = picks(topic, &names(&[text])).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
