//! Communication between the real-time loop and the request thread. Neither waits for the other:
//! changes, orders and events pass through single-producer, single-consumer rings, which are
//! wait-free on both sides (in a multi-producer queue a preempted writer would block the loop), and
//! progress through atomics.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ipc_types::{Event, ExperimentAnswer};
use rtrb::{Consumer, Producer, RingBuffer};

use crate::player::{Change, Program};

/// Capacity for orders, which are issued one at a time.
const ORDERS: usize = 4;
/// Capacity for events from a thread to the loop, which publishes them.
pub(super) const EVENTS: usize = 64;
/// Capacity for changes; a segment lasts a good part of a second at least.
const NOTES: usize = 256;

/// An order to the loop.
#[derive(Debug)]
pub(super) enum Order {
    /// Number, program, and deadline (ns) after which the order is void, since its client has been
    /// told that it failed.
    Play(u32, Arc<Program>, u64),
    /// Stop playing.
    Stop(u32),
}

/// A change reported by the loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Note {
    /// The order being played; 0 for a protocol resumed at the start.
    pub(super) order: u32,
    /// What changed.
    pub(super) change: Change,
    /// The enable epoch that the protocol belongs to.
    pub(super) epoch: u64,
}

/// Progress of the protocol. The fields may be one cycle apart.
#[derive(Debug, Default)]
pub(super) struct Progress {
    /// segment (32 bits), running, completed, permitted; from bit 40 the newest order taken
    word: AtomicU64,
    elapsed: AtomicU64,
    sample_ns: AtomicU64,
    /// When the client last renewed its lease (ns); the only field that the loop reads
    renewed_ns: AtomicU64,
}

const RUNNING: u64 = 1 << 32;
const COMPLETED: u64 = 1 << 33;
const PERMITTED: u64 = 1 << 34;
const ORDER_SHIFT: u32 = 40;

/// A reading of [`Progress`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reading {
    pub(super) order: u32,
    pub(super) running: bool,
    pub(super) completed: bool,
    /// Whether the motor is enabled.
    pub(super) permitted: bool,
    pub(super) segment: u32,
    /// Time played (s).
    pub(super) elapsed_s: f64,
    /// Time of the newest sample (ns, CLOCK_MONOTONIC); 0 before the first.
    pub(super) sample_ns: u64,
}

impl Progress {
    /// Largest number of an order.
    pub(super) const LAST_ORDER: u32 = (1 << (64 - ORDER_SHIFT)) - 1;

    /// Updates the progress by three stores.
    pub(super) fn update(
        &self,
        order: u32,
        status: &ExperimentAnswer,
        sample_ns: u64,
        permitted: bool,
    ) {
        let flag = |set, bit| if set { bit } else { 0 };
        let word = u64::from(status.segment)
            | flag(status.running, RUNNING)
            | flag(status.completed, COMPLETED)
            | flag(permitted, PERMITTED)
            | u64::from(order) << ORDER_SHIFT;
        self.elapsed.store(status.elapsed_s.to_bits(), Ordering::Relaxed);
        self.sample_ns.store(sample_ns, Ordering::Relaxed);
        self.word.store(word, Ordering::Release);
    }

    /// Renews the client's lease.
    pub(super) fn renew(&self, now_ns: u64) {
        self.renewed_ns.store(now_ns, Ordering::Relaxed);
    }

    /// When the client last renewed its lease (ns, CLOCK_MONOTONIC); 0: not yet.
    pub(super) fn renewed_ns(&self) -> u64 {
        self.renewed_ns.load(Ordering::Relaxed)
    }

    pub(super) fn read(&self) -> Reading {
        let word = self.word.load(Ordering::Acquire);
        Reading {
            order: (word >> ORDER_SHIFT) as u32,
            running: word & RUNNING != 0,
            completed: word & COMPLETED != 0,
            permitted: word & PERMITTED != 0,
            segment: word as u32,
            elapsed_s: f64::from_bits(self.elapsed.load(Ordering::Relaxed)),
            sample_ns: self.sample_ns.load(Ordering::Relaxed),
        }
    }
}

/// Counts items dropped because a ring was full; shared by all threads of the process.
#[derive(Clone, Debug, Default)]
pub(super) struct Dropped(Arc<AtomicU64>);

impl Dropped {
    pub(super) fn count(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn so_far(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// The loop's ends.
#[derive(Debug)]
pub(super) struct LoopEnd {
    pub(super) orders: Consumer<Order>,
    pub(super) notes: Producer<Note>,
    pub(super) events: Consumer<Event>,
    pub(super) progress: Arc<Progress>,
    pub(super) dropped: Dropped,
}

/// The request thread's ends.
#[derive(Debug)]
pub(super) struct HandlerEnd {
    pub(super) orders: Producer<Order>,
    pub(super) notes: Consumer<Note>,
    /// Events to publish.
    pub(super) events: Producer<Event>,
    pub(super) progress: Arc<Progress>,
    pub(super) dropped: Dropped,
}

pub(super) fn link() -> (LoopEnd, HandlerEnd) {
    let (order_in, order_out) = RingBuffer::new(ORDERS);
    let (note_in, note_out) = RingBuffer::new(NOTES);
    let (event_in, event_out) = RingBuffer::new(EVENTS);
    let progress = Arc::new(Progress::default());
    let dropped = Dropped::default();
    let loop_end = LoopEnd {
        orders: order_out,
        notes: note_in,
        events: event_out,
        progress: Arc::clone(&progress),
        dropped: dropped.clone(),
    };
    (
        loop_end,
        HandlerEnd { orders: order_in, notes: note_out, events: event_in, progress, dropped },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_reads_back() {
        let progress = Progress::default();
        for (order, segment, running, completed, permitted) in [
            (0, 0, false, false, true),
            (1, u32::MAX, true, false, false),
            (Progress::LAST_ORDER, 7, false, true, true),
        ] {
            let status = ExperimentAnswer {
                running,
                segment,
                elapsed_s: 1.25,
                completed,
                ..ExperimentAnswer::default()
            };
            progress.update(order, &status, 42, permitted);
            let expected = Reading {
                order,
                running,
                completed,
                permitted,
                segment,
                elapsed_s: 1.25,
                sample_ns: 42,
            };
            assert_eq!(progress.read(), expected);
        }
    }
}
