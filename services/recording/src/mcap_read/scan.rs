//! Finds the records of a file without decompressing anything.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, TryLockError};
use std::io::{self, BufReader, Read};
use std::path::Path;

use mcap::records::{Record, op};

use super::block::{Block, Definition};
use super::summary::{self, DataEnd, FOOTER_BODY, RECORD_HEAD, Summary};
use super::{Channel, Damage, ReadError, Recording, Tail};
use crate::schema::Layout;

/// Longest header, metadata, schema or channel record that is taken for real (bytes).
const LONGEST_RECORD: u64 = 64 << 20;
/// Most bytes of messages outside chunks that are read together.
const LOOSE_BLOCK: u64 = 1 << 20;

#[derive(Default)]
struct Found {
    library: String,
    blocks: Vec<Block>,
    summary: Summary,
    metadata: Vec<(String, BTreeMap<String, String>)>,
    attachments: u64,
    damage: Vec<Damage>,
    data_end: Option<DataEnd>,
}

pub(super) fn open(path: &Path) -> Result<Recording, ReadError> {
    let wrong = |source| ReadError::Io { path: path.to_owned(), source };
    let file = File::open(path).map_err(wrong)?;
    let about = file.metadata().map_err(wrong)?;
    if about.is_dir() {
        return Err(wrong(io::Error::new(
            io::ErrorKind::IsADirectory,
            "it is a directory, expected an MCAP file",
        )));
    }
    let bytes = about.len();
    if bytes == 0 {
        return Err(ReadError::Empty { path: path.to_owned() });
    }
    let mut reader = BufReader::with_capacity(16 * 1024, file.try_clone().map_err(wrong)?);
    let mut magic = Vec::new();
    (&mut reader).take(mcap::MAGIC.len() as u64).read_to_end(&mut magic).map_err(wrong)?;
    if magic != mcap::MAGIC {
        let found = magic.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ");
        return Err(ReadError::NotMcap { path: path.to_owned(), found });
    }
    let mut found = Found::default();
    let mut tail = walk(&mut reader, bytes, &mut found).map_err(wrong)?;
    if !tail.complete {
        // The writer holds a lock for as long as it lives; where locks are not supported, nothing is
        // known.
        tail.being_written = matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock));
        if tail.being_written {
            "the recording is still being written".clone_into(&mut tail.reason);
        }
        // Without a footer nothing says that what was read of the summary is what was written.
        found.summary = Summary::default();
        if let Some(last) = found.blocks.last_mut() {
            // The file may end among the indices of its last chunk: which channels are in it is not
            // known then.
            last.hinted = None;
        }
    }
    found.damage.extend(found.summary.place(&mut found.blocks));
    let mut recording = Recording {
        path: path.to_owned(),
        file,
        bytes,
        library: found.library,
        blocks: found.blocks,
        channels: BTreeMap::new(),
        metadata: found.metadata,
        attachments: found.attachments,
        damage: found.damage,
        data_end: found.data_end,
        tail,
    };
    define(&mut recording, found.summary.definitions)?;
    Ok(recording)
}

/// Walks the records from behind the magic to the end of the file or to the first that cannot be
/// one.
fn walk(reader: &mut BufReader<File>, bytes: u64, found: &mut Found) -> io::Result<Tail> {
    let mut at = mcap::MAGIC.len() as u64;
    let mut data_ended = false;
    let torn = |at: u64, reason: String| Tail {
        readable: at,
        lost: bytes - at,
        reason,
        ..Tail::default()
    };
    loop {
        let left = bytes - at;
        if left == 0 {
            return Ok(torn(
                at,
                "the file ends without a footer: the writer was stopped before it could end it"
                    .into(),
            ));
        }
        if left < RECORD_HEAD {
            return Ok(torn(
                at,
                format!("the file ends within the head of a record ({left} bytes of it are there)"),
            ));
        }
        let mut head = [0u8; RECORD_HEAD as usize];
        reader.read_exact(&mut head)?;
        let opcode = head[0];
        let length = u64::from_le_bytes([
            head[1], head[2], head[3], head[4], head[5], head[6], head[7], head[8],
        ]);
        if opcode == 0 {
            return Ok(torn(
                at,
                "no record but zeros: the machine stopped before the data reached the disk".into(),
            ));
        }
        if length > left - RECORD_HEAD {
            let there = left - RECORD_HEAD;
            return Ok(torn(
                at,
                format!("the file ends within a record: {there} of its {length} bytes are there"),
            ));
        }
        let next = at + RECORD_HEAD + length;
        match opcode {
            op::CHUNK => {
                found.blocks.push(Block::chunk(at, RECORD_HEAD + length));
                skip(reader, length)?;
            }
            op::MESSAGE_INDEX => {
                let mut id = [0u8; 2];
                let used = length.min(2) as usize;
                reader.read_exact(&mut id[..used])?;
                skip(reader, length - used as u64)?;
                if let Some(block) = found.blocks.last_mut().filter(|block| block.chunk) {
                    block.hinted.get_or_insert_default().push(u16::from_le_bytes(id));
                }
            }
            op::MESSAGE | op::SCHEMA | op::CHANNEL if !data_ended => {
                match found.blocks.last_mut() {
                    Some(b) if !b.chunk && b.offset + b.length == at && b.length < LOOSE_BLOCK => {
                        b.length = next - b.offset
                    }
                    _ => found.blocks.push(Block::loose(at, next - at)),
                }
                skip(reader, length)?;
            }
            op::HEADER
            | op::METADATA
            | op::SCHEMA
            | op::CHANNEL
            | op::CHUNK_INDEX
            | op::DATA_END
                if length <= LONGEST_RECORD =>
            {
                let mut body = vec![0u8; length as usize];
                reader.read_exact(&mut body)?;
                found.small(at, opcode, &body);
                data_ended |= opcode == op::DATA_END;
            }
            op::FOOTER => {
                let mut body = [0u8; FOOTER_BODY];
                let used = length.min(FOOTER_BODY as u64);
                reader.read_exact(&mut body[..used as usize])?;
                skip(reader, length - used)?;
                if let Err(what) = summary::verify(reader.get_ref(), at, &body)? {
                    found.damage.push(Damage { offset: at, what });
                    found.summary = Summary::default();
                }
                if found.data_end.is_none() {
                    found.damage.push(Damage {
                        offset: at,
                        what: "a footer without an end of the data before it".into(),
                    });
                }
                let mut magic = Vec::new();
                reader.take(mcap::MAGIC.len() as u64 + 1).read_to_end(&mut magic)?;
                let end = next + mcap::MAGIC.len() as u64;
                return Ok(if magic == mcap::MAGIC && end == bytes {
                    Tail { complete: true, readable: bytes, ..Tail::default() }
                } else {
                    torn(next, "the end mark behind the footer is missing or not the last thing in the file".into())
                });
            }
            _ => {
                found.attachments += u64::from(opcode == op::ATTACHMENT);
                skip(reader, length)?;
            }
        }
        at = next;
    }
}

