//! Blocks: the parts of a file that hold messages, read and decompressed one at a time.

use std::os::unix::fs::FileExt;
use std::sync::Arc;

use mcap::McapError;
use mcap::records::{MessageHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::zstd::Zstd;
use super::{ReadError, Recording};

/// Opcode and length in front of every record (bytes).
pub(super) const RECORD_HEAD: u64 = 9;
/// Largest chunk that is decompressed (bytes); farreach writes about 1 MiB. A damaged length must
/// not exhaust the memory.
const LARGEST_CHUNK: usize = 512 << 20;
/// Most bytes that a byte of a compressed chunk can stand for: a run in lz4 grows by 255 with each
/// byte of its length, and four bytes of zstd repeat one byte 128 Ki times.
const LARGEST_RATIO: [(&str, u64); 2] = [("lz4", 255), ("zstd", 32_768)];
/// What the head of a compressed chunk may say beyond that (bytes).
const RATIO_MARGIN: u64 = 64 << 10;

/// A range of the file that holds messages: one chunk, or a run of records outside chunks.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub(super) offset: u64,
    pub(super) length: u64,
    /// log times within, from the checked summary; `None` where unknown
    pub(super) times: Option<(u64, u64)>,
    /// channels with messages within, from the checked summary; `None` where unknown. Most chunks
    /// have the same, and share them.
    pub(super) channels: Option<Arc<[u16]>>,
    /// The same from the message indexes after the chunk. They have no checksum: they may say where
    /// definitions are, never which messages need not be read.
    pub(super) hinted: Option<Vec<u16>>,
    pub(super) chunk: bool,
}

impl Block {
    pub(super) fn chunk(offset: u64, length: u64) -> Self {
        Self { offset, length, times: None, channels: None, hinted: None, chunk: true }
    }
    pub(super) fn loose(offset: u64, length: u64) -> Self {
        Self { chunk: false, ..Self::chunk(offset, length) }
    }

    /// The channels within, as far as anything tells.
    pub(super) fn channels_or_hint(&self) -> Option<&[u16]> {
        self.channels.as_deref().or(self.hinted.as_deref())
    }
}

/// A schema or channel found in the file.
#[derive(Debug)]
pub(super) enum Definition {
    Schema { id: u16, name: String, encoding: String, text: String },
    Channel(mcap::records::Channel),
}

