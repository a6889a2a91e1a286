//! What the process loop and the writer thread exchange: messages through a bounded queue, commands
//! one way, outcomes the other, and counters that both read without waiting.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::AtomicU64;

use crossbeam_queue::ArrayQueue;
use ipc_types::{LossCounters, TOPICS};
use recording::mcap_write::{Positions, Summary};

use crate::state::State;

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
pub(crate) const SLOTS: usize = 40_000;

/// What to record.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StartRequest {
    /// The file of part 1, also for later parts.
    pub path: PathBuf,
    /// 1, or higher when continuing after a restart; the next free number is taken.
    pub part: u32,
    /// Metadata of the recording, see [`recording::mcap_write::key`].
    pub metadata: BTreeMap<String, String>,
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC` (ns).
    pub realtime_offset_ns: i64,
    /// Session of the rig.
    pub session: u64,
    /// When part 1 began [ns, CLOCK_MONOTONIC]; 0 for a recording that begins now.
    pub began_ns: u64,
    /// Where the part before ended; empty for part 1. The messages between are counted as lost.
    pub continues: Positions,
    /// The protocol that is being played; empty where none is.
    pub run: BTreeMap<String, String>,
}

impl StartRequest {
    /// The next part of a recording that was cut off when the logger died. `continues` is where the
    /// part before ended.
    pub fn next_part(state: State, continues: Positions) -> Self {
        Self {
            path: state.path,
            part: state.part + 1,
            metadata: state.metadata,
            realtime_offset_ns: state.realtime_offset_ns,
            session: state.session,
            run: state.run,
            began_ns: state.began_ns,
            continues,
        }
    }
}

/// What the writer thread is told.
#[derive(Debug)]
pub(crate) enum Command {
    Start { generation: u32, request: StartRequest },
    NoteRun { run: BTreeMap<String, String> },
    Stop { losses: Vec<LossCounters> },
    Quit { losses: Vec<LossCounters> },
}

/// What the writer thread reports.
#[derive(Debug)]
pub enum Outcome {
    /// The file exists and takes data.
    Started {
        /// The file (its part number may be higher than requested).
        path: PathBuf,
    },
    /// The file could not be created; nothing is being recorded.
    NotStarted {
        /// The file requested.
        path: PathBuf,
        /// Why.
        error: String,
    },
    /// The disk failed during a recording. The recording stays open, refusing and counting
    /// messages, until it is stopped.
    Failed {
        /// The file.
        path: PathBuf,
        /// Why.
        error: String,
    },
    /// The recording ended cleanly; everything is on the disk.
    Stopped(Summary),
    /// The recording was stopped, but not cleanly; what was flushed is on the disk.
    StoppedWithError {
        /// The file.
        path: PathBuf,
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
    pub(crate) written: Vec<AtomicU64>,
    pub(crate) refused: Vec<AtomicU64>,
}
