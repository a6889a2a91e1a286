//! What the process loop and the writer thread exchange: messages through a bounded queue, commands
//! one way, outcomes the other, and counters that both read without waiting.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, AtomicU64};

use crossbeam_queue::ArrayQueue;
use ipc_types::{LossCounters, TOPICS};
use recording::mcap_write::Summary;

use crate::state::StartRequest;

/// Bytes of the longest message.
const SLOT_BYTES: usize = longest();

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

/// One message on its way to the disk.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slot {
    /// The recording that it belongs to: messages of one never end up in the next.
    pub(crate) generation: u32,
    /// Index of the topic.
    pub(crate) topic: u16,
    length: u16,
    bytes: [u8; SLOT_BYTES],
}

impl Slot {
    /// A copy of a message; `None` if it is longer than any message of this build.
    pub(crate) fn new(generation: u32, topic: u16, message: &[u8]) -> Option<Self> {
        let mut slot = Self {
            generation,
            topic,
            length: u16::try_from(message.len()).ok()?,
            bytes: [0; SLOT_BYTES],
        };
        slot.bytes.get_mut(..message.len())?.copy_from_slice(message);
        Some(slot)
    }

    /// The message.
    pub(crate) fn message(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or_default()
    }
}

/// The bounded queue. All memory is allocated at the start: the sending side neither allocates nor
/// waits.
pub(crate) type Queue = ArrayQueue<Slot>;

/// Capacity of the queue: about four seconds of everything that a rig publishes at 2 kHz. A disk
/// that stalls longer costs data.
pub const SLOTS: usize = 40_000;

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
    /// The next part could not be begun; the recording goes on in the same one.
    NotSplit {
        /// Why.
        error: String,
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
