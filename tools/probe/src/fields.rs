//! Formats messages as text, JSON and rows of a table, by the table of fields.

use anyhow::{Context, bail};
use recording::schema::LayoutField;
use serde_json::{Map, Value as Json, json};

use crate::stream::Stream;

/// The picked fields of a topic.
#[derive(Clone, Debug)]
pub(crate) struct Picks {
    /// All fields of the topic.
    fields: Vec<LayoutField>,
    picked: Vec<Pick>,
}

/// A field or one element of it, with its name.
#[derive(Clone, Debug)]
struct Pick {
    name: String,
    field: LayoutField,
    index: Option<usize>,
}

/// One number of every message of a topic.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Element {
    /// The field.
    pub(crate) field: LayoutField,
    index: usize,
}

impl Element {
    /// A field or an element of one, such as `volts[0]`.
    ///
    /// # Errors
    /// If the topic does not have it, or it is an array.
    pub(crate) fn new(stream: &Stream, text: &str) -> anyhow::Result<Self> {
        let Pick { field, index, .. } = pick(stream, text)?;
        match (index, field.array) {
            (None, Some(count)) => bail!(
                "{}.{text}: an array of {count}; name one of its elements, such as {}.{text}[0]",
                stream.name,
                stream.name
            ),
            (index, _) => Ok(Self { field, index: index.unwrap_or(0) }),
        }
    }

    /// Its value in a message; NaN where the message is too short.
    pub(crate) fn value(&self, bytes: &[u8]) -> f64 {
        self.field.read(bytes, self.index).map_or(f64::NAN, |value| value.as_f64())
    }

    /// Its unit, from the documentation of the field; empty where that names none.
    pub(crate) fn unit(&self) -> &'static str {
        self.field.unit()
    }
}

/// A field, or an element of one, of a topic.
fn pick(stream: &Stream, text: &str) -> anyhow::Result<Pick> {
    let (name, index) = match text.strip_suffix(']').and_then(|text| text.split_once('[')) {
        Some((name, index)) => {
            let index = index
                .parse::<usize>()
                .with_context(|| format!("field {text}: expected an index in []"))?;
            (name, Some(index))
        }
        None => (text, None),
    };
    let Some(field) = stream.field(name) else {
        let names: Vec<_> = stream.fields.iter().map(|field| field.name.as_str()).collect();
        bail!("field {name}: topic {} has {}", stream.name, names.join(", "));
    };
    match (index, field.array) {
        (Some(_), None) => {
            bail!("field {text}: {name} of topic {} is no array; leave [] out", stream.name)
        }
        (Some(index), Some(count)) if index >= count => {
            bail!("field {text}: expected an index from 0 to {}, found {index}", count - 1)
        }
        _ => Ok(Pick { name: text.to_owned(), field: field.clone(), index }),
    }
}

impl Picks {
    /// The requested fields; all but the reserved ones if none is requested.
    ///
    /// # Errors
    /// If the topic does not have one, or its fields cannot be read.
    pub(crate) fn new(stream: &Stream, names: &[String]) -> anyhow::Result<Self> {
        if stream.fields.is_empty() {
            bail!(
                "topic {}: its messages are not written as ros2msg schemas of numbers describe \
                 them, so their fields cannot be shown",
                stream.name
            );
        }
        let fields = stream.fields.clone();
        if names.is_empty() {
            let all = fields.iter().filter(|field| field.name != "reserved");
            let picked = all
                .map(|field| Pick { name: field.name.clone(), field: field.clone(), index: None })
                .collect();
            return Ok(Self { fields, picked });
        }
        let picked = names.iter().map(|name| pick(stream, name)).collect::<Result<_, _>>()?;
        Ok(Self { fields, picked })
    }

    /// The picked fields by name.
    pub(crate) fn json(&self, bytes: &[u8]) -> Map<String, Json> {
        let value = |pick: &Pick| match (pick.index, pick.field.array) {
            (None, Some(_)) => match pick.field.event_text(&self.fields, bytes) {
                Some(text) => text.into(),
                None => json!(pick.field.read_all(bytes).collect::<Vec<_>>()),
            },
            (index, _) => json!(pick.field.read(bytes, index.unwrap_or(0))),
        };
        self.picked.iter().map(|pick| (pick.name.clone(), value(pick))).collect()
    }

    /// The picked fields in one line.
    pub(crate) fn line(&self, bytes: &[u8]) -> String {
        let value = |pick: &Pick| match pick.index {
            None => match pick.field.event_text(&self.fields, bytes) {
                Some(text) => format!("{text:?}"),
                None => pick.field.values_text(bytes),
            },
            Some(index) => {
                pick.field.read(bytes, index).map(|value| value.to_string()).unwrap_or_default()
            }
        };
        let pairs: Vec<_> =
            self.picked.iter().map(|pick| format!("{}={}", pick.name, value(pick))).collect();
        pairs.join(" ")
    }

