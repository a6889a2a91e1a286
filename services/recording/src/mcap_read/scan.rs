//! Finds the records of a file without decompressing chunks.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, TryLockError};
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::iter::Peekable;
use std::path::Path;
use std::vec::IntoIter;

use mcap::records::{Metadata, Record, op};

use super::block::{Block, Definition, RECORD_HEAD};
use super::summary::{self, DataEnd, FOOTER_BODY, Placed, Summary, Whole};
use super::watch::Watch;
use super::{Channel, Damage, DamagedMetadata, ReadError, Recording, Tail};
use crate::mcap_write::DAMAGED_RECORD;
use crate::record_checksum;
use crate::schema::Layout;

/// Longest header, metadata, schema or channel record that is read (bytes).
const LONGEST_RECORD: u64 = 64 << 20;
/// Longest run of messages outside chunks that is read at once (bytes).
const LOOSE_BLOCK: u64 = 1 << 20;

/// The recording as far as it was read, and its summary.
struct Found {
    recording: Recording,
    summary: Summary,
}

/// What the end of a file tells of it before its records are read.
struct Known {
    chunks: Peekable<IntoIter<Placed>>,
    /// Where the summary begins.
    summary: u64,
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
    let mut magic = Vec::new();
    (&file).take(mcap::MAGIC.len() as u64).read_to_end(&mut magic).map_err(wrong)?;
    if magic != mcap::MAGIC {
        let found = magic.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ");
        return Err(ReadError::NotMcap { path: path.to_owned(), found });
    }
    let (found, tail) = match by_summary(path, &file, bytes).map_err(wrong)? {
        Some(found) => found,
        None => {
            let mut found = Found::new(path, &file, bytes).map_err(wrong)?;
            let tail = walk(&mut Source::new(&file).map_err(wrong)?, bytes, &mut found, None);
            (found, tail.map_err(wrong)?)
        }
    };
    let Found { mut recording, mut summary } = found;
    recording.tail = tail;
    if !recording.tail.complete {
        // The writer holds a lock while it is alive (unless the file system has none).
        let lock = recording.file.try_lock_shared();
        recording.tail.being_written = matches!(lock, Err(TryLockError::WouldBlock));
        if recording.tail.being_written {
            "the recording is still being written".clone_into(&mut recording.tail.reason);
        }
        // Without a footer nothing confirms what was read of the summary.
        summary = Summary::default();
        if let Some(last) = recording.blocks.last_mut() {
            // The file may end within the message indexes of its last chunk.
            last.hinted = None;
        }
    }
    recording.damage.extend(summary.place(&mut recording.blocks));
    define(&mut recording, summary.definitions)?;
    Ok(recording)
}

/// Takes the places of the chunks from the summary of a whole file, and reads the records between
/// them. `None` where there is no such summary, or what lies between is not what it should be.
fn by_summary(path: &Path, file: &File, bytes: u64) -> io::Result<Option<(Found, Tail)>> {
    let Some(Whole { mut summary, begins }) = summary::at_the_end(file, bytes)? else {
        return Ok(None);
    };
    let mut found = Found::new(path, file, bytes)?;
    let chunks = std::mem::take(&mut summary.chunks);
    let count = chunks.len();
    let known = Known { chunks: chunks.into_iter().peekable(), summary: begins };
    let tail = walk(&mut Source::new(file)?, bytes, &mut found, Some(known))?;
    if !tail.complete {
        return Ok(None);
    }
    // Messages that the summary does not know of are not in its counts.
    if found.recording.blocks.len() == count {
        found.recording.counts = summary.counts.take();
    }
    found.summary = summary;
    Ok(Some((found, tail)))
}

/// Reads a file from its front to its back, and passes over much of it.
struct Source {
    reader: BufReader<File>,
    /// Bytes that are passed over before the next are read.
    behind: u64,
}

impl Source {
    fn new(file: &File) -> io::Result<Self> {
        let mut reader = BufReader::with_capacity(16 * 1024, file.try_clone()?);
        reader.seek(SeekFrom::Start(mcap::MAGIC.len() as u64))?;
        Ok(Self { reader, behind: 0 })
    }

