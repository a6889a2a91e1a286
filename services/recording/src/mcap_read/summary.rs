//! The summary at the end of a file, and its checksum.
//!
//! Each chunk has a checksum, the records around them have none: one flipped bit in the summary
//! exchanges two topics, one in a message index hides a chunk from readers of that topic. So the
//! summary is used only where the checksum in the footer confirms it; otherwise, and in a torn
//! file, definitions come from the chunks and every chunk is read.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

use mcap::records::{ChunkIndex, Record, op};

use super::Damage;
use super::block::{Block, Definition, RECORD_HEAD};

/// Body of a footer: start of the summary, start of its offsets, checksum (bytes).
pub(super) const FOOTER_BODY: usize = 8 + 8 + 4;
/// Length of the checksum, which does not cover itself (bytes).
const CHECKSUM: u64 = 4;
/// Read at a time (bytes).
const PIECE: usize = 256 << 10;

/// Definitions and chunk indexes of the summary.
#[derive(Debug, Default)]
pub(super) struct Summary {
    pub(super) definitions: Vec<Definition>,
    pub(super) chunks: Vec<ChunkIndex>,
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

impl Summary {
    /// Adds times and channels to each chunk; returns the chunks that are not where the summary
    /// says.
    pub(super) fn place(&mut self, blocks: &mut [Block]) -> Vec<Damage> {
        let mut at: BTreeMap<u64, ChunkIndex> =
            self.chunks.drain(..).map(|index| (index.chunk_start_offset, index)).collect();
        for block in blocks {
            let Some(index) = at.remove(&block.offset) else { continue };
            block.times = Some((index.message_start_time, index.message_end_time));
            // a writer may leave the message indexes out: then nothing is known
            block.channels = (!index.message_index_offsets.is_empty())
                .then(|| index.message_index_offsets.into_keys().collect());
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
