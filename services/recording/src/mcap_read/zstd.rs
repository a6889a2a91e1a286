//! Chunks compressed by zstd, which other programs write.

use std::io::Read;

use mcap::sans_io::decompressor::{DecompressResult, Decompressor};
use mcap::{McapError, McapResult};
use ruzstd::decoding::StreamingDecoder;

/// Decompresses a whole chunk at the first call, since the library needs whole blocks.
#[derive(Debug, Default)]
pub(super) struct Zstd {
    /// most bytes that a chunk may hold
    limit: usize,
    decoded: Vec<u8>,
    given: usize,
}

impl Zstd {
    pub(super) fn new(limit: usize) -> Self {
        Self { limit, ..Self::default() }
    }
}

impl Decompressor for Zstd {
    fn next_read_size(&self) -> usize {
        usize::MAX
    }

    fn decompress(&mut self, mut source: &[u8], target: &mut [u8]) -> McapResult<DecompressResult> {
        let consumed = source.len();
        while !source.is_empty() {
            let room = self.limit.saturating_sub(self.decoded.len()) as u64;
            StreamingDecoder::new(&mut source)
                .map_err(|error| McapError::DecompressionError(error.to_string()))?
                .take(room)
                .read_to_end(&mut self.decoded)?;
        }
        let left = self.decoded.get(self.given..).unwrap_or_default();
        let wrote = left.len().min(target.len());
        target[..wrote].copy_from_slice(&left[..wrote]);
        self.given += wrote;
        Ok(DecompressResult { consumed, wrote })
    }

    fn reset(&mut self) -> McapResult<()> {
        self.decoded.clear();
        self.given = 0;
        Ok(())
    }

    fn name(&self) -> &'static str {
        "zstd"
    }
}