    fn skip(&mut self, length: u64) {
        self.behind = self.behind.saturating_add(length);
    }

    fn read_exact(&mut self, bytes: &mut [u8]) -> io::Result<()> {
        let behind = i64::try_from(std::mem::take(&mut self.behind));
        self.reader.seek_relative(behind.map_err(|_| io::ErrorKind::InvalidData)?)?;
        self.reader.read_exact(bytes)
    }
}

/// Reads the records from after the magic to the end of the file, or to the first invalid one. With
/// what is `known`, up to the summary; the tail is complete where every record lies between known
/// chunks.
fn walk(
    reader: &mut Source,
    bytes: u64,
    found: &mut Found,
    mut known: Option<Known>,
) -> io::Result<Tail> {
    let mut at = mcap::MAGIC.len() as u64;
    let mut data_ended = false;
    loop {
        let mut end = bytes;
        if let Some(Known { chunks, summary }) = &mut known {
            if let Some(placed) = chunks.next_if(|placed| placed.block.offset == at) {
                reader.skip(placed.end - at);
                at = placed.end;
                found.recording.blocks.push(placed.block);
                continue;
            }
            if at == *summary && data_ended {
                return Ok(Tail { complete: true, readable: bytes, ..Tail::default() });
            }
            end = chunks.peek().map_or(*summary, |placed| placed.block.offset);
        }
        let (opcode, length) = match record_head(reader, end - at)? {
            Ok(head) => head,
            Err(reason) => return Ok(torn(at, bytes, reason)),
        };
        let next = at + RECORD_HEAD + length;
        match opcode {
            op::CHUNK => {
                found.recording.blocks.push(Block::chunk(at, RECORD_HEAD + length));
                reader.skip(length);
            }
            op::MESSAGE_INDEX => {
                let mut id = [0u8; 2];
                let used = length.min(2) as usize;
                reader.read_exact(&mut id[..used])?;
                reader.skip(length - used as u64);
                if let Some(block) = found.recording.blocks.last_mut().filter(|block| block.chunk) {
                    block.hinted.get_or_insert_default().push(u16::from_le_bytes(id));
                }
            }
            op::MESSAGE | op::SCHEMA | op::CHANNEL if !data_ended => {
                match found.recording.blocks.last_mut() {
                    Some(b) if !b.chunk && b.offset + b.length == at && b.length < LOOSE_BLOCK => {
                        b.length = next - b.offset
                    }
                    _ => found.recording.blocks.push(Block::loose(at, next - at)),
                }
                reader.skip(length);
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
            op::FOOTER if known.is_none() => return footer(reader, (at, length), bytes, found),
            _ => {
                found.recording.attachments += u64::from(opcode == op::ATTACHMENT);
                reader.skip(length);
            }
        }
        at = next;
    }
}

fn torn(at: u64, bytes: u64, reason: String) -> Tail {
    Tail { readable: at, lost: bytes - at, reason, ..Tail::default() }
}

/// Opcode and length of the next record, of which `left` bytes are there; or why it is none.
fn record_head(reader: &mut Source, left: u64) -> io::Result<Result<(u8, u64), String>> {
    if left == 0 {
        return Ok(Err(
            "the file ends without a footer: the writer was stopped before it could end it"
                .to_owned(),
        ));
    }
    if left < RECORD_HEAD {
        return Ok(Err(format!(
            "the file ends within the head of a record ({left} bytes of it are there)"
        )));
    }
    let mut opcode = [0u8; 1];
    let mut length = [0u8; 8];
    reader.read_exact(&mut opcode)?;
    reader.read_exact(&mut length)?;
    let length = u64::from_le_bytes(length);
    let there = left - RECORD_HEAD;
    Ok(match opcode[0] {
        0 => {
            Err("zeros instead of a record: the computer stopped before the data reached the disk"
                .to_owned())
        }
        _ if length > there => {
            Err(format!("the file ends within a record: {there} of its {length} bytes are there"))
        }
        opcode => Ok((opcode, length)),
    })
}

/// Reads the footer, verifies the summary by it, and expects the end of the file.
fn footer(
    reader: &mut Source,
    (at, length): (u64, u64),
    bytes: u64,
    found: &mut Found,
) -> io::Result<Tail> {
    let mut body = [0u8; FOOTER_BODY];
    let used = length.min(FOOTER_BODY as u64);
    reader.read_exact(&mut body[..used as usize])?;
    reader.skip(length - used);
    if let Err(what) = summary::verify(&found.recording.file, at, &body)? {
        found.recording.damage.push(Damage { offset: at, what });
        found.summary = Summary::default();
    }
    if found.recording.data_end.is_none() {
        let what = "a footer without an end of the data before it".to_owned();
        found.recording.damage.push(Damage { offset: at, what });
    }
    let next = at + RECORD_HEAD + length;
    let left = bytes.saturating_sub(next).min(mcap::MAGIC.len() as u64 + 1);
    let mut magic = vec![0u8; left as usize];
    reader.read_exact(&mut magic)?;
    Ok(if magic == mcap::MAGIC {
        Tail { complete: true, readable: bytes, ..Tail::default() }
    } else {
        let reason = "the end mark after the footer is missing, or not at the end".to_owned();
        torn(next, bytes, reason)
    })
}

impl Found {
    fn new(path: &Path, file: &File, bytes: u64) -> io::Result<Self> {
        let recording = Recording {
            path: path.to_owned(),
            file: file.try_clone()?,
            bytes,
            library: String::new(),
            blocks: Vec::new(),
            counts: None,
            channels: BTreeMap::new(),
            metadata_records: Vec::new(),
            attachments: 0,
            damage: Vec::new(),
            damaged_metadata: None,
            data_end: None,
            watch: Watch::default(),
            tail: Tail::default(),
        };
        Ok(Self { recording, summary: Summary::default() })
    }

    fn small(&mut self, at: u64, opcode: u8, body: &[u8]) {
        match mcap::parse_record(opcode, body) {
            Ok(Record::Header(header)) => self.recording.library = header.library,
            Ok(Record::Metadata(record)) => self.metadata(at, record),
            Ok(Record::DataEnd(end)) => {
                self.recording.data_end =
                    Some(DataEnd { offset: at, checksum: end.data_section_crc })
            }
            Ok(record) => self.summary.take(record),
            Err(error) => {
                let what = format!("record {opcode:#04x}: {error}");
                if opcode == op::METADATA {
                    let found = format!("a record that cannot be read ({error})");
                    self.damaged_metadata(at, "metadata", "a whole record".to_owned(), found);
                }
                self.recording.damage.push(Damage { offset: at, what });
            }
        }
    }

    /// Takes a metadata record; a damaged one under a name by which nobody reads it.
    fn metadata(&mut self, at: u64, record: Metadata) {
        let Metadata { mut name, metadata: mut content } = record;
        if name == DAMAGED_RECORD {
            let of = content.get("record").map_or("?", String::as_str);
            let what = format!("metadata record {of} was damaged when the file was recovered");
            self.recording.damage.push(Damage { offset: at, what });
        } else if let Err((expected, found)) = record_checksum::verify(&name, &content) {
            let what = format!(
                "metadata record {name}: expected checksum {expected}, found {found}; it may hold \
                 another rig file or protocol than was recorded"
            );
            self.recording.damage.push(Damage { offset: at, what });
            self.damaged_metadata(at, &name, expected, found);
            let former = std::mem::replace(&mut name, DAMAGED_RECORD.to_owned());
            content.insert("record".to_owned(), former);
        }
        self.recording.metadata_records.push((name, content));
    }

    fn damaged_metadata(&mut self, offset: u64, record: &str, expected: String, found: String) {
        let record = record.to_owned();
        let damaged = DamagedMetadata { offset, record, expected, found };
        self.recording.damaged_metadata.get_or_insert(damaged);
    }
}

/// Finds the schemas and channels: in the summary, or where there is none (a torn file) in the
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
        let covered = match block.channels_or_hint() {
            Some(used) => used.iter().all(|id| known.contains(id)) && (from_summary || index > 0),
            None => from_summary && recording.tail.complete,
        };
        if covered {
            continue;
        }
        // A damaged chunk is reported when its messages are read.
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