impl Definition {
    pub(super) fn of(record: Record<'_>) -> Option<Self> {
        match record {
            Record::Schema { header, data } => Some(Self::Schema {
                id: header.id,
                name: header.name,
                encoding: header.encoding,
                text: String::from_utf8_lossy(&data).into_owned(),
            }),
            Record::Channel(channel) => Some(Self::Channel(channel)),
            _ => None,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Head {
    pub(super) header: MessageHeader,
    start: usize,
    end: usize,
}

/// The messages of one block.
#[derive(Debug, Default)]
pub(super) struct Loaded {
    pub(super) definitions: Vec<Definition>,
    pub(super) heads: Vec<Head>,
    data: Vec<u8>,
}

/// One message, not decoded. Cheap to keep: it shares the memory of its chunk.
#[derive(Clone, Debug)]
pub struct RawMessage {
    pub(super) block: Arc<Loaded>,
    pub(super) head: Head,
}

impl RawMessage {
    /// What the file says of it.
    pub(crate) fn header(&self) -> MessageHeader {
        self.head.header
    }
    /// Number of its channel.
    pub fn channel_id(&self) -> u16 {
        self.head.header.channel_id
    }
    /// Sequence number (the lower 32 bits of the message's own).
    pub fn sequence(&self) -> u32 {
        self.head.header.sequence
    }
    /// When it was published, by the wall clock of the recording (ns since 1970).
    pub fn log_time_ns(&self) -> u64 {
        self.head.header.log_time
    }
    /// The same, from the publish time.
    pub fn publish_time_ns(&self) -> u64 {
        self.head.header.publish_time
    }
    /// The payload, CDR header included.
    pub fn data(&self) -> &[u8] {
        self.block.data.get(self.head.start..self.head.end).unwrap_or_default()
    }
}

impl Recording {
    /// Reads one block; `buffer` is scratch memory.
    pub(super) fn load(&self, block: &Block, buffer: &mut Vec<u8>) -> Result<Loaded, ReadError> {
        let damaged = |source| ReadError::Damaged {
            path: self.path().to_owned(),
            offset: block.offset,
            source: Box::new(source),
        };
        let too_large = || damaged(McapError::ChunkTooLarge(block.length));
        let length = usize::try_from(block.length)
            .ok()
            .filter(|&n| n <= LARGEST_CHUNK)
            .ok_or_else(too_large)?;
        buffer.resize(length, 0);
        self.file
            .read_exact_at(buffer, block.offset)
            .map_err(|source| ReadError::Io { path: self.path().to_owned(), source })?;
        self.watch.read(block.length);
        if block.chunk {
            check_chunk(buffer).map_err(damaged)?;
        }
        decode(buffer).map_err(damaged)
    }
}

/// Checks what the library takes on trust: that the bytes are one chunk, as the summary says, that
/// it does not claim more memory than they can fill, and that its last record does not reach beyond
/// it.
fn check_chunk(bytes: &[u8]) -> mcap::McapResult<()> {
    let body = bytes.get(RECORD_HEAD as usize..).unwrap_or_default();
    // A record's head has no checksum, and the library passes over records of unknown kinds.
    let length = bytes.get(1..).and_then(|head| head.first_chunk()).copied();
    if bytes.first() != Some(&op::CHUNK)
        || length.map(u64::from_le_bytes) != Some(body.len() as u64)
    {
        return Err(McapError::BadIndex);
    }
    let Record::Chunk { header, data } = mcap::parse_record(op::CHUNK, body)? else {
        return Ok(());
    };
    if header.compression.is_empty() {
        let mut rest = &data[..];
        while let Some((_opcode, after)) = rest.split_first() {
            let (length, after) = after.split_first_chunk().ok_or(McapError::UnexpectedEoc)?;
            let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
            rest = after.get(length..).ok_or(McapError::UnexpectedEoc)?;
        }
        return Ok(());
    }
    let named = |(name, _): &&(&str, u64)| *name == header.compression;
    let ratio = LARGEST_RATIO.iter().find(named).map_or(u64::MAX, |(_, ratio)| *ratio);
    let most = (data.len() as u64).saturating_mul(ratio).saturating_add(RATIO_MARGIN);
    if header.uncompressed_size > most {
        return Err(McapError::ChunkTooLarge(header.uncompressed_size));
    }
    Ok(())
}

/// Decodes a range of complete records; chunks only when their checksum is right.
fn decode(mut bytes: &[u8]) -> mcap::McapResult<Loaded> {
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LARGEST_CHUNK),
    );
    reader.add_decompressor(Zstd::new(LARGEST_CHUNK))?;
    let mut loaded = Loaded::default();
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let given = wanted.min(bytes.len());
                let (now, later) = bytes.split_at(given);
                reader.insert(given).copy_from_slice(now);
                reader.notify_read(given);
                bytes = later;
            }
            LinearReadEvent::Record {
                opcode: opcode @ (op::MESSAGE | op::SCHEMA | op::CHANNEL),
                data,
            } => match mcap::parse_record(opcode, data)? {
                Record::Message { header, data } => loaded.message(header, &data),
                record => loaded.definitions.extend(Definition::of(record)),
            },
            LinearReadEvent::Record { .. } => {}
        }
    }
    Ok(loaded)
}

impl Loaded {
    fn message(&mut self, header: MessageHeader, payload: &[u8]) {
        let start = self.data.len();
        self.data.extend_from_slice(payload);
        self.heads.push(Head { header, start, end: self.data.len() });
    }
}
