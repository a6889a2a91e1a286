//! The thread that receives requests. iceoryx2 ports stay in the thread that made them, so it has a
//! node of its own and passes each request to the loop.

use std::sync::atomic::Ordering;
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::time::Duration;

use ipc_types::{LOGGER_COMMANDS, LoggerAnswer, LoggerRequest};
use runtime::{Domain, RigName, Server, ServiceError, Worker};

/// Time between two polls for requests.
const POLL: Duration = Duration::from_millis(5);
/// How long a request waits for the loop and, through it, for the disk.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);

/// A request on its way to the loop.
#[derive(Debug)]
pub(super) struct PendingRequest {
    pub(super) request: LoggerRequest,
    pub(super) reply: SyncSender<LoggerAnswer>,
}

/// Receives the requests in the loop. Dropping it ends the thread.
#[derive(Debug)]
pub(super) struct RequestReceiver {
    requests: Receiver<PendingRequest>,
    worker: Worker,
}

impl RequestReceiver {
    /// Starts the thread; returns when it takes requests.
    pub(super) fn open(rig: &RigName) -> Result<Self, ServiceError> {
        let (ask, requests) = mpsc::channel();
        let (ready, wait) = mpsc::channel();
        let name = rig.clone();
        let worker = Worker::spawn("logger-requests", move |ending| {
            // The server needs the domain for as long as it lives.
            let opened = Domain::open(&name).map_err(ServiceError::from).and_then(|domain| {
                let server = Server::new(&domain.node("logger-requests")?, &LOGGER_COMMANDS)?;
                Ok((domain, server))
            });
            let (_domain, server) = match opened {
                Ok(opened) => opened,
                Err(error) => {
                    let _ = ready.send(Err(error));
                    return;
                }
            };
            let _ = ready.send(Ok(()));
            while !ending.load(Ordering::Relaxed) {
                let broken = |error| eprintln!("farreach logger: request dropped: {error}");
                if let Err(error) = server.poll(|request| forward(request, &ask), broken) {
                    eprintln!("farreach logger: requests are no longer answered: {error}");
                    return;
                }
                std::thread::sleep(POLL);
            }
        })?;
        // The channel is closed only by a thread that panicked.
        wait.recv().unwrap_or_else(|_| {
            Err(std::io::Error::other("the thread that answers requests ended").into())
        })?;
        Ok(Self { requests, worker })
    }

    /// The next request.
    pub(super) fn next(&self) -> Option<PendingRequest> {
        self.requests.try_recv().ok()
    }

    /// Whether the thread has ended, which is a fault.
    pub(super) fn is_closed(&self) -> bool {
        self.worker.is_closed()
    }
}

impl Drop for RequestReceiver {
    fn drop(&mut self) {
        // Pending requests fail at once, so that the worker's end does not wait for them.
        self.requests = mpsc::channel().1;
    }
}

fn forward(request: LoggerRequest, loop_inbox: &mpsc::Sender<PendingRequest>) -> LoggerAnswer {
    let (reply, answer) = mpsc::sync_channel(1);
    let failed = |error: &str| LoggerAnswer {
        recording: None,
        written: 0,
        lost: 0,
        error: error.to_owned(),
    };
    if loop_inbox.send(PendingRequest { request, reply }).is_err() {
        return failed("the logger is ending");
    }
    match answer.recv_timeout(ANSWER_LIMIT) {
        Ok(answer) => answer,
        Err(mpsc::RecvTimeoutError::Disconnected) => failed("the logger is ending"),
        Err(mpsc::RecvTimeoutError::Timeout) => {
            failed("the disk is slow and the request is still in progress: see `farreach status`")
        }
    }
}
