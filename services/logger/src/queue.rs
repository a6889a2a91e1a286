//! The bounded hand-over from the loop that drains shared memory to the thread that writes the
//! disk. All memory is there from the start: the draining side allocates nothing and never waits.

use crossbeam_queue::ArrayQueue;
use ipc_types::TOPICS;

/// Bytes of the longest message.
pub const SLOT_BYTES: usize = longest();

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
pub struct Slot {
    /// Which recording it belongs to: messages of one never end up in the next.
    pub generation: u32,
    /// Index of the topic.
    pub topic: u16,
    length: u16,
    bytes: [u8; SLOT_BYTES],
}

impl Slot {
    /// A copy of a message; `None` if it is longer than any message of this build.
    pub fn new(generation: u32, topic: u16, message: &[u8]) -> Option<Self> {
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
    pub fn message(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or_default()
    }
}

/// The queue.
pub type Queue = ArrayQueue<Slot>;

/// Slots for about four seconds of everything that a rig publishes at 2 kHz: a disk that stalls
/// longer costs data.
pub const SLOTS: usize = 40_000;
