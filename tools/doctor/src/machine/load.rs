//! A load of the doctor's own: bounded in threads and memory, ended when it is dropped.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use runtime::{own_processors, realtime};

/// Memory that each mover copies to and fro (bytes): more than a second-level cache holds.
const MOVED: usize = 8 << 20;

/// Two ordinary threads for each processor: one computes, one moves memory.
pub(crate) struct Load {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Load {
    /// Begins.
    pub(crate) fn begin() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let threads = own_processors()
            .iter()
            .flat_map(|_| [start(&stop, compute as fn(&AtomicBool)), start(&stop, move_memory)])
            .collect();
        Self { stop, threads }
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // One that panicked is no load any more.
            let _ended = thread.join();
        }
    }
}

fn start(stop: &Arc<AtomicBool>, work: fn(&AtomicBool)) -> JoinHandle<()> {
    let stop = Arc::clone(stop);
    std::thread::spawn(move || {
        realtime::request_normal();
        work(&stop);
    })
}

fn compute(stop: &AtomicBool) {
    let mut value = 1.0_f64;
    while !stop.load(Ordering::Relaxed) {
        for _ in 0..1000 {
            value = std::hint::black_box(value * 1.000_001 + 1e-9);
        }
    }
}

fn move_memory(stop: &AtomicBool) {
    let (from, mut to) = (vec![1_u8; MOVED], vec![0_u8; MOVED]);
    while !stop.load(Ordering::Relaxed) {
        to.copy_from_slice(std::hint::black_box(&from));
        std::hint::black_box(&mut to);
    }
}
