//! The summary at the end of a file, and its checksum.
//!
//! Each chunk has a checksum, the records around them have none: one flipped bit in the summary
//! exchanges two topics, one in a message index hides a chunk from readers of that topic. So the
//! summary is used only where the checksum in the footer confirms it; otherwise, and in a torn
//! file, definitions come from the chunks and every chunk is read. A summary that is confirmed also
//! gives the places of the chunks, so that an hour of recording opens without a walk through it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::sync::Arc;

use mcap::records::{ChunkIndex, Record, op};

use super::Damage;
use super::block::{Block, Definition, RECORD_HEAD};

/// Body of a footer: start of the summary, start of its offsets, checksum (bytes).
pub(super) const FOOTER_BODY: usize = 8 + 8 + 4;
/// Length of the checksum, which does not cover itself (bytes).
const CHECKSUM: u64 = 4;
/// Read at a time (bytes).
const PIECE: usize = 256 << 10;
/// Longest record of a summary that is read (bytes).
const LONGEST_RECORD: u64 = 64 << 20;

/// Definitions and chunk indexes of the summary.
#[derive(Debug, Default)]
pub(super) struct Summary {
    pub(super) definitions: Vec<Definition>,
    pub(super) chunks: Vec<Placed>,
    /// Messages of each channel; `None` where the summary does not count them.
    pub(super) counts: Option<BTreeMap<u16, u64>>,
    /// The sets of channels that chunks have.
    sets: BTreeSet<Arc<[u16]>>,
}

/// A chunk where the summary says that it is.
#[derive(Debug)]
pub(super) struct Placed {
    pub(super) block: Block,
    /// Where the message indexes behind it end.
    pub(super) end: u64,
}

/// A summary that is whole, and where it begins.
pub(super) struct Whole {
    pub(super) summary: Summary,
    pub(super) begins: u64,
}

/// Where the data section ends, and the checksum over it.
#[derive(Clone, Copy, Debug)]
pub(super) struct DataEnd {
    pub(super) offset: u64,
    /// 0 where the writer computed none.
    pub(super) checksum: u32,
}

/// Verifies the summary of a file whose footer begins at `footer`. A file without a summary, or
/// with one that has no checksum, is accepted.
pub(super) fn verify(file: &File, footer: u64, body: &[u8]) -> io::Result<Result<(), String>> {
    let found = match mcap::parse_record(op::FOOTER, body) {
        Ok(Record::Footer(found)) => found,
        Ok(_) => return Ok(Err("no footer".to_owned())),
        Err(error) => return Ok(Err(format!("footer: {error}"))),
    };
    if found.summary_start == 0 || found.summary_crc == 0 {
        return Ok(Ok(()));
    }
    let end = footer + RECORD_HEAD + FOOTER_BODY as u64 - CHECKSUM;
    if found.summary_start > footer {
        return Ok(Err(format!(
            "the footer says that the summary begins behind it, at byte {}",
            found.summary_start
        )));
    }
    let computed = checksum(file, found.summary_start, end)?;
    Ok(if computed == found.summary_crc {
        Ok(())
    } else {
        Err(format!(
            "summary from byte {}: checksum {computed:#010x}, expected {:#010x}; topics are read \
                from the chunks instead",
            found.summary_start, found.summary_crc
        ))
    })
}

/// CRC-32 of a range of the file.
fn checksum(file: &File, from: u64, until: u64) -> io::Result<u32> {
    let mut hasher = crc32fast::Hasher::new();
    let mut piece = vec![0u8; PIECE];
    let mut at = from;
    while at < until {
        let length = (until - at).min(PIECE as u64) as usize;
        file.read_exact_at(&mut piece[..length], at)?;
        hasher.update(&piece[..length]);
        at += length as u64;
    }
    Ok(hasher.finalize())
}

