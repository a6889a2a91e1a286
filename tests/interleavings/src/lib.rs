//! The hand-offs between threads that are farreach's own, under every interleaving and every order
//! of memory accesses that [loom](https://docs.rs/loom) explores. The tests compile the modules of
//! the processes as they are, with loom's atomics in place of the standard library's:
//!
//! ```text
//! RUSTFLAGS="--cfg loom" cargo test -p interleavings --release -- --nocapture
//! ```
//!
//! Left out is what hands nothing over but itself, or by others' means:
//!
//! - single words that stand for themselves: stop flags, heartbeats, loss counters, the watchdog's
//!   `Shared` (states of peers, the card) and `HomingFile::take_failure`; what is read after a
//!   thread's end is read behind its `join`;
//! - rings, queues and channels (rtrb, crossbeam-queue, std's mpsc), and mutexes: the console's
//!   desk, the workers for homing, learning and interrupted protocols;
//! - the logger's two threads: what they share is linearizable, so that
//!   `services/logger/src/interleavings.rs` steps them in every order without loom.
//!
//! Without `--cfg loom` there is nothing here, and loom is not built.
#![cfg(loom)]

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use loom::sync::Mutex;

/// A bounded queue that is linearizable, as crossbeam's says it is; loom cannot look into that one.
#[derive(Debug)]
pub struct ArrayQueue<T> {
    places: usize,
    held: Mutex<VecDeque<T>>,
}

impl<T> ArrayQueue<T> {
    /// An empty queue with room for that many.
    pub fn new(places: usize) -> Self {
        Self { places, held: Mutex::new(VecDeque::new()) }
    }

    /// Adds one behind the others.
    ///
    /// # Errors
    /// It comes back where there is no room.
    pub fn push(&self, value: T) -> Result<(), T> {
        let mut held = self.lock();
        if held.len() >= self.places {
            return Err(value);
        }
        held.push_back(value);
        Ok(())
    }

    /// Adds one behind the others; the first makes room, and is returned.
    pub fn force_push(&self, value: T) -> Option<T> {
        let mut held = self.lock();
        let first = if held.len() >= self.places { held.pop_front() } else { None };
        held.push_back(value);
        first
    }

    /// Takes the first.
    pub fn pop(&self) -> Option<T> {
        self.lock().pop_front()
    }

    fn lock(&self) -> loom::sync::MutexGuard<'_, VecDeque<T>> {
        self.held.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

/// Explores a model with every choice of what a load sees, and every interleaving, or those in
/// which a thread that could go on is interrupted at most `interruptions` times; says how many
/// there were.
pub fn explore(
    name: &str,
    interruptions: Option<usize>,
    model: impl Fn() + Sync + Send + 'static,
) -> u64 {
    let explored = Arc::new(AtomicU64::new(0));
    let counter = Arc::clone(&explored);
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = interruptions;
    builder.check(move || {
        counter.fetch_add(1, Ordering::Relaxed);
        model();
    });
    let explored = explored.load(Ordering::Relaxed);
    let bound = interruptions.map_or_else(String::new, |most| format!(", {most} interruptions"));
    println!("{name}{bound}: {explored} interleavings");
    explored
}
