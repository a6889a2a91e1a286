//! The thread that receives requests and passes each to the loop.

use std::sync::mpsc::{self, Receiver, Sender, SyncSender};
use std::time::Duration;

use ipc_types::{LOGGER_COMMANDS, LoggerAnswer, LoggerRequest};
use runtime::{RigName, ServiceError, Worker};

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
        let worker = Worker::serve(rig, LOGGER_COMMANDS, ask, |_| (), forward)?;
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

fn forward(loop_inbox: &mut Sender<PendingRequest>, request: LoggerRequest) -> LoggerAnswer {
    let (reply, answer) = mpsc::sync_channel(1);
    let failed = |error: &str| LoggerAnswer { error: error.to_owned(), ..LoggerAnswer::default() };
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
