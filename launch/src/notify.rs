//! The launcher's end of `sd_notify`: datagrams with the sender's pid from the kernel.

use std::io::IoSliceMut;
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixDatagram;
use std::path::Path;

use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg, sockopt};

use crate::Error;

/// A notification.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Notification {
    /// `READY=1`
    Ready,
    /// `WATCHDOG=1`
    Alive,
    /// `STATUS=...`
    Status(String),
}

pub(crate) struct NotifySocket(UnixDatagram);

impl NotifySocket {
    /// Binds the path anew. Processes that resolve the path for each datagram, as sd_notify does,
    /// reach the new socket.
    pub(crate) fn bind(path: &Path) -> Result<Self, Error> {
        let _ = std::fs::remove_file(path);
        let socket = UnixDatagram::bind(path).map_err(|source| Error::io("bind", path, source))?;
        socket.set_nonblocking(true).map_err(|source| Error::io("set up", path, source))?;
        sockopt::set_socket_passcred(&socket, true)
            .map_err(|source| Error::io("set up", path, source))?;
        Ok(Self(socket))
    }

    pub(crate) fn handle(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }

    /// The next datagram: the sender's pid and its notifications; `None` if there is none.
    pub(crate) fn receive(&self) -> Option<(i32, Vec<Notification>)> {
        let mut bytes = [0u8; 4096];
        let mut space =
            [MaybeUninit::uninit(); rustix::cmsg_space!(ScmCredentials(1), ScmRights(8))];
        let mut ancillary = RecvAncillaryBuffer::new(&mut space);
        let received = recvmsg(
            &self.0,
            &mut [IoSliceMut::new(&mut bytes)],
            &mut ancillary,
            RecvFlags::CMSG_CLOEXEC,
        )
        .ok()?;
        let mut pid = 0;
        for message in ancillary.drain() {
            // Descriptors sent along are closed as they are dropped.
            if let RecvAncillaryMessage::ScmCredentials(credentials) = message {
                pid = credentials.pid.as_raw_nonzero().get();
            }
        }
        Some((pid, notifications(&String::from_utf8_lossy(&bytes[..received.bytes]))))
    }
}

fn notifications(text: &str) -> Vec<Notification> {
    text.lines()
        .filter_map(|line| match line.split_once('=')? {
            ("READY", "1") => Some(Notification::Ready),
            ("WATCHDOG", "1") => Some(Notification::Alive),
            ("STATUS", text) => Some(Notification::Status(text.chars().take(200).collect())),
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
            notifications(text),
            [
                Notification::Ready,
                Notification::Status("best-effort".to_owned()),
                Notification::Alive
            ]
        );
    }

    #[test]
    fn the_sender_is_known() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("notify");
        let socket = NotifySocket::bind(&path).unwrap();
        assert_eq!(socket.receive(), None);
        UnixDatagram::unbound().unwrap().send_to(b"WATCHDOG=1\n", &path).unwrap();
        assert_eq!(socket.receive(), Some((std::process::id() as i32, vec![Notification::Alive])));
    }
}
