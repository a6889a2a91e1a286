//! Writes the interrupted protocol in a thread of its own: the thread that answers requests renews
//! the clients' leases, and must not wait for a disk.

use std::io;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use crate::interrupted::{Interrupted, InterruptedFile};

/// What the file shall hold.
enum Wanted {
    /// This protocol.
    Kept(Box<Interrupted>),
    /// Nothing: the protocol ran to its end.
    Removed,
}

/// The thread. Dropping it waits until the newest is on the disk.
#[derive(Debug)]
pub(super) struct InterruptedWriter {
    wanted: Option<Sender<Wanted>>,
    failures: Receiver<String>,
    thread: Option<JoinHandle<()>>,
}

impl InterruptedWriter {
    /// Starts the thread.
    ///
    /// # Errors
    /// Those of the system.
    pub(super) fn start(file: InterruptedFile) -> io::Result<Self> {
        let (wanted, orders) = channel();
        let (failed, failures) = channel();
        let thread = runtime::realtime::beside_loop("interrupted").spawn(move || {
            while let Ok(mut newest) = orders.recv() {
                // What is older is not needed any more.
                while let Ok(newer) = orders.try_recv() {
                    newest = newer;
                }
                let written = match newest {
                    Wanted::Kept(interrupted) => file.keep(&interrupted),
                    Wanted::Removed => file.remove(),
                };
                if let Err(reason) = written {
                    // Nobody is there to be told once the process ends.
                    let _told = failed.send(reason);
                }
            }
        })?;
        Ok(Self { wanted: Some(wanted), failures, thread: Some(thread) })
    }

    pub(super) fn keep(&self, interrupted: Interrupted) {
        self.send(Wanted::Kept(Box::new(interrupted)));
    }

    pub(super) fn remove(&self) {
        self.send(Wanted::Removed);
    }

    fn send(&self, wanted: Wanted) {
        if let Some(sender) = &self.wanted {
            // The thread lives as long as this end of the channel.
            let _sent = sender.send(wanted);
        }
    }

    /// Why something could not be written since the last call.
    pub(super) fn failure(&self) -> Option<String> {
        self.failures.try_recv().ok()
    }
}

impl Drop for InterruptedWriter {
    fn drop(&mut self) {
        drop(self.wanted.take());
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has nothing left to write.
            let _ended = thread.join();
        }
    }
}
