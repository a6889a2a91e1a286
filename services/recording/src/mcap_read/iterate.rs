//! Iterators over messages, raw and typed.

use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::sync::Arc;

use ipc_types::Message;

use super::block::{Block, Loaded};
use super::{RawMessage, ReadError, Recording};
use crate::schema::Conversion;

/// Which messages to read.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Only these channels.
    pub channels: Option<Vec<u16>>,
    /// Only messages with at least this log time (ns).
    pub from_ns: Option<u64>,
    /// Only messages with a log time before this (ns).
    pub until_ns: Option<u64>,
}

impl Selection {
    pub(super) fn wants_block(&self, block: &Block) -> bool {
        let channels = match (&self.channels, &block.channels) {
            (Some(wanted), Some(there)) => there.iter().any(|id| wanted.contains(id)),
            _ => true,
        };
        let times = match block.times {
            // a chunk without messages says 0, 0
            Some((first, last)) if (first, last) != (0, 0) => {
                self.from_ns.is_none_or(|from| last >= from)
                    && self.until_ns.is_none_or(|until| first < until)
            }
            _ => true,
        };
        channels && times
    }

    pub(super) fn wants(&self, head: &super::block::Head) -> bool {
        self.channels.as_ref().is_none_or(|wanted| wanted.contains(&head.header.channel_id))
            && self.from_ns.is_none_or(|from| head.header.log_time >= from)
            && self.until_ns.is_none_or(|until| head.header.log_time < until)
    }
}

/// Messages in the order in which they were written. A damaged chunk yields one error; the next
/// call continues after it.
#[derive(Debug)]
pub struct RawMessages<'a> {
    recording: &'a Recording,
    selection: Selection,
    next_block: usize,
    block: Arc<Loaded>,
    next_message: usize,
    buffer: Vec<u8>,
}