/// Reads the summary of a file that ends as it should, without looking at what is before it; `None`
/// where there is none, its checksum does not confirm it, or its chunks cannot be where it says.
pub(super) fn at_the_end(file: &File, bytes: u64) -> io::Result<Option<Whole>> {
    const FOOTER: usize = RECORD_HEAD as usize + FOOTER_BODY;
    let mut end = [0u8; FOOTER + mcap::MAGIC.len()];
    let Some(footer) = bytes.checked_sub(end.len() as u64) else { return Ok(None) };
    file.read_exact_at(&mut end, footer)?;
    let (record, magic) = end.split_at(FOOTER);
    let (head, body) = record.split_at(RECORD_HEAD as usize);
    let expected = (op::FOOTER, FOOTER_BODY as u64);
    if magic != mcap::MAGIC || (head[0], crate::word(head, 1)) != expected {
        return Ok(None);
    }
    let Ok(Record::Footer(found)) = mcap::parse_record(op::FOOTER, body) else { return Ok(None) };
    let begins = found.summary_start;
    if begins == 0 || found.summary_crc == 0 || verify(file, footer, body)?.is_err() {
        return Ok(None);
    }
    let mut reader = BufReader::with_capacity(PIECE, file.try_clone()?);
    reader.seek(SeekFrom::Start(begins))?;
    let mut summary = Summary::default();
    let (mut at, mut record) = (begins, Vec::<u8>::new());
    while at < footer {
        let mut head = [0u8; RECORD_HEAD as usize];
        let Some(left) = (footer - at).checked_sub(RECORD_HEAD) else { return Ok(None) };
        reader.read_exact(&mut head)?;
        let length = crate::word(&head, 1);
        if length > left.min(LONGEST_RECORD) {
            return Ok(None);
        }
        record.resize(length as usize, 0);
        reader.read_exact(&mut record)?;
        at += RECORD_HEAD + length;
        let wanted = [op::SCHEMA, op::CHANNEL, op::CHUNK_INDEX, op::STATISTICS];
        if !wanted.contains(&head[0]) {
            continue;
        }
        match mcap::parse_record(head[0], &record) {
            Ok(record) => summary.take(record),
            Err(_) => return Ok(None),
        }
    }
    summary.chunks.sort_by_key(|placed| placed.block.offset);
    let ends = summary.chunks.iter().map(|placed| placed.end);
    let behind = std::iter::once(mcap::MAGIC.len() as u64).chain(ends);
    let next = summary.chunks.iter().map(|placed| placed.block.offset).chain([begins]);
    let apart = behind.zip(next).all(|(end, next)| end <= next);
    Ok(apart.then_some(Whole { summary, begins }))
}

impl Summary {
    /// Takes a record of the summary.
    pub(super) fn take(&mut self, record: Record<'_>) {
        match record {
            Record::ChunkIndex(index) => self.chunk(index),
            Record::Statistics(found) => self.counts = Some(found.channel_message_counts),
            record => self.definitions.extend(Definition::of(record)),
        }
    }

    fn chunk(&mut self, index: ChunkIndex) {
        let mut block = Block::chunk(index.chunk_start_offset, index.chunk_length);
        block.times = Some((index.message_start_time, index.message_end_time));
        // a writer may leave the message indexes out: then nothing is known
        if !index.message_index_offsets.is_empty() {
            let channels: Vec<u16> = index.message_index_offsets.into_keys().collect();
            block.channels = Some(self.shared(channels));
        }
        let end = block.offset.saturating_add(block.length);
        let end = end.saturating_add(index.message_index_length);
        self.chunks.push(Placed { block, end });
    }

    /// A set of channels, in the memory of the first chunk that has it.
    fn shared(&mut self, channels: Vec<u16>) -> Arc<[u16]> {
        if let Some(known) = self.sets.get(channels.as_slice()) {
            return Arc::clone(known);
        }
        let channels: Arc<[u16]> = channels.into();
        self.sets.insert(Arc::clone(&channels));
        channels
    }

    /// Adds times and channels to each chunk; returns the chunks that are not where the summary
    /// says.
    pub(super) fn place(&mut self, blocks: &mut [Block]) -> Vec<Damage> {
        let mut at: BTreeMap<u64, Block> =
            self.chunks.drain(..).map(|placed| (placed.block.offset, placed.block)).collect();
        for block in blocks {
            let Some(placed) = at.remove(&block.offset) else { continue };
            (block.times, block.channels) = (placed.times, placed.channels);
        }
        at.into_keys()
            .map(|offset| Damage {
                offset,
                what: "the summary lists a chunk here, and there is none".to_owned(),
            })
            .collect()
    }
}

impl DataEnd {
    /// Verifies the checksum over the whole data section.
    pub(super) fn verify(&self, file: &File) -> io::Result<Option<Damage>> {
        if self.checksum == 0 {
            return Ok(None);
        }
        let computed = checksum(file, 0, self.offset)?;
        Ok((computed != self.checksum).then(|| Damage {
            offset: self.offset,
            what: format!(
                "checksum of all data {computed:#010x}, expected {:#010x}: a record outside the \
                    chunks, such as the start record with the rig file, was altered",
                self.checksum
            ),
        }))
    }
}