    /// Names of the columns of a table: `volts_2` for the element `volts[2]`, as in the tables of
    /// `rec export --to csv`.
    pub(crate) fn header(&self) -> Vec<String> {
        let columns = |pick: &Pick| match (pick.index, pick.field.array) {
            (Some(index), _) => vec![format!("{}_{index}", pick.field.name)],
            (None, Some(count)) if pick.field.text_length(&self.fields).is_none() => {
                (0..count).map(|index| format!("{}_{index}", pick.field.name)).collect()
            }
            (None, _) => vec![pick.field.name.clone()],
        };
        self.picked.iter().flat_map(columns).collect()
    }

    /// A row of that table.
    pub(crate) fn row(&self, bytes: &[u8]) -> Vec<String> {
        let cells = |pick: &Pick| match pick.index {
            Some(index) => {
                pick.field.read(bytes, index).map(|value| value.to_string()).into_iter().collect()
            }
            None => match pick.field.event_text(&self.fields, bytes) {
                Some(text) => vec![text],
                None => pick.field.read_all(bytes).map(|value| value.to_string()).collect(),
            },
        };
        self.picked.iter().flat_map(cells).collect()
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::{
        COMMAND, Event, EventKind, Message, MotorCommand, Process, SAMPLE, Severity, event_topic,
    };

    use super::*;

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn picked_fields_in_a_line_and_in_json() {
        let stream = Stream::of_topic(&COMMAND.topic);
        let command = MotorCommand {
            sample_tick: 7,
            volts: [0.5, f64::NAN, -1.0],
            mode: 2,
            ..MotorCommand::default()
        };
        let wanted = names(&["sample_tick", "volts", "volts[2]", "mode"]);
        let picks = Picks::new(&stream, &wanted).unwrap();
        let bytes = command.as_bytes();
        assert_eq!(picks.line(bytes), "sample_tick=7 volts=[0.5,NaN,-1] volts[2]=-1 mode=2");
        let expected = r#"{"mode":2,"sample_tick":7,"volts":[0.5,"NaN",-1.0],"volts[2]":-1.0}"#;
        assert_eq!(Json::Object(picks.json(bytes)).to_string(), expected);
        let header = ["sample_tick", "volts_0", "volts_1", "volts_2", "volts_2", "mode"];
        assert_eq!(picks.header(), header);
        assert_eq!(picks.row(bytes), ["7", "0.5", "NaN", "-1", "-1", "2"]);
    }

    #[test]
    fn every_field_of_every_topic_can_be_shown() {
        for topic in ipc_types::TOPICS {
            let picks = Picks::new(&Stream::of_topic(topic), &[]).unwrap();
            let bytes = vec![0; topic.size];
            assert_eq!(picks.json(&bytes).len(), picks.picked.len(), "{}", topic.name);
            assert!(!picks.json(&bytes).values().any(Json::is_null), "{}", topic.name);
            assert_eq!(picks.header().len(), picks.row(&bytes).len(), "{}", topic.name);
            let line = picks.line(&bytes);
            assert!(line.starts_with("session=0 incarnation=0"), "{}: {line}", topic.name);
        }
    }

    #[test]
    fn an_events_text_is_text() {
        let typed = event_topic(Process::Logger).unwrap();
        let stream = Stream::of_topic(&typed.topic);
        let event = Event::new(Process::Logger, EventKind::DataLost, Severity::Error, "3 \"lost\"");
        let picks = Picks::new(&stream, &names(&["text"])).unwrap();
        assert_eq!(picks.line(event.as_bytes()), r#"text="3 \"lost\"""#);
        assert_eq!(picks.json(event.as_bytes())["text"], "3 \"lost\"");
        assert_eq!(picks.header(), ["text"]);
        assert_eq!(picks.row(event.as_bytes()), ["3 \"lost\""]);
    }

    #[test]
    fn wrong_fields_say_what_there_is() {
        let stream = Stream::of_topic(&COMMAND.topic);
        for (text, expected) in [
            ("volt", "topic command has session"),
            ("volts[3]", "from 0 to 2"),
            ("volts[x]", "expected an index"),
            ("mode[0]", "no array"),
        ] {
            let error = Picks::new(&stream, &names(&[text])).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        let error = Element::new(&stream, "volts").unwrap_err().to_string();
        assert!(error.contains("such as command.volts[0]"), "{error}");
    }

    #[test]
    fn an_element_has_its_value_and_the_unit_of_its_documentation() {
        let command = MotorCommand { volts: [0.5, 0.25, 0.0], mode: 3, ..MotorCommand::default() };
        let stream = Stream::of_topic(&COMMAND.topic);
        let volts = Element::new(&stream, "volts[1]").unwrap();
        assert_eq!((volts.value(command.as_bytes()), volts.unit()), (0.25, "V"));
        let mode = Element::new(&stream, "mode").unwrap();
        assert_eq!((mode.value(command.as_bytes()), mode.unit()), (3.0, ""));
        assert!(volts.value(&command.as_bytes()[..40]).is_nan());
        let time = Element::new(&stream, "sample_time_ns").unwrap();
        assert_eq!(time.unit(), "ns");
        let position =
            Element::new(&Stream::of_topic(&SAMPLE.topic), "master_position[0]").unwrap();
        assert_eq!(position.unit(), "rad or m");
    }
}
