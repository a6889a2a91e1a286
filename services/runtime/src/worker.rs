//! A thread beside a loop: for what waits, allocates, or touches the disk.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// A thread that is told when to end. Dropping this ends it and waits for it.
#[derive(Debug)]
pub struct Worker {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread; `work` returns soon after its argument becomes true.
    ///
    /// # Errors
    /// The operating system's, where it grants no thread.
    pub fn spawn(name: &str, work: impl FnOnce(&AtomicBool) + Send + 'static) -> io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let ending = Arc::clone(&stop);
        let thread =
            std::thread::Builder::new().name(name.to_owned()).spawn(move || work(&ending))?;
        Ok(Self { stop, thread: Some(thread) })
    }

    /// Whether the thread is gone, which it should not be.
    pub fn is_closed(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