fn skip(reader: &mut BufReader<File>, length: u64) -> io::Result<()> {
    let length = i64::try_from(length).map_err(|_| io::Error::from(io::ErrorKind::InvalidData))?;
    reader.seek_relative(length)
}

impl Found {
    fn small(&mut self, at: u64, opcode: u8, body: &[u8]) {
        match mcap::parse_record(opcode, body) {
            Ok(Record::Header(header)) => self.library = header.library,
            Ok(Record::Metadata(metadata)) => {
                self.metadata.push((metadata.name, metadata.metadata))
            }
            Ok(Record::DataEnd(end)) => {
                self.data_end = Some(DataEnd { offset: at, checksum: end.data_section_crc })
            }
            Ok(Record::ChunkIndex(index)) => self.summary.chunks.push(index),
            Ok(record) => self.summary.definitions.extend(Definition::of(record)),
            Err(error) => self
                .damage
                .push(Damage { offset: at, what: format!("record {opcode:#04x}: {error}") }),
        }
    }
}

/// Finds the schemas and channels: in the summary, and where there is none (a torn file) in the
/// chunks.
fn define(recording: &mut Recording, summary: Vec<Definition>) -> Result<(), ReadError> {
    let mut schemas = BTreeMap::new();
    let mut channels = BTreeMap::new();
    let mut take = |definitions: Vec<Definition>, schemas: &mut BTreeMap<_, _>| {
        for definition in definitions {
            match definition {
                Definition::Schema { id, name, encoding, text } => {
                    schemas.entry(id).or_insert((name, encoding, text));
                }
                Definition::Channel(channel) => {
                    channels.entry(channel.id).or_insert(channel);
                }
            }
        }
        channels.keys().copied().collect::<BTreeSet<u16>>()
    };
    let from_summary = !summary.is_empty();
    let mut known = take(summary, &mut schemas);
    let mut buffer = Vec::new();
    for (index, block) in recording.blocks.iter().enumerate() {
        let covered = match block.channels.as_ref().or(block.hinted.as_ref()) {
            Some(used) => used.iter().all(|id| known.contains(id)) && (from_summary || index > 0),
            None => from_summary && recording.tail.complete,
        };
        if covered {
            continue;
        }
        // A damaged chunk is met again, and reported, by whoever reads the messages.
        match recording.load(block, &mut buffer) {
            Ok(loaded) => known = take(loaded.definitions, &mut schemas),
            Err(error @ ReadError::Io { .. }) => return Err(error),
            Err(_) => {}
        }
    }
    recording.channels = channels
        .into_iter()
        .map(|(id, channel)| {
            let (schema_name, schema_encoding, schema) =
                schemas.get(&channel.schema_id).cloned().unwrap_or_default();
            let layout = Layout::parse(&schema_name, &schema_encoding, &schema);
            let channel = Channel {
                topic: channel.topic,
                schema_name,
                schema_encoding,
                schema,
                message_encoding: channel.message_encoding,
                metadata: channel.metadata,
                layout,
            };
            (id, channel)
        })
        .collect();
    Ok(())
}
