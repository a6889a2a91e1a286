//! The host's stalls while the campaign runs, measured beside it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use runtime::HostStall;
use runtime::clock::now_ns;

/// One measurement.
#[derive(Clone, Copy, Debug)]
struct Slice {
    end_ns: u64,
    longest_ns: u64,
}

/// How long one measurement lasts: short against an injection.
pub const SLICE: Duration = Duration::from_millis(100);

/// Bare loops on every processor, above every loop of the rig, that do nothing but wake.
#[derive(Debug)]
pub struct HostStalls {
    slices: Arc<Mutex<Vec<Slice>>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl HostStalls {
    pub fn watch() -> Self {
        let (slices, stop) = (Arc::new(Mutex::new(Vec::new())), Arc::new(AtomicBool::new(false)));
        let (to, ended) = (Arc::clone(&slices), Arc::clone(&stop));
        let thread = std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                let longest_ns = HostStall::measure(SLICE).longest_ns;
                to.lock().unwrap().push(Slice { end_ns: now_ns(), longest_ns });
            }
        });
        Self { slices, stop, thread: Some(thread) }
    }

    /// The longest stall since then (ms).
    pub fn longest_ms(&self, since_ns: u64) -> f64 {
        let slices = self.slices.lock().unwrap();
        let since = slices.iter().rev().take_while(|slice| slice.end_ns > since_ns);
        since.map(|slice| slice.longest_ns).max().unwrap_or(0) as f64 * 1e-6
    }
}

impl Drop for HostStalls {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ended = thread.join();
        }
    }
}
