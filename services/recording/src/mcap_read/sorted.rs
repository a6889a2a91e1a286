//! Messages in the order of log time, however they were written.

use std::collections::BTreeMap;
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
    /// messages by time, block and place in it
    loaded: BTreeMap<(u64, usize, usize), RawMessage>,
    buffer: Vec<u8>,
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
                    Ok(loaded) => loaded.heads.iter().map(|head| head.header.log_time).min(),
                    // Comes first, to yield its error.
                    Err(_) => Some(0),
                },
            };
            let Some(first_ns) = first_ns else { continue };
            blocks.push((first_ns, index));
        }
        blocks.sort_unstable_by(|a, b| b.cmp(a));
        Sorted { recording: self, selection, blocks, loaded: BTreeMap::new(), buffer }
    }
}

impl Sorted<'_> {
    fn load(&mut self, index: usize) -> Result<(), ReadError> {
        let Some(block) = self.recording.blocks.get(index) else { return Ok(()) };
        let block = Arc::new(self.recording.load(block, &mut self.buffer)?);
        for (at, &head) in block.heads.iter().enumerate() {
            if self.selection.wants(&head) {
                let message = RawMessage { block: Arc::clone(&block), head };
                self.loaded.insert((head.header.log_time, index, at), message);
            }
        }
        Ok(())
    }
}

impl Iterator for Sorted<'_> {
    type Item = Result<RawMessage, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        while let Some(&(first_ns, index)) = self.blocks.last() {
            if self.loaded.first_key_value().is_some_and(|((time_ns, ..), _)| *time_ns < first_ns) {
                break;
            }
            self.blocks.pop();
            if let Err(error) = self.load(index) {
                return Some(Err(error));
            }
        }
        self.loaded.pop_first().map(|(_, message)| Ok(message))
    }
}
