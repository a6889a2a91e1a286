//! What the process loop and the writer thread exchange: messages through a bounded queue, commands
//! one way, outcomes the other, and counters that both read without waiting.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use ipc_types::{LossCounters, TOPICS};
use recording::mcap_write::Summary;
use rtrb::{Consumer, Producer, RingBuffer};

use crate::state::StartRequest;

/// Capacity of the queue (bytes): about four seconds of everything that a rig publishes at 2 kHz.
/// A disk that stalls longer costs data.
pub const BYTES: usize = 12 << 20;

/// Bytes that a message takes in the queue beyond its own: generation, topic, length.
pub const HEADER_BYTES: usize = 8;

/// What precedes a message in the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    /// The recording that it belongs to: messages of one never end up in the next.
    pub(crate) generation: u32,
    /// Index of the topic.
    pub(crate) topic: u16,
    /// Bytes of the message.
    length: u16,
}

impl Header {
    const fn to_bytes(self) -> [u8; HEADER_BYTES] {
        let [a, b, c, d] = self.generation.to_le_bytes();
        let ([e, f], [g, h]) = (self.topic.to_le_bytes(), self.length.to_le_bytes());
        [a, b, c, d, e, f, g, h]
    }

    const fn from_bytes(bytes: [u8; HEADER_BYTES]) -> Self {
        let [a, b, c, d, e, f, g, h] = bytes;
        Self {
            generation: u32::from_le_bytes([a, b, c, d]),
            topic: u16::from_le_bytes([e, f]),
            length: u16::from_le_bytes([g, h]),
        }
    }
}

/// Bytes of the longest message.
const LONGEST: usize = longest();

const fn longest() -> usize {
    let mut longest = 0;
    let mut index = 0;
    while index < TOPICS.len() {
        if TOPICS[index].size > longest {
            longest = TOPICS[index].size;
        }
        index += 1;
    }
    longest
}

/// A queue of so many bytes, of which a message takes its own and [`HEADER_BYTES`]. All memory is
/// allocated here: the sending side neither allocates nor waits.
pub(crate) fn queue(bytes: usize) -> (QueueSender, QueueReceiver) {
    let (producer, consumer) = RingBuffer::new(bytes);
    let taken = Arc::new(AtomicU64::new(0));
    let assembled = || vec![0; HEADER_BYTES + LONGEST].into_boxed_slice();
    let sender =
        QueueSender { ring: producer, assembled: assembled(), sent: 0, taken: Arc::clone(&taken) };
    (sender, QueueReceiver { ring: consumer, assembled: assembled(), taken })
}

/// The process loop's end.
#[derive(Debug)]
pub(crate) struct QueueSender {
    ring: Producer<u8>,
    /// A message behind its header: both enter the queue at once.
    assembled: Box<[u8]>,
    sent: u64,
    /// Messages that the other end has taken.
    taken: Arc<AtomicU64>,
}

impl QueueSender {
    /// Adds a message behind the others; `false` where there is no room, or where it is longer than
    /// any message of this build.
    pub(crate) fn push(&mut self, generation: u32, topic: u16, message: &[u8]) -> bool {
        let Ok(length) = u16::try_from(message.len()) else { return false };
        let Some(entry) = self.assembled.get_mut(..HEADER_BYTES + message.len()) else {
            return false;
        };
        let (header, body) = entry.split_at_mut(HEADER_BYTES);
        header.copy_from_slice(&Header { generation, topic, length }.to_bytes());
        body.copy_from_slice(message);
        let found_room = self.ring.push_entire_slice(entry).is_ok();
        self.sent += u64::from(found_room);
        found_room
    }

    /// Messages that wait in the queue.
    pub(crate) fn len(&self) -> u64 {
        self.sent.saturating_sub(self.taken.load(Ordering::Relaxed))
    }
}

/// The writer thread's end.
#[derive(Debug)]
pub(crate) struct QueueReceiver {
    ring: Consumer<u8>,
    assembled: Box<[u8]>,
    taken: Arc<AtomicU64>,
}

impl QueueReceiver {
    /// What precedes the next message, which stays in the queue.
    pub(crate) fn next_header(&mut self) -> Option<Header> {
        let entry = self.ring.read_chunk(HEADER_BYTES).ok()?;
        let (first, second) = entry.as_slices();
        let mut bytes = [0; HEADER_BYTES];
        for (place, byte) in bytes.iter_mut().zip(first.iter().chain(second)) {
            *place = *byte;
        }
        Some(Header::from_bytes(bytes))
    }

    /// Takes the next message.
    pub(crate) fn pop(&mut self) -> Option<(Header, &[u8])> {
        let header = self.next_header()?;
        let entry = self.assembled.get_mut(..HEADER_BYTES + usize::from(header.length))?;
        self.ring.pop_entire_slice(entry).ok()?;
        self.taken.fetch_add(1, Ordering::Relaxed);
        Some((header, entry.get(HEADER_BYTES..)?))
    }
}

/// What the writer thread is told.
#[derive(Debug)]
pub(crate) enum Command {
    Start {
        generation: u32,
        request: StartRequest,
    },
    NoteRun {
        run: BTreeMap<String, String>,
    },
    /// The messages of this generation belong to the next part.
    Split(NextPart),
    Stop {
        losses: Vec<LossCounters>,
    },
    Quit {
        losses: Vec<LossCounters>,
    },
}

