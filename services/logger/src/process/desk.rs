//! The thread that answers requests. Ports stay in the thread that made them, so it has a node of
//! its own and passes what it is asked to the loop.

use std::sync::atomic::Ordering;
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::time::Duration;

use ipc_types::{LOGGER_COMMANDS, LoggerAnswer, LoggerRequest};
use runtime::{Domain, RigName, Server, ServiceError, Worker};

/// How often it looks for requests.
const NAP: Duration = Duration::from_millis(5);
/// How long a request waits for the loop and, through it, for the disk.
const PATIENCE: Duration = Duration::from_secs(10);

/// A request on its way to the loop.
#[derive(Debug)]
pub(super) struct Question {
    pub(super) request: LoggerRequest,
    pub(super) reply: SyncSender<LoggerAnswer>,
}

/// The loop's end. Dropping it ends the thread.
#[derive(Debug)]
pub(super) struct Desk {
    questions: Receiver<Question>,
    worker: Worker,
}

impl Desk {
    /// Starts the thread; returns when it serves.
    pub(super) fn open(rig: &RigName) -> Result<Self, ServiceError> {
        let (ask, questions) = mpsc::channel();
        let (ready, wait) = mpsc::channel();
        let name = rig.clone();
        let worker = Worker::spawn("logger-desk", move |ending| {
            // The domain is held as long as the server: the thread is part of the rig by itself.
            let opened = Domain::open(&name).map_err(ServiceError::from).and_then(|domain| {
                let server = Server::new(&domain.node("logger-desk")?, &LOGGER_COMMANDS)?;
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
                if let Err(error) = server.poll(|request| pass_on(request, &ask), broken) {
                    eprintln!("farreach logger: requests are no longer answered: {error}");
                    return;
                }
                std::thread::sleep(NAP);
            }
        })?;
        // The channel is closed only by a thread that panicked.
        wait.recv().unwrap_or_else(|_| {
            Err(std::io::Error::other("the thread that answers requests ended").into())
        })?;
        Ok(Self { questions, worker })
    }

    /// The next request.
    pub(super) fn next(&self) -> Option<Question> {
        self.questions.try_recv().ok()
    }

    /// Whether the thread is gone, which it should not be.
    pub(super) fn is_closed(&self) -> bool {
        self.worker.is_closed()
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        // A request that the loop will not take any more fails at once instead of being waited for,
        // by the worker that ends next.
        self.questions = mpsc::channel().1;
    }
}

fn pass_on(request: LoggerRequest, loop_inbox: &mpsc::Sender<Question>) -> LoggerAnswer {
    let (reply, answer) = mpsc::sync_channel(1);
    let failed = |error: &str| LoggerAnswer {
        recording: None,
        written: 0,
        lost: 0,
        error: error.to_owned(),
    };
    if loop_inbox.send(Question { request, reply }).is_err() {
        return failed("the logger is ending");
    }
    match answer.recv_timeout(PATIENCE) {
        Ok(answer) => answer,
        Err(mpsc::RecvTimeoutError::Disconnected) => failed("the logger is ending"),
        Err(mpsc::RecvTimeoutError::Timeout) => {
            failed("the disk is slow and the request is still under way: see `farreach rec status`")
        }
    }
}
