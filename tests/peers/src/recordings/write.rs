//! The same messages by one writer or another.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::BufWriter;
use std::path::Path;

use ipc_types::{CDR_HEADER, TOPICS};
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use recording::mcap_write::{CHUNK_BYTES, FLUSH_NS, SYNC_NS, Start, Writer};
use runtime::clock::{SECOND_NS, now_ns};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};

use crate::{Failure, map};

/// A message as the logger receives it.
struct Recorded {
    /// Index of its topic.
    topic: usize,
    bytes: Vec<u8>,
    /// When it was published (ns).
    time_ns: u64,
    sequence: u32,
}

/// Writes the messages of `source` to `out`, which must not exist; says what that took.
pub(crate) fn again(writer: &str, source: &Path, out: &Path) -> Result<Value, Failure> {
    let messages = messages(source)?;
    let began = (now_ns(), processor_ns());
    match writer {
        "farreach" => by_farreach(&messages, out)?,
        "mcap" => by_mcap(&messages, out)?,
        _ => return Err(format!("expected the writer farreach or mcap, found {writer}").into()),
    }
    let (taken_ns, processor_ns) = (now_ns() - began.0, processor_ns() - began.1);
    Ok(json!({
        "messages": messages.len(),
        "s": taken_ns as f64 * 1e-9,
        "processor_s": processor_ns as f64 * 1e-9,
        "bytes": out.metadata()?.len(),
    }))
}

/// The messages of a recording of farreach, in memory.
fn messages(source: &Path) -> Result<Vec<Recorded>, Failure> {
    let bytes = map(source)?;
    let mut messages = Vec::new();
    for message in mcap::MessageStream::new(&bytes)? {
        let message = message?;
        let topic = TOPICS.iter().position(|topic| topic.name == message.channel.topic);
        let topic = topic.ok_or_else(|| format!("no topic {}", message.channel.topic))?;
        let bytes = message.data.get(CDR_HEADER.len()..).ok_or("a message is too short")?.to_vec();
        let time = bytes.get(24..32).ok_or("a message is too short")?.try_into()?;
        let (time_ns, sequence) = (u64::from_le_bytes(time), message.sequence);
        messages.push(Recorded { topic, bytes, time_ns, sequence });
    }
    if messages.is_empty() {
        return Err(format!("{}: it has no messages", source.display()).into());
    }
    Ok(messages)
}

/// As the logger writes them, with its flushes and syncs in the time of the messages.
fn by_farreach(messages: &[Recorded], out: &Path) -> Result<(), Failure> {
    let mut writer = Writer::create(out, &Start::default(), messages[0].time_ns)?;
    for message in messages {
        writer.write(message.topic, &message.bytes)?;
        writer.tick(message.time_ns)?;
    }
    writer.finish(&[])?;
    Ok(())
}

/// By the crate alone: the same schemas, chunks, compression, flushes and syncs.
fn by_mcap(messages: &[Recorded], out: &Path) -> Result<(), Failure> {
    let file: File = OpenOptions::new().write(true).create_new(true).open(out)?;
    let to_sync = file.try_clone()?;
    let mut writer = mcap::WriteOptions::new()
        .compression(Some(mcap::Compression::Lz4))
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true)
        .profile("ros2")
        .create(NoSeek::new(BufWriter::with_capacity(128 * 1024, file)))?;
    let mut channels = Vec::new();
    for topic in TOPICS {
        let schema = writer.add_schema(topic.ros_name, "ros2msg", (topic.schema)().as_bytes())?;
        channels.push(writer.add_channel(schema, topic.name, "cdr", &BTreeMap::new())?);
    }
    let mut payload = Vec::new();
    let (mut flushed_ns, mut synced_ns) = (messages[0].time_ns, messages[0].time_ns);
    for message in messages {
        payload.clear();
        payload.extend_from_slice(&CDR_HEADER);
        payload.extend_from_slice(&message.bytes);
        let header = MessageHeader {
            channel_id: channels[message.topic],
            sequence: message.sequence,
            log_time: message.time_ns,
            publish_time: message.time_ns,
        };
        writer.write_to_known_channel(&header, &payload)?;
        let sync = message.time_ns.saturating_sub(synced_ns) >= SYNC_NS;
        if sync || message.time_ns.saturating_sub(flushed_ns) >= FLUSH_NS {
            writer.flush()?;
            flushed_ns = message.time_ns;
        }
        if sync {
            to_sync.sync_data()?;
            synced_ns = message.time_ns;
        }
    }
    writer.finish()?;
    drop(writer);
    to_sync.sync_data()?;
    Ok(())
}

/// Processor time that this process has used (ns).
fn processor_ns() -> u64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as u64 * SECOND_NS + time.tv_nsec as u64
}
