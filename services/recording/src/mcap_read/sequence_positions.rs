//! Where the topics of a recording stand in their senders' sequences at its end: what the next part
//! continues from.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::{RawMessage, ReadError, Recording};
use crate::mcap_write::{CONTINUES_RECORD, Position, Positions, parse_continues};

impl Recording {
    /// Where the part before this one ended; empty for part 1.
    pub fn continues(&self) -> Positions {
        self.record(CONTINUES_RECORD).map(parse_continues).unwrap_or_default()
    }

    /// Where this recording ends. Loads only the last chunk of each topic, so that it is quick on
    /// hours of recording. Damaged chunks are passed over.
    ///
    /// # Errors
    /// [`ReadError::Io`].
    pub fn end_positions(&self) -> Result<Positions, ReadError> {
        let mut positions = self.continues();
        let mut wanted: BTreeSet<u16> = self.channels.keys().copied().collect();
        let mut buffer = Vec::new();
        for block in self.blocks.iter().rev() {
            // The message indexes have no checksum, but what a killed logger leaves is torn, not
            // altered.
            if let Some(there) = block.channels_or_hint()
                && !there.iter().any(|id| wanted.contains(id))
            {
                continue;
            }
            let loaded = match self.load(block, &mut buffer) {
                Ok(loaded) => Arc::new(loaded),
                Err(error @ ReadError::Io { .. }) => return Err(error),
                Err(_) => continue,
            };
            for &head in loaded.heads.iter().rev() {
                if !wanted.remove(&head.header.channel_id) {
                    continue;
                }
                let message = RawMessage { block: Arc::clone(&loaded), head };
                if let (Some(channel), Some(position)) =
                    (self.channel(&message), self.position_after(&message))
                {
                    positions.insert(channel.topic.clone(), position);
                }
            }
        }
        Ok(positions)
    }

    fn position_after(&self, message: &RawMessage) -> Option<Position> {
        let (layout, body) = self.decode(message).ok()?;
        let incarnation = layout.unsigned("incarnation", body)?;
        let sequence = layout.unsigned("sequence", body)?;
        Some(Position { incarnation, next: sequence.saturating_add(1) })
    }
}
