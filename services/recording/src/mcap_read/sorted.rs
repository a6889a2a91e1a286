//! Messages in the order of log time, however they were written.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::iter::Peekable;
use std::vec::IntoIter;

use super::in_order::in_order;
use super::{RawMessage, ReadError, Recording, Selection, threads};

/// A chunk of one of several recordings; ordered by the time of its first message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Next {
    first_ns: u64,
    source: usize,
    block: usize,
}

/// Reads the messages of several recordings on all processors and hands them to `take` in the order
/// of log time, each with the place of its recording: equal times in the order of the recordings,
/// and of each file. A damaged chunk comes as one error. A file without a summary is read once more
/// to find the times of its chunks.
///
/// Memory holds the chunks that overlap in time, and a few for each processor.
///
/// # Errors
/// Those of `take`, at the first of which it ends.
pub fn in_order_of_time<E>(
    sources: &[&Recording],
    selection: &Selection,
    mut take: impl FnMut(usize, Result<RawMessage, ReadError>) -> Result<(), E>,
) -> Result<(), E> {
    let mut order: Vec<Next> = Vec::new();
    for (at, source) in sources.iter().enumerate() {
        order.extend(source.first_times(at, selection));
    }
    order.sort_unstable();
    let work = |at: usize, buffer: &mut Vec<u8>| {
        let next = order[at];
        (next, sources[next.source].sorted_messages_of(next.block, selection, buffer))
    };
    let mut loaded = Loaded::default();
    in_order(threads(), order.len(), work, |(next, messages)| {
        // No message of this chunk, nor of those that follow, comes before its first one.
        loaded.take_until(Some(next.first_ns), &mut take)?;
        match messages {
            Ok(messages) => loaded.keep(next.source, next.block, messages),
            Err(error) => take(next.source, Err(error))?,
        }
        Ok(())
    })?;
    loaded.take_until(None, &mut take)
}

/// Messages of one recording in the order of log time, for who takes one at a time: see
/// [`Recording::sorted`].
#[derive(Debug)]
pub struct Sorted<'a> {
    recording: &'a Recording,
    selection: Selection,
    order: Peekable<IntoIter<Next>>,
    loaded: Loaded,
    scratch: Vec<u8>,
}

impl Iterator for Sorted<'_> {
    type Item = Result<RawMessage, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let first_ns = self.loaded.first_ns();
            let due = |next: &Next| first_ns.is_none_or(|first_ns| next.first_ns <= first_ns);
            let Some(next) = self.order.next_if(due) else { return self.loaded.pop().map(Ok) };
            let messages =
                self.recording.sorted_messages_of(next.block, &self.selection, &mut self.scratch);
            match messages {
                Ok(messages) => self.loaded.keep(next.source, next.block, messages),
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

/// What is left of each chunk that was read, in the order of time, by the time of the first message
/// left, the recording and the chunk.
#[derive(Debug, Default)]
struct Loaded(BTreeMap<(u64, usize, usize), IntoIter<RawMessage>>);

impl Loaded {
    fn keep(&mut self, source: usize, block: usize, messages: IntoIter<RawMessage>) {
        if let Some(first) = messages.as_slice().first() {
            self.0.insert((first.log_time_ns(), source, block), messages);
        }
    }

    /// Time of the first message that is left (ns).
    fn first_ns(&self) -> Option<u64> {
        self.0.first_key_value().map(|((first_ns, _, _), _)| *first_ns)
    }

    /// Takes the first message that is left.
    fn pop(&mut self) -> Option<RawMessage> {
        let ((_, source, block), mut messages) = self.0.pop_first()?;
        let first = messages.next();
        self.keep(source, block, messages);
        first
    }

    /// Hands on all messages before a time (ns), or all.
    fn take_until<E>(
        &mut self,
        until_ns: Option<u64>,
        take: &mut impl FnMut(usize, Result<RawMessage, ReadError>) -> Result<(), E>,
    ) -> Result<(), E> {
        while let Some(entry) = self.0.first_entry() {
            let (time_ns, source, block) = *entry.key();
            if until_ns.is_some_and(|until_ns| time_ns >= until_ns) {
                break;
            }
            let mut messages = entry.remove();
            let rival = self.0.first_key_value().map(|(key, _)| *key);
            while let Some(message) = messages.next() {
                take(source, Ok(message))?;
                let Some(next) = messages.as_slice().first() else { break };
                let next = (next.log_time_ns(), source, block);
                if rival.is_some_and(|rival| rival < next)
                    || until_ns.is_some_and(|until_ns| next.0 >= until_ns)
                {
                    break;
                }
            }
            self.keep(source, block, messages);
        }
        Ok(())
    }
}

impl Recording {
    /// The messages in the order of log time, read as they are asked for, each chunk when its time
    /// has come. A damaged chunk yields one error. [`in_order_of_time`] is faster, and hands all of
    /// them on.
    pub fn sorted(&self, selection: Selection) -> Sorted<'_> {
        let mut order = self.first_times(0, &selection);
        order.sort_unstable();
        Sorted {
            recording: self,
            selection,
            order: order.into_iter().peekable(),
            loaded: Loaded::default(),
            scratch: Vec::new(),
        }
    }

    /// The messages of a chunk, in the order of log time.
    fn sorted_messages_of(
        &self,
        block: usize,
        selection: &Selection,
        buffer: &mut Vec<u8>,
    ) -> Result<IntoIter<RawMessage>, ReadError> {
        let mut messages = self.messages_of(&self.blocks[block], selection, buffer)?;
        messages.sort_by_key(RawMessage::log_time_ns);
        Ok(messages.into_iter())
    }

    /// The chunks with what is selected, and the time of the first message of each.
    fn first_times(&self, source: usize, selection: &Selection) -> Vec<Next> {
        let wanted = |at: &usize| selection.wants_block(&self.blocks[*at]);
        let wanted: Vec<usize> = (0..self.blocks.len()).filter(wanted).collect();
        let first = |at: usize, buffer: &mut Vec<u8>| {
            let index = wanted[at];
            let block = &self.blocks[index];
            let first_ns = match block.times {
                Some((first, _)) => Some(first),
                None => match self.load(block, buffer) {
                    Ok(loaded) => loaded.heads.iter().map(|head| head.header.log_time).min(),
                    // Comes first, to yield its error.
                    Err(_) => Some(0),
                },
            };
            Some(Next { first_ns: first_ns?, source, block: index })
        };
        let mut found: Vec<Next> = Vec::with_capacity(wanted.len());
        let Ok(()) = in_order(threads(), wanted.len(), first, |first| {
            found.extend(first);
            Ok::<(), Infallible>(())
        });
        found
    }
}
