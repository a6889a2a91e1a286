//! A thread beside a loop: for what waits, allocates, or touches the disk.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::Duration;

use ipc_types::CommandService;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::domain::{Domain, RigName};
use crate::realtime::{HELPER_PRIORITY, loop_priority, request_helper};
use crate::request::Server;
use crate::service::ServiceError;

/// How often a thread that answers requests looks for them.
const POLL_PERIOD: Duration = Duration::from_millis(10);

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
        let thread = crate::realtime::beside_loop(name).spawn(move || work(&ending))?;
        Ok(Self { stop, thread: Some(thread) })
    }

    /// Starts a thread that answers a service's requests, with a node of its own, since ports stay
    /// in the thread that made them; returns once it serves. `idle` runs every 10 ms, before the
    /// requests are looked at, and once more at the end.
    ///
    /// # Errors
    /// The domain cannot be joined, the service not be opened, or the thread not be started.
    pub fn serve<H, Q, A>(
        rig: &RigName,
        service: CommandService,
        mut handler: H,
        idle: fn(&mut H),
        answer: fn(&mut H, Q) -> A,
    ) -> Result<Self, ServiceError>
    where
        H: Send + 'static,
        Q: DeserializeOwned + 'static,
        A: Serialize + 'static,
    {
        let (ready, wait) = mpsc::channel();
        let rig = rig.clone();
        let name = format!("{}-requests", service.owner);
        let worker = Self::spawn(&name.clone(), move |ending| {
            // The server needs the domain for as long as it lives.
            let (_domain, server) = match open(&rig, &service, &name) {
                Ok(opened) => opened,
                Err(error) => {
                    let _ = ready.send(Err(error));
                    return;
                }
            };
            let _ = ready.send(Ok(()));
            while !ending.load(Ordering::Relaxed) {
                idle(&mut handler);
                let broken = |error| {
                    eprintln!("farreach {}: request dropped: {error}", service.owner);
                };
                match server.poll(|request| answer(&mut handler, request), broken) {
                    // Another one may wait.
                    Ok(true) => {}
                    Ok(false) => std::thread::sleep(POLL_PERIOD),
                    Err(error) => {
                        eprintln!(
                            "farreach {}: requests are no longer answered: {error}",
                            service.owner
                        );
                        return;
                    }
                }
            }
            idle(&mut handler);
        })?;
        // The channel is closed only by a thread that panicked.
        wait.recv().unwrap_or_else(|_| {
            Err(io::Error::other("the thread that answers requests ended").into())
        })?;
        Ok(worker)
    }

    /// Whether the thread is gone, which it should not be.
    pub fn is_closed(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

/// Joins the domain and makes the server, at the priority of a helper where the process has a
/// real-time loop.
fn open(
    rig: &RigName,
    service: &CommandService,
    node: &str,
) -> Result<(Domain, Server), ServiceError> {
    let domain = Domain::open(rig)?;
    request_helper(domain.fifo() && loop_priority(service.owner) > HELPER_PRIORITY);
    let server = Server::new(&domain.node(node)?, service)?;
    Ok((domain, server))
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
