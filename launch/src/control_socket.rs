//! The control socket: requests and answers, one JSON object per line.
//!
//! ```text
//! -> {"request":"status"}                     <- {"answer":"status","status":{...}}
//! -> {"request":"restart","unit":"control"}   <- {"answer":"done"}
//! -> {"request":"stop"}                       <- {"answer":"done"}
//!                           (all stopped)     <- {"answer":"stopped","report":{...}}
//! ```

use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;

use rustix::net::sockopt;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::status::{Status, StopReport};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "snake_case")]
pub(crate) enum Request {
    Status,
    Restart {
        unit: String,
    },
    /// Sets variables for every process that starts from now on, and restarts these units.
    Change {
        environment: BTreeMap<String, String>,
        units: Vec<String>,
    },
    /// Runs this program in place of a unit's own; empty for its own again.
    Replace {
        unit: String,
        command: Vec<String>,
    },
    Stop,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "answer", rename_all = "snake_case")]
pub(crate) enum Answer {
    Status { status: Box<Status> },
    Done,
    Refused { reason: String },
    Stopped { report: StopReport },
}

/// Longest request (bytes); a client that sends more is disconnected.
const LONGEST: usize = 4096;
/// Most clients at a time.
const CLIENTS: usize = 16;

pub(crate) struct ControlServer {
    listener: UnixListener,
    clients: Vec<Client>,
}

struct Client {
    stream: UnixStream,
    received: Vec<u8>,
    wants_report: bool,
    gone: bool,
}

impl ControlServer {
    pub(crate) fn bind(path: &Path) -> Result<Self, Error> {
        let _ = std::fs::remove_file(path);
        let listener =
            UnixListener::bind(path).map_err(|source| Error::io("bind", path, source))?;
        listener.set_nonblocking(true).map_err(|source| Error::io("set up", path, source))?;
        Ok(Self { listener, clients: Vec::new() })
    }

    /// Descriptors to poll: the listener, then the clients.
    pub(crate) fn handles(&self) -> impl Iterator<Item = BorrowedFd<'_>> {
        std::iter::once(self.listener.as_fd())
            .chain(self.clients.iter().map(|client| client.stream.as_fd()))
    }

    /// Accepts waiting clients and reads their requests: (client, request).
    pub(crate) fn receive(&mut self) -> Vec<(usize, Result<Request, String>)> {
        self.clients.retain(|client| !client.gone);
        while let Ok((stream, _)) = self.listener.accept() {
            if self.clients.len() < CLIENTS
                && stream.set_nonblocking(true).is_ok()
                && is_ours(&stream)
            {
                self.clients.push(Client {
                    stream,
                    received: Vec::new(),
                    wants_report: false,
                    gone: false,
                });
            }
        }
        let mut requests = Vec::new();
        for (index, client) in self.clients.iter_mut().enumerate() {
            let mut bytes = [0u8; 1024];
            loop {
                match client.stream.read(&mut bytes) {
                    Ok(0) => client.gone = true,
                    Ok(count) if client.received.len() + count <= LONGEST => {
                        client.received.extend_from_slice(&bytes[..count]);
                        continue;
                    }
                    Ok(_) => client.gone = true,
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                    Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                    Err(_) => client.gone = true,
                }
                break;
            }
            while let Some(end) = client.received.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = client.received.drain(..=end).collect();
                let request = request_of(&line);
                client.wants_report |= request == Ok(Request::Stop);
                requests.push((index, request));
            }
        }
        requests
    }

    pub(crate) fn answer(&mut self, client: usize, answer: &Answer) {
        if let Some(client) = self.clients.get_mut(client) {
            client.gone |= send(&mut client.stream, answer).is_err();
        }
    }

    /// Sends the report to the clients that requested the stop.
    pub(crate) fn report(&mut self, report: &StopReport) {
        for client in self.clients.iter_mut().filter(|client| client.wants_report) {
            let _ = send(&mut client.stream, &Answer::Stopped { report: report.clone() });
        }
    }
}

/// Reads a line as a request.
pub(crate) fn request_of(line: &[u8]) -> Result<Request, String> {
    serde_json::from_slice(line).map_err(|error| format!("not a request: {error}"))
}

/// Only this user and root may connect: root can enter a directory of mode 0700.
fn is_ours(stream: &UnixStream) -> bool {
    let own = rustix::process::geteuid();
    sockopt::socket_peercred(stream).is_ok_and(|peer| peer.uid == own || peer.uid.is_root())
}

/// Writes one line. A client that does not read its answer is disconnected, not waited for.
pub(crate) fn send<T: Serialize>(stream: &mut UnixStream, value: &T) -> io::Result<()> {
    let mut line = serde_json::to_vec(value)?;
    line.push(b'\n');
    stream.write_all(&line)
}
