//! Communication between the real-time loop and the request thread. Neither waits for the other:
//! orders, changes of state and events pass through single-producer, single-consumer rings, which
//! are wait-free on both sides (with a multi-producer queue, a preempted writer could block the
//! loop). Progress is passed in atomics.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ipc_types::Event;
use rtrb::{Consumer, Producer, RingBuffer};

use super::progress::Progress;
use crate::player::{Change, Program};
use crate::scan_tracker::ScanState;
use crate::session_state::SessionStep;

/// Capacity of the order ring; orders are sent one at a time.
const ORDER_CAPACITY: usize = 4;
/// Capacity of an event ring, from the request or learning thread to the loop, which publishes
/// them.
pub(super) const EVENT_CAPACITY: usize = 64;
/// Capacity of the ring for changes; segments start at most a few times per second.
const CHANGE_CAPACITY: usize = 256;
/// Capacity of the ring for keys: more than a person or a scanner types in a cycle of the loop.
const KEY_CAPACITY: usize = 64;
/// Capacity of the ring for steps of sessions; the bar is updated twice a second.
const STEP_CAPACITY: usize = 256;

/// An order to the loop.
#[derive(Debug)]
pub(super) enum Order {
    /// Play a program. Ignored after `deadline_ns` (CLOCK_MONOTONIC), well before the client is
    /// told that the request failed.
    Play { number: u32, program: Arc<Program>, deadline_ns: u64 },
    /// Stop playing.
    Stop { number: u32 },
}

/// A change reported by the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ChangeReport {
    /// Number of the order being played; 0 for a protocol resumed when the process started.
    pub(super) order: u32,
    /// What changed.
    pub(super) change: Change,
    /// The enable epoch that the protocol belongs to.
    pub(super) epoch: u64,
    /// The scanner, as far as it was followed.
    pub(super) scan: ScanState,
}

/// Counts items dropped because a ring was full; shared by all threads of the process.
#[derive(Clone, Debug, Default)]
pub(super) struct Dropped(Arc<AtomicU64>);

impl Dropped {
    pub(super) fn count(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn total(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// The real-time loop's side.
#[derive(Debug)]
pub(super) struct LoopSide {
    pub(super) orders: Consumer<Order>,
    /// When the key 5 was pressed (ns, CLOCK_MONOTONIC).
    pub(super) keys: Consumer<u64>,
    pub(super) changes: Producer<ChangeReport>,
    /// Steps of sessions, each with the number of the order being played.
    pub(super) steps: Producer<(u32, SessionStep)>,
    pub(super) events: Consumer<Event>,
    pub(super) progress: Arc<Progress>,
    pub(super) dropped: Dropped,
}

/// The request thread's side.
#[derive(Debug)]
pub(super) struct RequestSide {
    pub(super) orders: Producer<Order>,
    pub(super) keys: Producer<u64>,
    pub(super) changes: Consumer<ChangeReport>,
    pub(super) steps: Consumer<(u32, SessionStep)>,
    /// Events to publish.
    pub(super) events: Producer<Event>,
    pub(super) progress: Arc<Progress>,
    pub(super) dropped: Dropped,
}

impl RequestSide {
    /// Has the loop publish an event; one that finds no room is counted.
    pub(super) fn publish(&mut self, event: Event) {
        if self.events.push(event).is_err() {
            self.dropped.count();
        }
    }
}

/// Creates both sides.
pub(super) fn pair() -> (LoopSide, RequestSide) {
    let (order_in, order_out) = RingBuffer::new(ORDER_CAPACITY);
    let (key_in, key_out) = RingBuffer::new(KEY_CAPACITY);
    let (change_in, change_out) = RingBuffer::new(CHANGE_CAPACITY);
    let (step_in, step_out) = RingBuffer::new(STEP_CAPACITY);
    let (event_in, event_out) = RingBuffer::new(EVENT_CAPACITY);
    let progress = Arc::new(Progress::default());
    let dropped = Dropped::default();
    let loop_side = LoopSide {
        orders: order_out,
        keys: key_out,
        changes: change_in,
        steps: step_in,
        events: event_out,
        progress: Arc::clone(&progress),
        dropped: dropped.clone(),
    };
    (
        loop_side,
        RequestSide {
            orders: order_in,
            keys: key_in,
            changes: change_out,
            steps: step_out,
            events: event_in,
            progress,
            dropped,
        },
    )
}
