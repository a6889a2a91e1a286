//! Records from recordings of other programs: any topic whose messages describe their layout.

use std::collections::BTreeMap;
use std::path::Path;

use re_cdr::{BigEndian, CdrReader, LittleEndian};
use re_ros_msg::MessageSchema;
use re_ros_msg::deserialize::primitive_array::PrimitiveArray;
use re_ros_msg::deserialize::{MapResolver, Value, decode_message};

use super::mapping::{PathElement, parse_source};
use super::resample::{Track, on_one_grid};
use super::{Draft, Mapping, Options, Record, RecordError, TIME};
use crate::mcap_read::{Channel, Recording, Selection};

/// Reads the columns that [`Options::mapping`] names out of an MCAP file. Time is that at which
/// messages were written, 0 at the first, or the field that `t_s` is mapped to (a number, or a
/// stamp of seconds and nanoseconds). Topics with different times are resampled to one grid by
/// linear interpolation, and a finding says so.
///
/// Messages may be CDR with a schema in `ros2msg`, or JSON.
///
/// # Errors
/// [`RecordError`]: the first problem, with topic and message.
pub fn from_topics(path: &Path, options: &Options) -> Result<Record, RecordError> {
    let recording = Recording::open(path)?;
    let mut topics: BTreeMap<&str, Vec<(&Mapping, Vec<PathElement>)>> = BTreeMap::new();
    for mapping in &options.mapping {
        let Some((topic, steps)) = parse_source(&mapping.source) else {
            let what = "expected TOPIC:FIELD, such as /joint_states:position[0]";
            return Err(mapping.problem(what.to_owned()).of(path));
        };
        let of_topic = topics.entry(topic).or_default();
        if of_topic.iter().any(|(other, _)| other.column == mapping.column) {
            return Err(mapping.problem("the column is mapped twice".to_owned()).of(path));
        }
        of_topic.push((mapping, steps));
    }
    let timed = options.mapping.iter().find(|mapping| mapping.column == TIME);
    if let Some(time) = timed
        && topics.len() > 1
    {
        let count = topics.len();
        let what = format!("the time of one topic does not apply to others: found {count} topics");
        return Err(time.problem(what).of(path));
    }
    let mut logged: Vec<(Vec<u64>, Track)> = Vec::new();
    for (topic, wanted) in topics {
        logged.push(read_topic(&recording, topic, &wanted)?);
    }
    let first_ns = logged.iter().filter_map(|(times, _)| times.first()).min().copied().unwrap_or(0);
    let tracks: Vec<Track> = logged
        .into_iter()
        .map(|(times, mut track)| {
            match track.columns.iter().position(|(name, _)| name == TIME) {
                Some(at) => {
                    let (_, stamps) = track.columns.remove(at);
                    let first = stamps.first().copied().unwrap_or(0.0);
                    track.time_s = stamps.into_iter().map(|stamp| stamp - first).collect();
                }
                None => {
                    track.time_s = times
                        .into_iter()
                        .map(|ns| ns.saturating_sub(first_ns) as f64 * 1e-9)
                        .collect()
                }
            }
            track
        })
        .collect();
    // Times stamped by the sender are used unchanged; those of writing jitter.
    if timed.is_some() && options.resample_hz.is_none() {
        let Track { rows, time_s, columns } = tracks.into_iter().next().unwrap_or_default();
        return Draft::in_memory(time_s, rows, columns).finish(path, options);
    }
    on_one_grid(&tracks, options.resample_hz)
        .and_then(|draft| draft.checked(path, options)?.into_record())
        .map_err(|problem| problem.of(path))
}

/// Times of a topic's messages (ns), and the columns requested.
fn read_topic(
    recording: &Recording,
    topic: &str,
    wanted: &[(&Mapping, Vec<PathElement>)],
) -> Result<(Vec<u64>, Track), RecordError> {
    let file = recording.path();
    let Some((first, _)) = wanted.first() else { return Ok((Vec::new(), Track::default())) };
    let ids = recording.channels_of(topic)?;
    let mut decoders = BTreeMap::new();
    for id in &ids {
        let Some(channel) = recording.channels.get(id) else { continue };
        decoders.insert(*id, Decoder::of(channel).map_err(|what| first.problem(what).of(file))?);
    }
    let mut times = Vec::new();
    let mut columns: Vec<(String, Vec<f64>)> =
        wanted.iter().map(|(mapping, _)| (mapping.column.clone(), Vec::new())).collect();
    for (index, raw) in
        recording.raw(Selection { channels: Some(ids), ..Selection::default() }).enumerate()
    {
        let raw = raw?;
        let Some(decoder) = decoders.get(&raw.channel_id()) else { continue };
        let at = |what: String| format!("message {}: {what}", index + 1);
        let message =
            decoder.decode(raw.data()).map_err(|what| first.problem(at(what)).of(file))?;
        for ((mapping, steps), (_, values)) in wanted.iter().zip(&mut columns) {
            let value = message.number(steps).map_err(|what| mapping.problem(at(what)).of(file))?;
            values.push(mapping.factor * value);
        }
        times.push(raw.log_time_ns());
    }
    let rows = (1..=times.len() as u64).collect();
    Ok((times, Track { rows, time_s: Vec::new(), columns }))
}

/// How the messages of a channel are decoded.
enum Decoder {
    Ros(Box<MessageSchema>),
    Json,
}

/// A decoded message.
enum Message {
    Ros(Value),
    Json(serde_json::Value),
}