/// How the next part of a recording begins.
#[derive(Debug)]
pub(crate) struct NextPart {
    /// That of its messages.
    pub(crate) generation: u32,
    /// When it begins [ns, CLOCK_MONOTONIC].
    pub(crate) at_ns: u64,
    /// Metadata that are others by now.
    pub(crate) metadata: BTreeMap<String, String>,
    /// Counters of the recording up to there.
    pub(crate) losses: Vec<LossCounters>,
}

/// The parts of a ring.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RingParts {
    /// Numbers of those that are there, the present one last; empty where it is no ring.
    pub numbers: Vec<u32>,
    /// Size of those that have ended (bytes).
    pub bytes: u64,
    /// Parts that were removed.
    pub removed: u64,
    /// Parts that could not be removed.
    pub not_removed: u64,
}

/// What the writer thread reports.
#[derive(Debug)]
pub enum Outcome {
    /// The file exists and takes data.
    Started {
        /// The file (its part number may be higher than requested).
        path: PathBuf,
        /// Of a ring, its parts.
        ring: RingParts,
    },
    /// The recording goes on in its next part.
    NextPart {
        /// The file.
        path: PathBuf,
        /// The part before; why it is not whole, if so.
        ended: Result<Summary, String>,
        /// Of a ring, its parts.
        ring: RingParts,
    },
    /// The next part could not be begun; the recording goes on in the same one, unless that had
    /// failed before.
    NotSplit {
        /// Why.
        error: String,
        /// Of a ring, its parts.
        ring: RingParts,
    },
    /// The file could not be created; nothing is being recorded.
    NotStarted {
        /// Why.
        error: String,
    },
    /// The disk failed during a recording. The recording stays open, refusing and counting
    /// messages, until it is stopped.
    Failed {
        /// Why.
        error: String,
    },
    /// The recording ended cleanly; everything is on the disk.
    Stopped(Summary),
    /// The recording was stopped, but not cleanly; what was flushed is on the disk.
    StoppedWithError {
        /// Why.
        error: String,
        /// Messages that are not in the file.
        refused: u64,
    },
    /// The recording continues, but its state could not be saved.
    StateNotKept {
        /// Why.
        error: String,
    },
}

/// Counters that the writer thread updates and the loop reads; neither side waits.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) now_ns: AtomicU64,
    /// The recording whose counters these are: those of the one before go on until the thread
    /// begins the next, while the loop already asks for its own.
    pub(crate) generation: AtomicU32,
    /// Of all parts.
    pub(crate) written: Vec<AtomicU64>,
    pub(crate) refused: Vec<AtomicU64>,
    /// Size of the present part (bytes).
    pub(crate) part_bytes: AtomicU64,
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_message_takes_its_own_bytes_and_those_of_its_header() {
        let (mut sender, mut receiver) = queue(3 * (HEADER_BYTES + 10));
        for _ in 0..3 {
            assert!(sender.push(1, 2, &[7; 10]));
        }
        assert!(!sender.push(1, 2, &[]));
        assert_eq!(sender.len(), 3);
        let (header, message) = receiver.pop().unwrap();
        assert_eq!((header.generation, header.topic, message), (1, 2, &[7; 10][..]));
        assert!(!sender.push(1, 2, &[7; 11]));
        assert!(sender.push(1, 2, &[7; 10]));
        assert_eq!(sender.len(), 3);
    }

    #[test]
    fn a_message_longer_than_any_of_this_build_is_refused() {
        let (mut sender, mut receiver) = queue(BYTES);
        assert!(!sender.push(1, 2, &[0; LONGEST + 1]));
        assert!(sender.push(1, 2, &[5; LONGEST]));
        assert_eq!(receiver.pop().unwrap().1, [5; LONGEST]);
        assert!(receiver.pop().is_none());
    }

    proptest! {
        /// What found room comes out whole and in order, wherever the ring's end cuts it.
        #[test]
        fn what_found_room_comes_out_in_order(
            entries in prop::collection::vec((any::<u32>(), any::<u16>(), 0_usize..60), 1..200),
            bytes in 1_usize..400,
            turns in prop::collection::vec(any::<bool>(), 1..400),
        ) {
            let (mut sender, mut receiver) = queue(bytes);
            let mut waiting = std::collections::VecDeque::new();
            let mut entries = entries.into_iter().enumerate();
            for push in turns {
                if push {
                    let Some((number, (generation, topic, length))) = entries.next() else { break };
                    let message = vec![number as u8; length];
                    let held: usize =
                        waiting.iter().map(|(_, _, m): &(u32, u16, Vec<u8>)| m.len() + HEADER_BYTES)
                            .sum();
                    let fits = held + length + HEADER_BYTES <= bytes;
                    prop_assert_eq!(sender.push(generation, topic, &message), fits);
                    if fits {
                        waiting.push_back((generation, topic, message));
                    }
                } else {
                    let next = receiver.next_header();
                    prop_assert_eq!(next.map(|header| header.topic), waiting.front().map(|m| m.1));
                    let popped = receiver.pop().map(|(header, message)| {
                        (header.generation, header.topic, message.to_vec())
                    });
                    prop_assert_eq!(popped, waiting.pop_front());
                }
                prop_assert_eq!(sender.len(), waiting.len() as u64);
            }
        }
    }
}