impl Recording {
    /// Messages in the order of the file, not decoded.
    pub fn raw(&self, selection: Selection) -> RawMessages<'_> {
        RawMessages {
            recording: self,
            selection,
            next_block: 0,
            block: Arc::default(),
            next_message: 0,
            buffer: Vec::new(),
        }
    }

    /// Reads one block, the messages that `selection` wants; `buffer` is scratch memory.
    pub(super) fn messages_of(
        &self,
        block: &Block,
        selection: &Selection,
        buffer: &mut Vec<u8>,
    ) -> Result<Vec<RawMessage>, ReadError> {
        let block = Arc::new(self.load(block, buffer)?);
        let wanted = block.heads.iter().filter(|head| selection.wants(head));
        Ok(wanted.map(|&head| RawMessage { block: Arc::clone(&block), head }).collect())
    }

    /// The messages of one topic as this build's `T`; fields that the recording lacks are zero.
    ///
    /// # Errors
    /// [`ReadError::NoTopic`], [`ReadError::Schema`]. The iterator yields [`ReadError::Damaged`]
    /// once per damaged chunk.
    pub fn messages<T: Message>(&self, topic: &str) -> Result<Messages<'_, T>, ReadError> {
        let ids = self.channels_of(topic)?;
        let conversions = self.conversions::<T>(&ids)?;
        let raw = self.raw(Selection { channels: Some(ids), ..Selection::default() });
        Ok(Messages { raw, conversions, message: PhantomData })
    }

    /// How the messages of each channel are read into this build's `T`.
    pub(super) fn conversions<T: Message>(
        &self,
        ids: &[u16],
    ) -> Result<BTreeMap<u16, Conversion>, ReadError> {
        let mut conversions = BTreeMap::new();
        for id in ids {
            let Some(channel) = self.channels.get(id) else { continue };
            conversions.insert(*id, self.layout_of(channel)?.conversion::<T>());
        }
        Ok(conversions)
    }

    /// A message as this build's `T`; `None` where its channel has no conversion.
    pub(super) fn converted<T: Message>(
        &self,
        conversions: &BTreeMap<u16, Conversion>,
        raw: &RawMessage,
    ) -> Option<Result<Recorded<T>, ReadError>> {
        let conversion = conversions.get(&raw.channel_id())?;
        let body = match self.decode(raw) {
            Ok((_, body)) => body,
            Err(error) => return Some(Err(error)),
        };
        let message = conversion.apply(body)?;
        Some(Ok(Recorded { log_time_ns: raw.log_time_ns(), message }))
    }

    /// The messages of one topic with a log time before `until_ns` (ns), the last of the file
    /// first, as this build's `T`; none where the recording does not have the topic. Whoever wants
    /// the newest ones reads the last chunks alone.
    ///
    /// # Errors
    /// [`ReadError::Schema`]. The iterator yields [`ReadError::Damaged`] once per damaged chunk.
    pub fn backward<T: Message>(
        &self,
        topic: &str,
        until_ns: Option<u64>,
    ) -> Result<impl Iterator<Item = Result<Recorded<T>, ReadError>>, ReadError> {
        let ids = match self.channels_of(topic) {
            Ok(ids) => ids,
            Err(ReadError::NoTopic { .. }) => Vec::new(),
            Err(error) => return Err(error),
        };
        let conversions = self.conversions::<T>(&ids)?;
        let there = !ids.is_empty();
        let selection = Selection { channels: Some(ids), from_ns: None, until_ns };
        let wanted = |block: &&Block| there && selection.wants_block(block);
        let blocks: Vec<&Block> = self.blocks.iter().filter(wanted).collect();
        let mut buffer = Vec::new();
        let messages = blocks.into_iter().rev().flat_map(move |block| {
            let (messages, error) = match self.messages_of(block, &selection, &mut buffer) {
                Ok(messages) => (messages, None),
                Err(error) => (Vec::new(), Some(error)),
            };
            messages.into_iter().rev().map(Ok).chain(error.map(Err))
        });
        Ok(messages.filter_map(move |raw| match raw {
            Ok(raw) => self.converted::<T>(&conversions, &raw),
            Err(error) => Some(Err(error)),
        }))
    }

    /// As [`Recording::messages`]; none where the recording does not have the topic.
    ///
    /// # Errors
    /// [`ReadError::Schema`].
    pub fn messages_if_any<T: Message>(
        &self,
        topic: &str,
    ) -> Result<impl Iterator<Item = Result<Recorded<T>, ReadError>>, ReadError> {
        match self.messages::<T>(topic) {
            Ok(messages) => Ok(Some(messages)),
            Err(ReadError::NoTopic { .. }) => Ok(None),
            Err(error) => Err(error),
        }
        .map(|messages| messages.into_iter().flatten())
    }
}

impl Iterator for RawMessages<'_> {
    type Item = Result<RawMessage, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            while let Some(&head) = self.block.heads.get(self.next_message) {
                self.next_message += 1;
                if self.selection.wants(&head) {
                    return Some(Ok(RawMessage { block: Arc::clone(&self.block), head }));
                }
            }
            let block = self.recording.blocks.get(self.next_block)?;
            self.next_block += 1;
            if !self.selection.wants_block(block) {
                continue;
            }
            self.next_message = 0;
            self.block = Arc::default();
            match self.recording.load(block, &mut self.buffer) {
                Ok(loaded) => self.block = Arc::new(loaded),
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

/// One message and when it was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recorded<T> {
    /// By the wall clock of the recording (ns since 1970).
    pub log_time_ns: u64,
    /// The message.
    pub message: T,
}

/// The messages of one topic.
#[derive(Debug)]
pub struct Messages<'a, T> {
    raw: RawMessages<'a>,
    conversions: BTreeMap<u16, Conversion>,
    message: PhantomData<fn() -> T>,
}

impl<T: Message> Iterator for Messages<'_, T> {
    type Item = Result<Recorded<T>, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let raw = match self.raw.next()? {
                Ok(raw) => raw,
                Err(error) => return Some(Err(error)),
            };
            if let Some(message) = self.raw.recording.converted(&self.conversions, &raw) {
                return Some(message);
            }
        }
    }
}