impl Decoder {
    fn of(channel: &Channel) -> Result<Self, String> {
        match (channel.message_encoding.as_str(), channel.schema_encoding.as_str()) {
            ("json", _) => Ok(Self::Json),
            ("cdr", "ros2msg") => MessageSchema::parse(&channel.schema_name, &channel.schema)
                .map(|schema| Self::Ros(Box::new(schema)))
                .map_err(|error| {
                    format!("schema {} cannot be read: {error:#}", channel.schema_name)
                }),
            (message, schema) => Err(format!(
                "expected messages in cdr with a schema in ros2msg, or in json; found {message} \
                    with a schema in {}",
                if schema.is_empty() { "nothing" } else { schema }
            )),
        }
    }

    fn decode(&self, data: &[u8]) -> Result<Message, String> {
        let schema = match self {
            Self::Json => {
                return serde_json::from_slice(data)
                    .map(Message::Json)
                    .map_err(|error| error.to_string());
            }
            Self::Ros(schema) => schema,
        };
        let resolver =
            MapResolver::new(schema.dependencies.iter().map(|spec| (spec.name.clone(), spec)));
        // A header of four bytes gives byte order and options; alignment counts from after it.
        let value = match data.split_at_checked(4) {
            Some(([0, 0, ..], body)) => {
                decode_message(&mut CdrReader::<BigEndian>::new(body), &schema.spec, &resolver)
            }
            Some(([0, 1, ..], body)) => {
                decode_message(&mut CdrReader::<LittleEndian>::new(body), &schema.spec, &resolver)
            }
            _ => {
                return Err(format!(
                    "expected plain CDR, found {:02x?}",
                    data.get(..4.min(data.len())).unwrap_or_default()
                ));
            }
        };
        value.map(Message::Ros).map_err(|error| error.to_string())
    }
}

impl Message {
    /// The number at a path; a stamp of seconds and nanoseconds counts as one (s).
    fn number(&self, steps: &[PathElement]) -> Result<f64, String> {
        let found = match self {
            Self::Ros(value) => in_ros(value, steps),
            Self::Json(value) => in_json(value, steps),
        };
        found.ok_or_else(|| {
            let has = match self {
                Self::Ros(Value::Message(fields)) => fields.keys().cloned().collect::<Vec<_>>(),
                Self::Json(serde_json::Value::Object(fields)) => fields.keys().cloned().collect(),
                _ => Vec::new(),
            };
            format!("no number there; the message has {}", has.join(", "))
        })
    }
}

fn in_ros(value: &Value, steps: &[PathElement]) -> Option<f64> {
    match (value, steps) {
        (Value::Message(fields), [PathElement::Field(name), rest @ ..]) => {
            in_ros(fields.get(name)?, rest)
        }
        (
            Value::Array(values) | Value::Sequence(values),
            [PathElement::Index(index), rest @ ..],
        ) => in_ros(values.get(*index)?, rest),
        (
            Value::PrimitiveArray(values) | Value::PrimitiveSeq(values),
            [PathElement::Index(index)],
        ) => element(values, *index),
        (Value::Message(fields), []) => {
            let of = |name: &str| in_ros(fields.get(name)?, &[]);
            Some(of("sec")? + 1e-9 * of("nanosec")?)
        }
        (value, []) => Some(match value {
            Value::Bool(value) => f64::from(u8::from(*value)),
            Value::I8(value) => f64::from(*value),
            Value::U8(value) => f64::from(*value),
            Value::I16(value) => f64::from(*value),
            Value::U16(value) => f64::from(*value),
            Value::I32(value) => f64::from(*value),
            Value::U32(value) => f64::from(*value),
            Value::I64(value) => *value as f64,
            Value::U64(value) => *value as f64,
            Value::F32(value) => f64::from(*value),
            Value::F64(value) => *value,
            _ => return None,
        }),
        _ => None,
    }
}

fn element(values: &PrimitiveArray, index: usize) -> Option<f64> {
    match values {
        PrimitiveArray::Bool(values) => values.get(index).map(|value| f64::from(u8::from(*value))),
        PrimitiveArray::I8(values) => values.get(index).copied().map(f64::from),
        PrimitiveArray::U8(values) => values.get(index).copied().map(f64::from),
        PrimitiveArray::I16(values) => values.get(index).copied().map(f64::from),
        PrimitiveArray::U16(values) => values.get(index).copied().map(f64::from),
        PrimitiveArray::I32(values) => values.get(index).copied().map(f64::from),
        PrimitiveArray::U32(values) => values.get(index).copied().map(f64::from),
        PrimitiveArray::I64(values) => values.get(index).map(|value| *value as f64),
        PrimitiveArray::U64(values) => values.get(index).map(|value| *value as f64),
        PrimitiveArray::F32(values) => values.get(index).copied().map(f64::from),
        PrimitiveArray::F64(values) => values.get(index).copied(),
        PrimitiveArray::String(_) => None,
    }
}

fn in_json(value: &serde_json::Value, steps: &[PathElement]) -> Option<f64> {
    match (value, steps) {
        (serde_json::Value::Bool(value), []) => Some(f64::from(u8::from(*value))),
        (serde_json::Value::Object(fields), []) => {
            let of = |names: [&str; 2]| {
                names.into_iter().find_map(|name| in_json(fields.get(name)?, &[]))
            };
            Some(of(["sec", "secs"])? + 1e-9 * of(["nanosec", "nsec"])?)
        }
        (value, []) => value.as_f64(),
        (value, [PathElement::Field(name), rest @ ..]) => in_json(value.get(name)?, rest),
        (value, [PathElement::Index(index), rest @ ..]) => in_json(value.get(index)?, rest),
    }
}
