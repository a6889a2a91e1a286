//! Receiving end of the `sd_notify` protocol; the kernel attaches the sender's pid to each
//! datagram.

use std::io::IoSliceMut;
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixDatagram;
use std::path::Path;

use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg, sockopt};

use crate::Error;

/// A notification that the launcher acts on; others are ignored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Notification {
    /// `READY=1`
    Ready,
    /// `WATCHDOG=1`
    KeepAlive,
    /// `STATUS=...`
    Status(String),
}

/// Non-blocking datagram socket with `SO_PASSCRED`.
pub(crate) struct NotifySocket(UnixDatagram);

impl NotifySocket {
    /// Removes a stale socket at `path` and binds a new one. Running processes reach it, since
    /// `sd_notify` resolves the path for every datagram.
    pub(crate) fn bind(path: &Path) -> Result<Self, Error> {
        let _ = std::fs::remove_file(path);
        let socket = UnixDatagram::bind(path).map_err(|source| Error::io("bind", path, source))?;
        socket
            .set_nonblocking(true)
            .map_err(|source| Error::io("set non-blocking", path, source))?;
        sockopt::set_socket_passcred(&socket, true)
            .map_err(|source| Error::io("set SO_PASSCRED on", path, source))?;
        Ok(Self(socket))
    }

    /// The descriptor to poll.
    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }

    /// The next datagram: the sender's pid (0 if the kernel sent no credentials) and its
    /// notifications. `None` if none is waiting or the read failed.
    pub(crate) fn receive(&self) -> Option<(i32, Vec<Notification>)> {
        let mut bytes = [0u8; 4096];
        let mut control_buffer =
            [MaybeUninit::uninit(); rustix::cmsg_space!(ScmCredentials(1), ScmRights(8))];
        let mut ancillary = RecvAncillaryBuffer::new(&mut control_buffer);
        let received = recvmsg(
            &self.0,
            &mut [IoSliceMut::new(&mut bytes)],
            &mut ancillary,
            RecvFlags::CMSG_CLOEXEC,
        )
        .ok()?;
        let mut pid = 0;
        for message in ancillary.drain() {
            // Descriptors sent alongside (`SCM_RIGHTS`) are closed when the message is dropped.
            if let RecvAncillaryMessage::ScmCredentials(credentials) = message {
                pid = credentials.pid.as_raw_nonzero().get();
            }
        }
        Some((pid, parse(&bytes[..received.bytes])))
    }
}

/// Longest status text that is kept (characters).
const STATUS_CHARACTERS: usize = 200;

/// The notifications in a datagram.
pub(crate) fn parse(datagram: &[u8]) -> Vec<Notification> {
    String::from_utf8_lossy(datagram)
        .lines()
        .filter_map(|line| match line.split_once('=')? {
            ("READY", "1") => Some(Notification::Ready),
            ("WATCHDOG", "1") => Some(Notification::KeepAlive),
            ("STATUS", text) => {
                Some(Notification::Status(text.chars().take(STATUS_CHARACTERS).collect()))
            }
            _ => None,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_notifications_are_parsed() {
        let text = "READY=1\nSTATUS=best-effort\nWATCHDOG=1\nMAINPID=4\nnonsense\n";
        assert_eq!(
            parse(text.as_bytes()),
            [
                Notification::Ready,
                Notification::Status("best-effort".to_owned()),
                Notification::KeepAlive
            ]
        );
    }

    #[test]
    fn the_sender_pid_is_reported() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("notify");
        let socket = NotifySocket::bind(&path).unwrap();
        assert_eq!(socket.receive(), None);
        UnixDatagram::unbound().unwrap().send_to(b"WATCHDOG=1\n", &path).unwrap();
        assert_eq!(
            socket.receive(),
            Some((std::process::id() as i32, vec![Notification::KeepAlive]))
        );
    }
}
