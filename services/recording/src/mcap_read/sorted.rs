//! Messages in the order of log time, however they were written.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::sync::Arc;

use super::{RawMessage, ReadError, Recording, Selection};

/// Messages in the order of log time; equal times in the order of the file. A damaged chunk yields
/// one error; the next call continues after it.
///
/// Chunks are loaded when the time reaches their first message, so that memory holds only those
/// that overlap.
#[derive(Debug)]
pub struct Sorted<'a> {
    recording: &'a Recording,
    selection: Selection,
    /// time of the first message and index of each block still to be loaded, the earliest last
    blocks: Vec<(u64, usize)>,
    loaded: BinaryHeap<Reverse<Entry>>,
    buffer: Vec<u8>,
}

/// A message, ordered by time and place in the file.
#[derive(Debug)]
struct Entry {
    key: (u64, usize, usize),
    message: RawMessage,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.key == other.key
    }
}
impl Eq for Entry {}
impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.key.cmp(&other.key)
    }
}

impl Recording {
    /// Messages in the order of log time. A file without a summary is read once more to find the
    /// times of its chunks.
    pub fn sorted(&self, selection: Selection) -> Sorted<'_> {
        let mut buffer = Vec::new();
        let mut blocks: Vec<(u64, usize)> = Vec::new();
        for (index, block) in self.blocks.iter().enumerate() {
            if !selection.wants_block(block) {
                continue;
            }
            let first_ns = match block.times {
                Some((first, _)) => Some(first),
                None => match self.load(block, &mut buffer) {
                    Ok(loaded) => loaded.heads.iter().map(|head| head.log_time_ns).min(),
                    // Comes first, to yield its error.
                    Err(_) => Some(0),
                },
            };
            let Some(first_ns) = first_ns else { continue };
            blocks.push((first_ns, index));
        }
        blocks.sort_unstable_by(|a, b| b.cmp(a));
        Sorted { recording: self, selection, blocks, loaded: BinaryHeap::new(), buffer }
    }
}

impl Sorted<'_> {
    fn load(&mut self, index: usize) -> Result<(), ReadError> {
        let Some(block) = self.recording.blocks.get(index) else { return Ok(()) };
        let block = Arc::new(self.recording.load(block, &mut self.buffer)?);
        for (at, &head) in block.heads.iter().enumerate() {
            if self.selection.wants(&head) {
                let message = RawMessage { block: Arc::clone(&block), head };
                self.loaded.push(Reverse(Entry { key: (head.log_time_ns, index, at), message }));
            }
        }
        Ok(())
    }
}

impl Iterator for Sorted<'_> {
    type Item = Result<RawMessage, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        while let Some(&(first_ns, index)) = self.blocks.last() {
            if self.loaded.peek().is_some_and(|Reverse(entry)| entry.key.0 < first_ns) {
                break;
            }
            self.blocks.pop();
            if let Err(error) = self.load(index) {
                return Some(Err(error));
            }
        }
        self.loaded.pop().map(|Reverse(entry)| Ok(entry.message))
    }
}
